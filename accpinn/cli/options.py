"""Options that several commands share, and what they choose: a segment, or parameter sets."""

import argparse
from collections.abc import Callable
from typing import Any

from accpinn.channels import PARAMETERS
from accpinn.errors import ConfigError, SegmentError
from accpinn.methods.method import TaskContext
from accpinn.methods.store import Store
from accpinn.model.cthp import Parameters
from accpinn.recordings.openacc import read
from accpinn.recordings.recording import Recording
from accpinn.segment.cut import DURATION, cut
from accpinn.segment.regimes import (
    EXCLUDABLE,
    as_typed,
    exclude_regimes,
    label_regimes,
    parse_regimes,
)
from accpinn.segment.segment import Segment
from accpinn.segment.vehicles import parse_vehicles

PARAMETER_NAMES = ("alpha", "beta", "tau")


def add_segment_options(parser: argparse.ArgumentParser) -> None:
    """Declare the options that choose data, the same for every command that estimates."""
    parser.add_argument("file", metavar="FILE", help="an OpenACC recording (CSV)")
    parser.add_argument("--start", type=float, default=0.0, metavar="S", help="window start in s")
    parser.add_argument(
        "--duration", type=float, default=DURATION, metavar="S", help="window length in s"
    )
    parser.add_argument(
        "--vehicles",
        type=_parsed(parse_vehicles),
        metavar="1-5 | 1,2",
        help="leader first; default: the longest run of vehicles that starts at the first",
    )
    parser.add_argument(
        "--leave-out",
        type=_parsed(parse_regimes),
        default=(),
        metavar="REGIME,..",
        help="regimes whose instants do not count in the model's equation:"
        f" {', '.join(map(as_typed, EXCLUDABLE))}",
    )
    parser.add_argument("--case", choices=["I", "II"], default="II", help="I: one set for all (II)")


def add_run_options(parser: argparse.ArgumentParser) -> None:
    """Declare how estimations run and how the result is printed."""
    parser.add_argument("--threads", type=int, metavar="N", help="processor threads for training")
    parser.add_argument("--no-cache", action="store_true", help="neither read nor keep results")
    parser.add_argument("--json", action="store_true", help="one JSON document")


def add_parameter_options(parser: argparse.ArgumentParser) -> None:
    """Declare α, β, τ with one value a vehicle, first follower first; or a snapshot."""
    for name, parameter in zip(PARAMETER_NAMES, PARAMETERS, strict=True):
        parser.add_argument(
            f"--{name}",
            type=float,
            nargs="+",
            metavar=name[0].upper(),
            help=f"{parameter.symbol} in {parameter.unit}, one value a vehicle",
        )
    parser.add_argument(
        "--snapshot", metavar="FILE", help="take the estimated parameters of a snapshot instead"
    )
    parser.add_argument("--json", action="store_true", help="one JSON document")


def _parsed(parse: Callable[[str], Any]) -> Callable[[str], Any]:
    """A parser of texts as argparse wants it."""

    def parsed(text: str) -> Any:
        try:
            return parse(text)
        except SegmentError as fault:
            raise argparse.ArgumentTypeError(str(fault)) from None

    return parsed


def chosen_segment(options: argparse.Namespace) -> tuple[Recording, Segment]:
    """The recording and the segment that the options name."""
    recording = read(options.file)
    segment = cut(recording, options.start, options.duration, options.vehicles)
    if options.leave_out:
        regimes = label_regimes(segment, recording)
        segment = exclude_regimes(segment, regimes, options.leave_out)
    return recording, segment


def chosen_context(options: argparse.Namespace) -> TaskContext:
    """Store and threads as the options have them."""
    return TaskContext(None if options.no_cache else Store(), options.threads)


def chosen_parameters(options: argparse.Namespace) -> Parameters:
    """The parameter sets (V,) that the options give.

    Raises:
        ConfigError: when they are missing, given twice, or differ in number.
        SnapshotError: when the snapshot cannot be read.
    """
    values = {name: getattr(options, name) for name in PARAMETER_NAMES if getattr(options, name)}
    if options.snapshot:
        if values:
            raise ConfigError(f"parameters: give --{next(iter(values))} or --snapshot, not both.")
        from accpinn.results.snapshot.file import load  # not needed for numbers given by hand

        return load(options.snapshot).fit.parameters
    missing = [f"--{name}" for name in PARAMETER_NAMES if name not in values]
    if missing:
        listed = " and ".join(missing)
        raise ConfigError(f"parameters: {listed} missing; give all three, or --snapshot FILE.")
    counts = {name: len(given) for name, given in values.items()}
    if len(set(counts.values())) > 1:
        listed = ", ".join(f"{count} of --{name}" for name, count in counts.items())
        raise ConfigError(f"parameters: {listed}; give as many of each as there are vehicles.")
    return Parameters(*values.values())


def describe_segment(segment: Segment) -> dict[str, Any]:
    """Which data a result rests on, as the command-line contract has it."""
    info = segment.info
    return {
        "source": info.source,
        "start": info.window.start,
        "duration": info.window.duration,
        "samples": info.samples,
        "vehicles": list(info.vehicles),
        "names": list(info.names),
        "left_out": {"regimes": list(info.excluded_regimes), "share": list(info.excluded_share)},
    }


def describe_parameters(segment: Segment, parameters: Parameters | None) -> list[dict[str, Any]]:
    """One entry a follower, as the command-line contract has it; none without parameters."""
    if parameters is None:
        return []
    rows = zip(segment.vehicles[1:], segment.names[1:], parameters.values.tolist(), strict=True)
    return [
        {"vehicle": vehicle, "name": name, **dict(zip(PARAMETER_NAMES, row, strict=True))}
        for vehicle, name, row in rows
    ]
