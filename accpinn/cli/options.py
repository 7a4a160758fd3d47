"""The options of commands that estimate, and the analysis that they choose."""

import argparse
from collections import Counter
from collections.abc import Callable, Iterable, Mapping
from textwrap import fill
from typing import Any

from accpinn.api import analyse
from accpinn.cli.recordings import JSON, RECORDING, chosen_recording, option
from accpinn.errors import ConfigError, SegmentError
from accpinn.methods.registry import COMPARED, METHODS, VARIANTS
from accpinn.model.registry import BEST, FOLLOWING, PAPER, following_model
from accpinn.recordings import Recording
from accpinn.segment.cut import DURATION, parse_vehicles, parse_windows
from accpinn.segment.quality import EXCLUDABLE, as_typed, parse_regimes
from accpinn.segment.windows import AUTO, disjoint_windows
from accpinn.study import Analysis
from accpinn.study.scripts import model_key
from accpinn.study.store import Store

ALL = "all"
"""The word for all methods or models, and for all complete windows of a recording."""


def _fixed(text: str) -> tuple[str, float]:
    name, _, value = text.partition("=")
    try:
        return name.strip(), float(value)
    except ValueError:
        raise argparse.ArgumentTypeError(
            f'"{text[:40]}" fixes nothing; write --fixed s0=4, once for each parameter.'
        ) from None


def _parsed(parse: Callable[[str], Any]) -> Callable[[str], Any]:
    """A parser whose errors argparse reports."""

    def parsed(text: str) -> Any:
        try:
            return parse(text)
        except SegmentError as fault:
            raise argparse.ArgumentTypeError(str(fault)) from None

    return parsed


def chosen_model(text: str) -> str:
    """The key of a model that is named by it, or by a script that registers it and is run.

    Raises:
        ConfigError: for an unknown key, or a script that fails.
    """
    return following_model(model_key(text)).key


CASE = option("--case", choices=["I", "II"], default="II", help="I: one set for all followers (II)")
SEGMENT = (
    *RECORDING,
    option("--start", type=float, metavar="S", help="of the window in s (0)"),
    option("--duration", type=float, metavar="S", help=f"in s ({DURATION:g})"),
    option("--vehicles", type=_parsed(parse_vehicles), metavar="1-5 | 1,2",
           help="leader first (the longest run of recorded vehicles from the first on)"),
    option("--exclude", "--leave-out", dest="exclude", type=_parsed(parse_regimes), default=(),
           metavar="REGIME,..", help="regimes to leave out from the model's equation:"
           f" {', '.join(map(as_typed, EXCLUDABLE))}"),
    CASE,
)  # fmt: skip
"""Options that choose data, the same for every command that estimates."""
WINDOWS = option(
    "--windows",
    type=_parsed(lambda text: text if text in (ALL, AUTO) else parse_windows(text)),
    metavar="auto | 0-300,600-900 | all",
    help="several windows in place of one; auto: all in car-following under ACC; all: complete"
    " stretches in pieces of --duration",
)
MODEL = (
    option("--model", type=chosen_model, metavar="NAME",
           help=f"({BEST}; {PAPER} for a method without intervals): {', '.join(FOLLOWING)}; or a"
           " script ending in .py that registers one"),
    option("--fixed", "--hold", dest="fixed", type=_fixed, action="append", default=[],
           metavar="NAME=VALUE", help="a parameter of the model that keeps its value, as s0=4"),
)  # fmt: skip
THREADS = option("--threads", type=int, metavar="N", help="most processor threads for training")
MAPPING = option("--mapping", metavar="JSON", help="columns, units and sample time of other tables")
DASK = (
    option("--workers", type=int, metavar="N", help="processes on this machine (one a processor)"),
    option("--scheduler", metavar="URL", help="of dask, as tls://host:8786, in their place"),
    MAPPING,
)
"""Where many recordings are worked on, and how they are read."""
RUN = (
    THREADS,
    option("--no-cache", action="store_true", help="neither read nor store results"),
    JSON,
)
"""Options of running an estimation and of printing the result."""
METHODS_HELP = "\n".join(
    ["methods:", *(f"  {key:<16} {method.summary}" for key, method in METHODS.items())]
)
VARIANTS_HELP = "\n\n".join(
    [METHODS_HELP, fill(f"Of --methods: {', '.join(VARIANTS)}. All are {', '.join(COMPARED)}.")]
)


def named_keys(text: str, every: Iterable[str], of: Callable[[str], str]) -> tuple[str, ...]:
    """Keys that a text as "all" or "a,b" names, each once; ``of`` refuses unknown ones."""
    keys = every if text == ALL else (part.strip() for part in text.split(","))
    return tuple(dict.fromkeys(map(of, keys)))


def chosen_analysis(
    options: argparse.Namespace,
    method: str | None = None,
    preset: str | None = None,
    settings: Mapping[str, Any] | None = None,
) -> tuple[Analysis, Recording]:
    """The analysis that the options name, and its recording.

    Raises:
        ConfigError: for options that contradict each other.
        SegmentError: where --windows finds none.
    """
    fixed = getattr(options, "fixed", ())
    if twice := [name for name, count in Counter(name for name, _ in fixed).items() if count > 1]:
        raise ConfigError(f"fixed: {twice[0]} is given twice; give it once.")
    recording = chosen_recording(options)
    windows, duration = getattr(options, "windows", None), options.duration
    if windows == ALL:
        longest, duration = DURATION if duration is None else duration, None
        windows = disjoint_windows(recording, longest, options.vehicles)
        if not windows:
            raise SegmentError(
                f"{recording.source}: --windows {ALL} finds no window of {longest:g} s without"
                " missing samples; choose a shorter --duration."
            )
    analysis = analyse(
        recording, options.start, duration, options.vehicles, windows=windows, case=options.case,
        model=getattr(options, "model", None), fixed=dict(fixed), method=method, preset=preset,
        settings=settings, exclude=options.exclude,
    )  # fmt: skip
    return analysis, recording


def chosen_store(options: argparse.Namespace) -> Store | None:
    """The store of results; None with --no-cache."""
    return None if options.no_cache else Store()
