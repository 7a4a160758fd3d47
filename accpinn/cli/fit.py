"""`fit FILE`: learn the parameters of a window of a recording."""

import argparse
import signal
import sys
from dataclasses import replace
from pathlib import Path
from types import FrameType
from typing import Any

from tqdm import tqdm

from accpinn.cli.output import one_line, print_json, show, table
from accpinn.errors import ConfigError, SegmentError
from accpinn.evaluation.closed_loop import closed_loop, closed_loop_errors, incidents
from accpinn.evaluation.errors import surrogate_errors
from accpinn.methods.fit import Fit, Outcome, Progress
from accpinn.methods.pinn.config import PinnConfig, preset
from accpinn.methods.registry import METHODS
from accpinn.methods.store import Store
from accpinn.model.cthp import Parameters
from accpinn.recordings.openacc import read
from accpinn.recordings.recording import Recording
from accpinn.results.snapshot.create import check_texts, create
from accpinn.results.snapshot.file import save
from accpinn.results.snapshot.writable_path import SNAPSHOT, free_place
from accpinn.segment.cut import DURATION, cut
from accpinn.segment.quality import Quality, assess_quality
from accpinn.segment.regimes import EXCLUDABLE, as_typed, exclude_regimes, parse_regimes
from accpinn.segment.regimes import label_regimes as label_regimes
from accpinn.segment.segment import Segment
from accpinn.segment.vehicles import parse_vehicles

_OF_THE_PINN = ("preset", "initial", "iterations", "lbfgs", "seed", "threads")


def add_options(parser: argparse.ArgumentParser) -> None:
    """Declare the command's options."""
    add_segment_options(parser)
    parser.add_argument("--method", choices=list(METHODS), default="pinn")
    parser.add_argument("--preset", choices=["fast", "paper"], help="(fast)")
    parser.add_argument("--initial", metavar="A,B,T", help="α,β,τ to start from (1,1,1)")
    parser.add_argument("--iterations", type=int, metavar="N", help="at most so many")
    parser.add_argument("--lbfgs", type=int, metavar="N", help="paper: L-BFGS iterations, last")
    parser.add_argument("--seed", type=int, metavar="N", help="of the PiNN (0)")
    parser.add_argument("--threads", type=int, metavar="N", help="processor threads for training")
    parser.add_argument("--no-cache", action="store_true", help="neither read nor keep results")
    parser.add_argument("--out", metavar="SNAPSHOT", help="keep all of it in this file")
    parser.add_argument("--with-data", action="store_true", help="speeds and gaps in it too")
    parser.add_argument("--name", default="", help="of the snapshot")
    parser.add_argument("--note", default="", help="in the snapshot")
    parser.add_argument("--json", action="store_true", help="one JSON document")
    parser.set_defaults(run=run)


def add_segment_options(parser: argparse.ArgumentParser) -> None:
    """The options that choose data, the same for every command that estimates."""
    parser.add_argument("file", metavar="FILE", help="an OpenACC recording (CSV)")
    parser.add_argument("--start", type=float, default=0.0, metavar="S", help="window start in s")
    parser.add_argument(
        "--duration", type=float, default=DURATION, metavar="S", help="window length in s"
    )
    parser.add_argument(
        "--vehicles",
        type=_vehicles,
        metavar="1-5 | 1,2",
        help="leader first; default: all it can",
    )
    parser.add_argument(
        "--leave-out",
        type=_regimes,
        default=(),
        metavar="REGIME,..",
        help=f"what does not count for the law: {', '.join(map(as_typed, EXCLUDABLE))}",
    )
    parser.add_argument("--case", choices=["I", "II"], default="II", help="I: one set for all")


def chosen_segment(options: argparse.Namespace) -> tuple[Recording, Segment]:
    """The recording and the segment that the options name."""
    recording = read(options.file)
    segment = cut(recording, options.start, options.duration, options.vehicles)
    if options.leave_out:
        segment = exclude_regimes(segment, label_regimes(segment, recording), options.leave_out)
    return recording, segment


