"""`app`: the pages in the browser, by Streamlit in a process of its own."""

import argparse
import subprocess
import sys

from accpinn.cli.recordings import option
from accpinn.errors import ConfigError
from accpinn.storage import shipped

APP_OPTIONS = (
    option("--address", metavar="HOST", help="address to listen at (this computer alone)"),
    option("--host", metavar="NAME", help="name by which others reach it, with --address (any)"),
    option("--port", type=int, metavar="N", help="(the first free one from 8501 on)"),
)


def run_app(options: argparse.Namespace) -> int:
    """Start the app, and wait for its end; it prints its address itself."""
    if options.host and not options.address:
        raise ConfigError("host: it needs an --address that others reach, as 0.0.0.0.")
    script = shipped("app.py")
    arguments = [sys.executable, "-m", "streamlit", "run", str(script)]
    if options.address:
        arguments += [
            f"--server.address={options.address}",
            f"--server.allowedHosts={options.host or '*'}",
        ]
    if options.port is not None:
        arguments.append(f"--server.port={options.port}")
    with subprocess.Popen(arguments) as app:  # its settings lie beside the script
        try:
            return app.wait()
        except KeyboardInterrupt:
            app.terminate()
            return 130
