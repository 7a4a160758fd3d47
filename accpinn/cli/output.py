"""Output of the command line: one JSON document, tables, or one line `error: …`.

No text of a file controls the terminal: characters that would steer it, or turn the direction of
writing, are printed as their numbers.
"""

import argparse
import json
import os
import signal
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from io import TextIOWrapper
from threading import Event
from typing import Any

SPACES = "\u00a0\u2009\u202f"
"""Spaces that Python calls unprintable and a terminal prints."""


def open_streams() -> None:
    """Set both streams to UTF-8 on every platform; closed ones discard their output."""
    for name in ("stdout", "stderr"):
        stream = getattr(sys, name)
        if stream is None:
            setattr(sys, name, open(os.devnull, "w", encoding="utf-8"))
        elif isinstance(stream, TextIOWrapper):  # a pipe on Windows has no α, β, τ otherwise
            stream.reconfigure(encoding="utf-8", errors="backslashreplace")


def flush() -> None:
    """Write buffered output.

    A stream that fails discards its output from then on; Python would try again at its end.

    Raises:
        OSError: when it cannot be written.
    """
    for stream in (sys.stdout, sys.stderr):
        try:
            stream.flush()
        except OSError:
            with suppress(OSError):  # not every stream is a file
                os.dup2(os.open(os.devnull, os.O_WRONLY), stream.fileno())
            raise


def show_result(
    options: argparse.Namespace, document: Callable[[], dict[str, Any]], text: Callable[[], str]
) -> None:
    """Print the result of a command: with --json the document of the contract, else the text."""
    if options.json:
        print_json(document())
    else:
        show(text())


def show(text: str) -> None:
    """Print a result."""
    print("\n".join(map(one_line, text.split("\n"))))


def print_error(sentence: str) -> None:
    """Print a fault as one line on standard error."""
    with suppress(OSError):  # no stream is left to report it on
        print(f"error: {one_line(sentence)}", file=sys.stderr)


def note(sentence: str) -> None:
    """Print a remark on a result as one line on standard error."""
    print(one_line(sentence), file=sys.stderr, flush=True)


def progress(sentence: str) -> None:
    """Print a step of the work as one line on standard error, where that is a terminal."""
    if sys.stderr.isatty():
        note(sentence)


def one_line(text: str) -> str:
    r"""A text with unprintable characters as numbers, \u001b, which JSON reads as the same text."""
    return "".join(c if c.isprintable() or c in SPACES else json.dumps(c)[1:-1] for c in text)


def print_json(document: dict[str, Any]) -> None:
    """Print one document on standard output; nan and infinities become null."""
    plain = json.loads(json.dumps(document), parse_constant=lambda _: None)
    show(json.dumps(plain, ensure_ascii=False, indent=2))


@contextmanager
def interruptible() -> Iterator[Event]:
    """Ctrl+C or a polite kill sets the event, at which training stops and keeps a checkpoint.

    A second one ends at once.
    """
    stopped = Event()

    def request(*_: object) -> None:
        if stopped.is_set():
            raise KeyboardInterrupt
        stopped.set()

    before = {kind: signal.signal(kind, request) for kind in (signal.SIGINT, signal.SIGTERM)}
    try:
        yield stopped
    finally:
        for kind, handler in before.items():
            signal.signal(kind, handler)