def _regimes(text: str) -> tuple[str, ...]:
    try:
        return parse_regimes(text)
    except SegmentError as fault:
        raise argparse.ArgumentTypeError(str(fault)) from None


def _vehicles(text: str) -> tuple[int, ...]:
    try:
        return parse_vehicles(text)
    except SegmentError as fault:
        raise argparse.ArgumentTypeError(str(fault)) from None


def run(options: argparse.Namespace) -> int:
    """Learn, and print what was learned."""
    config = _config(options)
    if options.out:  # training takes long; what would spoil its keeping is said first
        check_texts(options.name, options.note)
        free_place(Path(options.out), SNAPSHOT)
    recording, segment = chosen_segment(options)
    if options.method == "pinn":
        fit = _train(segment, options, config)
    else:
        fit = METHODS[options.method].fit(segment, options.case)
    quality = assess_quality(segment)
    if options.json:
        print_json(describe(segment, fit, quality))
    else:
        show(_text(segment, fit, quality))
    if options.out:
        _keep(recording, segment, fit, options)
    return 130 if fit.outcome is Outcome.STOPPED else 0


def _keep(recording: Recording, segment: Segment, fit: Fit, options: argparse.Namespace) -> None:
    snapshot = create(
        segment,
        fit,
        recording=recording,
        name=options.name,
        note=options.note,
        with_data=options.with_data,
    )
    print(one_line(f"Saved as {save(snapshot, options.out)}."), file=sys.stderr)


def _config(options: argparse.Namespace) -> PinnConfig:
    if options.method != "pinn":
        idle = [f"--{name}" for name in _OF_THE_PINN if getattr(options, name) is not None]
        if idle:
            said = f"Note: {', '.join(idle)} has no effect, as only the PiNN has such a setting."
            print(said, file=sys.stderr)
    config = preset(options.preset or "fast", seed=options.seed or 0)
    if options.initial is not None:
        config = replace(config, initial=_three_numbers(options.initial))
    if options.iterations is not None:
        config = replace(config, iterations=options.iterations)
    if options.lbfgs is not None:
        config = replace(config, lbfgs_iterations=options.lbfgs)
    return config


def _three_numbers(text: str) -> tuple[float, float, float]:
    try:
        alpha, beta, tau = (float(part) for part in text.split(","))
    except ValueError:
        raise ConfigError(
            f'initial: "{text[:40]}" is not α,β,τ; write three numbers as 1,1,1.'
        ) from None
    return alpha, beta, tau


def _train(segment: Segment, options: argparse.Namespace, config: PinnConfig) -> Fit:
    from accpinn.methods.pinn.training import train  # torch takes a second to import

    store = None if options.no_cache else Store()
    with _Interrupt() as interrupted, _ProgressBar() as bar:
        return train(
            segment,
            options.case,
            config,
            store=store,
            on_progress=bar.show,
            should_stop=lambda: interrupted.raised,
            threads=options.threads,
        )


_STOPS = (signal.SIGINT, signal.SIGTERM)


class _Interrupt:
    """Ctrl+C or a polite kill: training stops and keeps a checkpoint; a second one ends at once."""

    raised = False

    def __enter__(self) -> "_Interrupt":
        self._before = {kind: signal.signal(kind, self._note) for kind in _STOPS}
        return self

    def __exit__(self, *_: object) -> None:
        for kind, before in self._before.items():
            signal.signal(kind, before)

    def _note(self, _signal: int, _frame: FrameType | None) -> None:
        if self.raised:
            raise KeyboardInterrupt
        self.raised = True


class _ProgressBar:
    """On standard error; shows iterations, time left, Ψ and the first follower's parameters."""

    def __init__(self) -> None:
        self._bar: tqdm[Any] | None = None

    def __enter__(self) -> "_ProgressBar":
        return self

    def __exit__(self, *_: object) -> None:
        if self._bar:
            self._bar.close()

    def show(self, progress: Progress) -> None:
        if self._bar is None:
            self._bar = tqdm(
                total=progress.iterations,
                initial=progress.iteration,
                unit="it",
                file=sys.stderr,
                mininterval=0.2,
            )
        alpha, beta, tau = progress.parameters[0]
        self._bar.set_postfix_str(
            f"Ψ={progress.total:.3g} α={alpha:.4f} β={beta:.4f} τ={tau:.3f}", refresh=False
        )
        self._bar.update(progress.iteration - self._bar.n)


