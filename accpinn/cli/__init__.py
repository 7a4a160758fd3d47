"""The command line: `accpinn COMMAND`, or `python -m accpinn COMMAND`.

`--json` prints one JSON document on standard output; progress goes to standard error where that is
a terminal. The exit status is 0, 2 for wrong usage, 1 for anything wrong with data or files (one
line `error: ...`), 130 when interrupted.
"""

import argparse
import re
import shlex
import sys
from collections.abc import Sequence
from importlib import import_module
from pathlib import Path
from textwrap import fill
from typing import Any, NoReturn

from accpinn import __version__
from accpinn.cli.output import flush, open_streams, print_error, show
from accpinn.errors import AccpinnError, ConfigError, ParameterError

COMMANDS = {
    "info": ("recordings", "what a recording holds, and warnings about it"),
    "fit": ("estimation", "learn each follower's parameters from windows of a recording"),
    "starts": ("estimation", "train the PiNN from five initial values, one table"),
    "compare": ("estimation", "several methods on the same windows, side by side"),
    "judge": ("judge", "car-following models, also your own, in windows left out of their fit"),
    "batch": ("batch", "all windows of many recordings by several methods"),
    "table": ("batch", "what a batch says by make, model, setting, ..."),
    "dataset": ("dataset", "parameters of all cars in many recordings, ready to be published"),
    "stability": ("vehicles", "string stability of given parameters"),
    "simulate": ("vehicles", "a platoon behind a sinusoidal leader"),
    "drive": ("vehicles", "the drive of the car ahead that would narrow intervals most"),
    "verify": ("files", "check a snapshot against its own contents"),
    "report": ("files", "a snapshot as one self-contained web page"),
    "runs": ("files", "results of earlier runs, searched by words"),
    "download": ("recordings", "runs of the OpenACC database from their publisher"),
    "export": ("files", "parameters of a snapshot for other programs"),
    "app": ("app", "start the app in the browser"),
}
"""The module of each command, and its meaning.

The module has `NAME_OPTIONS`, `run_NAME(options)`, and for a longer help `NAME_HELP`.
"""

CONVENTIONS = (
    "Times are seconds from the recording's first sample. Vehicles are numbered as in the file,"
    " from 1, and the first one listed is the leader (in Python a follower is its place in arrays,"
    " from 0). Case I estimates one parameter set for all followers,"
    " Case II one for each. With --json standard output is one JSON document; progress goes to"
    " standard error. Results and checkpoints of trainings are kept in the user's cache folder, or"
    " in the folder that ACCPINN_CACHE names. Exit status: 0; 1 for a fault of data or files; 2 for"
    " wrong usage; 130 when interrupted, and the same call continues the training."
)


def main(arguments: Sequence[str] | None = None) -> int:
    """Run one command; returns the exit status."""
    open_streams()
    try:
        try:
            given = sys.argv[1:] if arguments is None else arguments
            options = _parser(given).parse_args(given)
            options.command_line = _command_line(given)
            return int(options.run(options))
        finally:
            flush()
    except AccpinnError as fault:
        print_error(str(fault))
        return 2 if isinstance(fault, ConfigError | ParameterError) else 1
    except BrokenPipeError:  # the reader, `head` say, has seen enough
        return 0
    except OSError as fault:  # files have sentences of their own; this is a stream that is full
        reason = (fault.strerror or "unknown").lower()
        print_error(f"{fault.filename or 'standard output'}: it cannot be written ({reason}).")
        return 1
    except KeyboardInterrupt:
        return 130


def _command_line(given: Sequence[str]) -> str:
    """The command as it stands in what it made, which may be published: of paths the names."""
    words = (Path(word).name if Path(word).is_absolute() else word for word in given)
    return " ".join(shlex.join(["accpinn", *words]).split())


def _parser(arguments: Sequence[str]) -> argparse.ArgumentParser:
    """The parser; only the commands among the arguments are imported, which takes seconds."""
    parser = _Parser(
        prog="python -m accpinn" if Path(sys.argv[0]).name == "__main__.py" else "accpinn",
        description="Learn the parameters of adaptive cruise control from OpenACC recordings.",
        epilog=fill(CONVENTIONS),
    )
    parser.add_argument("--version", action="version", version=f"accpinn {__version__}")
    subparsers = parser.add_subparsers(metavar="COMMAND", required=True)
    for name, (module, meaning) in COMMANDS.items():
        sentence = f"{meaning[0].upper()}{meaning[1:]}."
        command = subparsers.add_parser(
            name, help=meaning, description=sentence, epilog=fill(CONVENTIONS)
        )
        if name in arguments:
            home = import_module(f"accpinn.cli.{module}")
            for add in getattr(home, f"{name.upper()}_OPTIONS"):
                add(command)
            more = getattr(home, f"{name.upper()}_HELP", "")
            command.epilog = f"{more}\n\n{command.epilog}" if more else command.epilog
            command.set_defaults(run=getattr(home, f"run_{name}"))
    return parser


_NUMBERS = re.compile(r"-\.?\d[\d.,eE+-]*")


class _Parser(argparse.ArgumentParser):
    """Reports a fault in one line, and takes numbers that begin with a minus."""

    def __init__(self, **settings: object) -> None:
        """Take the settings of an `ArgumentParser`."""
        settings["formatter_class"] = argparse.RawDescriptionHelpFormatter
        super().__init__(**settings)  # type: ignore[arg-type]
        self._negative_number_matcher = _NUMBERS  # else -1,1,1 would be taken for an option

    def parse_known_args(self, *given: Any, **more: Any) -> Any:
        """Report unknown arguments by the command's own parser, which names its help."""
        options, unknown = super().parse_known_args(*given, **more)
        if unknown:
            self.error(f"unrecognized arguments: {' '.join(unknown)}")
        return options, unknown

    def error(self, message: str) -> NoReturn:
        """One line on standard error; exit status 2."""
        print_error(f"{message.removesuffix('.')}; see {self.prog} --help")
        raise SystemExit(2)

    def print_help(self, file: object = None) -> None:
        """Options and their meaning, on standard output."""
        show(self.format_help().rstrip())
