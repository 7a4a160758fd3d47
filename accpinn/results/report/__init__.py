"""A result as one web page that needs nothing else than a browser: no server, no network.

Its sections: data, parameters, fit, string stability, platoon, methods compared, provenance, how to
cite. Plotly's script is in it once. Everything that comes from a file or a user is escaped where it
is put in.
"""
