"""The options of commands that estimate, what they choose, and parts of their documents."""

import argparse
from collections.abc import Callable, Iterable, Sequence
from typing import Any

import numpy as np

from accpinn.channels import by_key
from accpinn.cli.recording import add_json_option, add_recording, chosen_recording
from accpinn.errors import SegmentError
from accpinn.evaluation.closed_loop import TrackingErrors, closed_loop, closed_loop_findings
from accpinn.inference.intervals import Uncertainty
from accpinn.methods.fit import Fit
from accpinn.model.cthp import Parameters
from accpinn.model.models import BEST, PAPER, terms_of
from accpinn.model.registry import FOLLOWING
from accpinn.recordings.recording import Recording, Window
from accpinn.results.messages import messages
from accpinn.segment.cut import DURATION, parse_vehicles, parse_windows
from accpinn.segment.quality import EXCLUDABLE, as_typed, parse_regimes
from accpinn.segment.segment import Segment
from accpinn.study.analysis import Analysis, single_window
from accpinn.study.plan import AUTO
from accpinn.study.store import Store


def add_segment_options(parser: argparse.ArgumentParser) -> None:
    """Declare the options that choose data, the same for every command that estimates."""
    add_recording(parser)
    option = parser.add_argument
    option("--start", type=float, default=0.0, metavar="S", help="of the window in s (0)")
    option("--duration", type=float, default=DURATION, metavar="S", help=f"in s ({DURATION:g})")
    option(
        "--vehicles",
        type=_parsed(parse_vehicles),
        metavar="1-5 | 1,2",
        help="leader first (the longest run of recorded vehicles from the first on)",
    )
    option(
        "--leave-out",
        type=_parsed(parse_regimes),
        default=(),
        metavar="REGIME,..",
        help="regimes to exclude from the model's equation:"
        f" {', '.join(map(as_typed, EXCLUDABLE))}",
    )
    option("--case", choices=["I", "II"], default="II", help="I: one set for all followers (II)")


def add_windows_option(parser: argparse.ArgumentParser) -> None:
    """Declare that several windows may share one estimate."""
    parser.add_argument(
        "--windows",
        type=_parsed(lambda text: text if text in ("all", AUTO) else parse_windows(text)),
        metavar="auto | 0-300,600-900 | all",
        help="several windows in place of one; auto: all in car-following under ACC; all: complete"
        " stretches in pieces of --duration",
    )


def add_model_options(
    parser: argparse.ArgumentParser, models: Iterable[str] = tuple(FOLLOWING)
) -> None:
    """Declare the model of answer and fit."""
    parser.add_argument(
        "--model", choices=list(models), metavar="NAME",
        help=f"of the answer ({BEST}), and of the fit where its method can estimate it ({PAPER}):"
        f" {', '.join(models)}",
    )  # fmt: skip
    parser.add_argument(
        "--hold", type=_held, action="append", default=[], metavar="NAME=VALUE",
        help="a term of the model that keeps its value, as s0=4",
    )  # fmt: skip


def _held(text: str) -> tuple[str, float]:
    name, _, value = text.partition("=")
    try:
        return name.strip(), float(value)
    except ValueError:
        raise argparse.ArgumentTypeError(
            f'"{text[:40]}" holds nothing; write a name and a number as s0=4.'
        ) from None


def add_run_options(parser: argparse.ArgumentParser) -> None:
    """Declare how estimations run and how the result is printed."""
    parser.add_argument("--threads", type=int, metavar="N", help="processor threads for training")
    parser.add_argument("--no-cache", action="store_true", help="neither read nor store results")
    add_json_option(parser)


def _parsed(parse: Callable[[str], Any]) -> Callable[[str], Any]:
    """A parser of texts as argparse wants it."""

    def parsed(text: str) -> Any:
        try:
            return parse(text)
        except SegmentError as fault:
            raise argparse.ArgumentTypeError(str(fault)) from None

    return parsed


