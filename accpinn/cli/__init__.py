"""The command line: `python -m accpinn COMMAND`.

`--json` prints one JSON document on standard output; progress goes to standard error. The exit
status is 0, 2 for wrong usage, 1 for anything wrong with data or files (one line `error: ...`),
130 when interrupted.
"""

import argparse
import sys
from collections.abc import Sequence
from io import TextIOWrapper

from accpinn import __version__
from accpinn.cli import compare, fit, info, report, simulate, stability, starts, verify
from accpinn.errors import AccpinnError, ConfigError, ParameterError

COMMANDS = (info, fit, starts, compare, stability, simulate, verify, report)
"""Modules with `add_parser(subparsers)`, whose parsers set `run` to a function of the options."""


def main(arguments: Sequence[str] | None = None) -> int:
    """Run one command; returns the exit status."""
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, TextIOWrapper):  # a pipe on Windows has no α, β, τ otherwise
            stream.reconfigure(encoding="utf-8")
    options = _parser().parse_args(arguments)
    try:
        status: int = options.run(options)
    except AccpinnError as fault:
        print(f"error: {fault}", file=sys.stderr)
        return 2 if isinstance(fault, ConfigError | ParameterError) else 1
    except BrokenPipeError:  # the reader, `head` say, has seen enough
        return 0
    except KeyboardInterrupt:
        return 130
    return status


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="python -m accpinn",
        description="Learn the parameters of adaptive cruise control from OpenACC recordings.",
    )
    parser.add_argument("--version", action="version", version=f"accpinn {__version__}")
    subparsers = parser.add_subparsers(metavar="COMMAND", required=True)
    for command in COMMANDS:
        command.add_parser(subparsers)
    return parser
