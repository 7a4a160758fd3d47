"""The parser of the command line: a fault in one line, and numbers that may begin with a minus."""

import argparse
import re
from typing import NoReturn

from accpinn.cli.output import complain, show

_NUMBERS = re.compile(r"-\.?\d[\d.,eE+-]*")


class Parser(argparse.ArgumentParser):
    """An `ArgumentParser` that reports as the rest of the command line does."""

    def __init__(self, **settings: object) -> None:
        """With the settings of an `ArgumentParser`."""
        super().__init__(**settings)  # type: ignore[arg-type]
        self._negative_number_matcher = _NUMBERS  # else -1,1,1 would be taken for an option

    def error(self, message: str) -> NoReturn:
        """One line on standard error; exit status 2."""
        complain(f"{message}; see {self.prog} --help")
        raise SystemExit(2)

    def print_help(self, file: object = None) -> None:
        """Options and their meaning, on standard output."""
        show(self.format_help().rstrip())
