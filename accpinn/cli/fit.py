"""`fit FILE`: estimate the parameters of a window of a recording."""

import argparse
import signal
import sys
from dataclasses import replace
from pathlib import Path
from types import FrameType
from typing import Any

from tqdm import tqdm

from accpinn.cli.options import (
    add_method_help,
    add_run_options,
    add_segment_options,
    chosen_context,
    chosen_segment,
    describe_errors,
    describe_parameters,
    describe_segment,
    fields,
)
from accpinn.cli.output import one_line, print_json, show
from accpinn.errors import ConfigError
from accpinn.evaluation.closed_loop import (
    closed_loop,
    closed_loop_errors,
    closed_loop_findings,
    surrogate_errors,
)
from accpinn.methods.fit import Fit, Outcome, Progress
from accpinn.methods.pinn.config import PinnConfig, preset
from accpinn.methods.registry import METHODS
from accpinn.model.cthp import Parameters
from accpinn.recordings.recording import Recording
from accpinn.results.messages import messages
from accpinn.results.messages.methods import outcome_message
from accpinn.results.snapshot.create import check_texts, create
from accpinn.results.snapshot.file import save, writable_path
from accpinn.results.tables.estimates import parameter_table
from accpinn.segment.quality import Quality, assess_quality
from accpinn.segment.segment import Segment

_SETTINGS = ("preset", "initial", "iterations", "lbfgs", "seed", "threads")
"""Options that only a method with settings has."""


def add_options(parser: argparse.ArgumentParser) -> None:
    """Declare the command's options."""
    add_segment_options(parser)
    add_method_help(parser)
    option = parser.add_argument
    option("--method", choices=list(METHODS), default="pinn", metavar="NAME", help="(pinn)")
    option("--preset", choices=["fast", "paper"], help="of the PiNN: seconds, or minutes (fast)")
    option("--initial", metavar="A,B,T", help="α,β,τ to start from (1,1,1)")
    option("--iterations", type=int, metavar="N", help="of the PiNN, at most")
    option("--lbfgs", type=int, metavar="N", help="L-BFGS iterations that end the paper preset")
    option("--seed", type=int, metavar="N", help="of the PiNN's random numbers (0)")
    add_run_options(parser)
    option("--out", metavar="SNAPSHOT", help="save the result in this file")
    option("--with-data", action="store_true", help="speeds and gaps in the snapshot, too")
    option("--name", default="", help="of the snapshot")
    option("--note", default="", help="in the snapshot")
    parser.set_defaults(run=run)


def run(options: argparse.Namespace) -> int:
    """Estimate, and print the result; 130 when a training was interrupted."""
    settings = _settings(options)
    if options.out:  # training takes long; what would spoil its keeping is said first
        check_texts(options.name, options.note)
        writable_path(Path(options.out), "snapshot")
    recording, segment = chosen_segment(options)
    with _Interrupt() as interrupted, _ProgressBar() as bar:
        context = replace(
            chosen_context(options),
            on_progress=bar.show,
            should_stop=lambda: interrupted.raised,
        )
        fit = METHODS[options.method].fit(segment, options.case, settings, context)
    quality = assess_quality(segment)
    if options.json:
        print_json(describe(segment, fit, quality))
    else:
        show(_text(segment, fit, quality))
    if options.out:
        _keep(recording, segment, fit, options)
    return 130 if fit.outcome is Outcome.STOPPED else 0


def _keep(recording: Recording, segment: Segment, fit: Fit, options: argparse.Namespace) -> None:
    about = {name: getattr(options, name) for name in ("name", "note", "with_data")}
    snapshot = create(segment, fit, recording=recording, **about)
    print(one_line(f"Saved as {save(snapshot, options.out)}."), file=sys.stderr)


def _settings(options: argparse.Namespace) -> PinnConfig | None:
    """The PiNN's settings; checked for any method, used by a method that has settings."""
    given = {
        "initial": options.initial and _three_numbers(options.initial),
        "iterations": options.iterations,
        "lbfgs_iterations": options.lbfgs,
        "seed": options.seed,
    }
    changes = {name: value for name, value in given.items() if value is not None}
    settings = preset(options.preset or "fast", **changes)
    if METHODS[options.method].settings:
        return settings
    idle = [f"--{name}" for name in _SETTINGS if getattr(options, name) is not None]
    if idle:
        note = f"Note: {', '.join(idle)} has no effect: only the PiNN has such a setting."
        print(note, file=sys.stderr)
    return None


def _three_numbers(text: str) -> Parameters:
    try:
        alpha, beta, tau = (float(part) for part in text.split(","))
    except ValueError:
        raise ConfigError(
            f'initial: "{text[:40]}" is not α,β,τ; write three numbers as 1,1,1.'
        ) from None
    return Parameters(alpha, beta, tau)


class _Interrupt:
    """Ctrl+C or a polite kill: training stops and keeps a checkpoint; a second one ends at once."""

    raised = False
    _kinds = (signal.SIGINT, signal.SIGTERM)

    def __enter__(self) -> "_Interrupt":
        self._before = {kind: signal.signal(kind, self._note) for kind in self._kinds}
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
        first = progress.parameters[0]
        self._bar.set_postfix_str(
            f"Ψ={progress.total:.3g} α={first.alpha:.4f} β={first.beta:.4f} τ={first.tau:.3f}",
            refresh=False,
        )
        self._bar.update(progress.iteration - self._bar.n)


def describe(segment: Segment, fit: Fit, quality: Quality) -> dict[str, Any]:
    """The result as the command-line contract has it."""
    return {
        **fields(fit, "method", "case", "loss", "network_weights", "iterations"),
        **fields(fit, "seconds", "cached"),
        "preset": fit.config.get("preset"),
        "seed": fit.config.get("seed"),
        "segment": describe_segment(segment),
        "parameters": describe_parameters(segment, fit.parameters),
        "unconstrained": describe_parameters(segment, fit.unconstrained),
        "active_bounds": fit.active_bounds,
        "mae": describe_errors(surrogate_errors(segment, fit)),
        "closed_loop_mae": describe_errors(closed_loop_errors(segment, fit)),
        "incidents": _events(segment, fit),
        "mean_time_gap": quality.mean_time_gap,
        "outcome": fit.outcome.name.lower(),
        "outcome_sentence": outcome_message(fit),
        "notes": _notes(segment, fit, quality),
    }


def _events(segment: Segment, fit: Fit) -> tuple[str, ...]:
    return messages(closed_loop_findings(segment, closed_loop(segment, fit)), segment)


def _text(segment: Segment, fit: Fit, quality: Quality) -> str:
    errors = surrogate_errors(segment, fit), closed_loop_errors(segment, fit)
    table = parameter_table(segment.info, fit, quality, *errors)
    effort = f"{fit.iterations} iterations in {fit.seconds:.1f} s" + (
        ", answered from the cache" if fit.cached else ""
    )
    said = [f"{outcome_message(fit)} ({effort})", *_events(segment, fit)]
    notes = [f"Note: {note}" for note in _notes(segment, fit, quality)]
    return "\n".join([table.to_text(), "", *said, *notes])


def _notes(segment: Segment, fit: Fit, quality: Quality) -> tuple[str, ...]:
    return messages((*segment.findings, *quality.findings, *fit.findings), segment)
