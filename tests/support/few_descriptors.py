"""Streamlit with few descriptors and little patience, run in place of `streamlit`."""

import resource

from streamlit.web import cli

from pages.ui import server

FEW = 700

if __name__ == "__main__":
    resource.setrlimit(resource.RLIMIT_NOFILE, (FEW, FEW))
    server.SILENT, server.SWEEP = 2.0, 0.2
    cli.main()