def chosen_analysis(
    options: argparse.Namespace,
    method: str = "pinn",
    settings: Any = None,
    windows: Callable[[Recording], Sequence[Window]] | None = None,
) -> tuple[Analysis, Recording]:
    """The analysis that the options name, and its recording; ``windows`` chooses several."""
    recording = chosen_recording(options)
    asked = Analysis.of(
        recording,
        windows(recording) if windows else single_window(options.start, options.duration),
        options.vehicles,
        case=options.case,
        excluded=options.leave_out,
        model=getattr(options, "model", None),
        held=dict(getattr(options, "hold", ())),
        method=method,
        settings=settings,
    )
    return asked, recording


def chosen_store(options: argparse.Namespace) -> Store | None:
    """Where results are kept; None where the options want none."""
    return None if options.no_cache else Store()


def describe_segment(segment: Segment) -> dict[str, Any]:
    """Which data a result rests on, as the command-line contract has it."""
    info = segment.info
    return {
        **fields(info.window, "start", "duration"),
        **fields(info, "source", "samples", "vehicles", "names"),
        "left_out": {"regimes": info.excluded_regimes, "share": info.excluded_share},
    }


def of_followers(segment: Segment, rows: Iterable[Iterable[Any]]) -> list[dict[str, Any]]:
    """One entry a follower: its number and name, and a row's values for α, β and τ."""
    named = zip(segment.vehicles[1:], segment.names[1:], rows, strict=True)
    return [{"vehicle": vehicle, "name": name, **by_key(row)} for vehicle, name, row in named]


def describe_parameters(
    segment: Segment, parameters: Parameters | None, model: str = PAPER
) -> list[dict[str, Any]]:
    """One entry a follower, as the command-line contract has it; none without parameters.

    A model that is no CTHP has its own parameters, and α, β and τ of its linearisation.
    """
    if parameters is None:
        return []
    named = further_values(parameters, model)
    rows = of_followers(segment, parameters.values.tolist())
    return [row | {name: values[k] for name, values in named.items()} for k, row in enumerate(rows)]


def describe_intervals(
    segment: Segment, uncertainty: Uncertainty, model: str = PAPER
) -> list[dict[str, Any]]:
    """Both ends of the parameters and of what follows from them, one entry a follower."""
    gains = {name: getattr(uncertainty, name) for name in ("peak_gain", "linf_gain", "crossover")}
    ends = np.stack([uncertainty.lower.values, uncertainty.upper.values], axis=-1).tolist()
    low, high = (further_values(part, model) for part in (uncertainty.lower, uncertainty.upper))
    return [
        {
            **row,
            **{name: [low[name][k], high[name][k]] for name in low},
            "probability_l2": uncertainty.probability_l2[k],
            "probability_linf": uncertainty.probability_linf[k],
            **{name: [gain.lower[k], gain.upper[k]] for name, gain in gains.items()},
        }
        for k, row in enumerate(of_followers(segment, ends))
    ]


def further_values(parameters: Parameters, model: str) -> dict[str, list[float]]:
    """The parameters of a model beside α, β and τ, by name, a value a follower."""
    if parameters.own.shape[-1]:
        return dict(zip(FOLLOWING[model].names, parameters.own.T.tolist(), strict=True))
    return {term: getattr(parameters, term).tolist() for term in terms_of(model)}


def incidents(segment: Segment, fit: Fit) -> tuple[str, ...]:
    """Sentences on collisions, reversing and divergence in the closed-loop simulation."""
    return messages(closed_loop_findings(segment, closed_loop(segment, fit)), segment)


def describe_errors(errors: TrackingErrors | None) -> dict[str, list[float]] | None:
    """Mean absolute errors of speeds (M+1) in m/s and gaps (M) in m."""
    return (
        None if errors is None else {"v": errors.speed_mae.tolist(), "p": errors.gap_mae.tolist()}
    )


def fields(of: object, *names: str) -> dict[str, Any]:
    """Those attributes of an object under their own names, arrays as lists."""
    values = {name: getattr(of, name) for name in names}
    return {
        name: value.tolist() if isinstance(value, np.ndarray) else value
        for name, value in values.items()
    }