def describe(segment: Segment, fit: Fit, quality: Quality) -> dict[str, Any]:
    """The result as the command-line contract has it."""
    surrogate, driven = surrogate_errors(segment, fit), closed_loop_errors(segment, fit)

    return {
        "method": fit.method,
        "case": fit.case,
        "preset": fit.config.get("preset"),
        "seed": fit.config.get("seed"),
        "segment": describe_segment(segment),
        "parameters": parameter_rows(segment, fit.parameters),
        "unconstrained": parameter_rows(segment, fit.unconstrained),
        "active_bounds": [list(names) for names in fit.active_bounds],
        "mae": None
        if surrogate is None
        else {"v": surrogate.speed_mae.tolist(), "p": surrogate.gap_mae.tolist()},
        "closed_loop_mae": None
        if driven is None
        else {"v": driven.speed_mae.tolist(), "p": driven.gap_mae.tolist()},
        "incidents": list(incidents(segment, closed_loop(segment, fit))),
        "mean_time_gap": list(quality.mean_time_gap),
        "loss": fit.loss,
        "network_weights": fit.network_weights,
        "iterations": fit.iterations,
        "seconds": fit.seconds,
        "cached": fit.cached,
        "outcome": fit.outcome.name.lower(),
        "outcome_sentence": fit.outcome.value,
        "notes": [*segment.notes, *quality.warnings, *fit.notes],
    }


def describe_segment(segment: Segment) -> dict[str, Any]:
    """Which data a result rests on."""
    return {
        "source": segment.source,
        "start": segment.start,
        "duration": segment.window.duration,
        "samples": segment.samples,
        "vehicles": list(segment.vehicles),
        "names": list(segment.names),
        "left_out": {
            "regimes": list(segment.excluded_regimes),
            "share": list(segment.info.excluded_share),
        },
    }


def parameter_rows(segment: Segment, parameters: Parameters | None) -> list[dict[str, Any]]:
    """One entry a follower."""
    if parameters is None:
        return []
    rows = zip(segment.vehicles[1:], segment.names[1:], parameters, strict=True)
    return [
        {"vehicle": vehicle, "name": name, "alpha": p.alpha, "beta": p.beta, "tau": p.tau}
        for vehicle, name, p in rows
    ]


def _text(segment: Segment, fit: Fit, quality: Quality) -> str:
    surrogate, driven = surrogate_errors(segment, fit), closed_loop_errors(segment, fit)
    rows = []
    for k, (label, p) in enumerate(zip(segment.labels[1:], fit.parameters, strict=True)):
        rows.append(
            [
                label,
                f"{p.alpha:.4f}",
                f"{p.beta:.4f}",
                f"{p.tau:.3f}",
                f"{quality.mean_time_gap[k]:.2f}",
                f"{surrogate.gap_mae[k]:.3f}" if surrogate else "-",
                f"{driven.gap_mae[k]:.2f}" if driven else "-",
            ]
        )
    head = ["vehicle", "α (1/s²)", "β (1/s)", "τ (s)", "mean time gap (s)"]
    head += ["gap MAE, surrogate (m)", "gap MAE, closed loop (m)"]
    window = f"{segment.window}"
    about = f"{segment.source}, {window}, {fit.method}, Case {fit.case}"
    effort = f"{fit.iterations} iterations in {fit.seconds:.1f} s" + (
        ", answered from the cache" if fit.cached else ""
    )
    said = [f"{fit.outcome.value} ({effort})", *incidents(segment, closed_loop(segment, fit))]
    notes = [f"Note: {note}" for note in (*segment.notes, *quality.warnings, *fit.notes)]
    return "\n".join([about, "", table(head, rows), "", *said, *notes])
