"""A result as one web page that needs nothing else than a browser: no server, no network.

It tells the story in order: data, segment, parameters, fit, stability, platoon, methods compared,
provenance, how to cite. Plotly's script is in it once. Everything that comes from a file or a user
is escaped where it is put in.
"""
