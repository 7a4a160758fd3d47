"""Training from request to result: cache, checkpoints, progress, stop and continue.

Both presets are driven the same way. An identical request is answered from the cache; a training
that was stopped, or whose process died, goes on from its last checkpoint.
"""

import os
import time
from dataclasses import dataclass, replace

import numpy as np
import torch

from accpinn.errors import ConfigError
from accpinn.methods.fit import (
    CacheProblem,
    Continued,
    Fit,
    MethodFinding,
    OnProgress,
    Outcome,
    Run,
    ShouldStop,
    StartedFrom,
    drive,
)
from accpinn.methods.history import Checkpoint, Progress, Recorder
from accpinn.methods.pinn.config import FAST, PinnConfig
from accpinn.methods.pinn.fast import FastTraining
from accpinn.methods.pinn.method import WarmStart, request_keys, require_memory
from accpinn.methods.pinn.paper import PaperTraining
from accpinn.methods.pinn.protocol import Problem, Training
from accpinn.methods.pinn.surrogate import output_columns
from accpinn.methods.store import Say, Store
from accpinn.model.cthp import Case, Trajectories
from accpinn.segment.segment import Segment
from accpinn.units import Seconds

DEFAULT_THREADS = max(1, min(4, (os.cpu_count() or 2) - 1))
"""One core is left to others: on matrices this small, threads that wait for a busy core cost far
more than another thread gains."""
MOST_THREADS = 4 * (os.cpu_count() or 2)
CHECKPOINT_EVERY = 5.0
"""Seconds between checkpoints: what a killed process can lose."""

TRAININGS: dict[str, type[FastTraining] | type[PaperTraining]] = {
    "fast": FastTraining,
    "paper": PaperTraining,
}


def train(
    segment: Segment,
    case: Case = "II",
    config: PinnConfig = FAST,
    *,
    store: Store | None = None,
    on_progress: OnProgress | None = None,
    should_stop: ShouldStop | None = None,
    threads: int | None = None,
    warm: WarmStart | None = None,
) -> Fit:
    """Learn the parameters of a segment; `training` driven to its end.

    Args:
        segment: see `training`, as all others.
        case: "I" or "II".
        config: preset and settings.
        store: for results and checkpoints.
        on_progress: called several times a second with the present moment.
        should_stop: asked several times a second; True ends with `Outcome.STOPPED`.
        threads: for torch.
        warm: an earlier fit to begin with.
    """
    run = training(
        segment, case, config, store=store, should_stop=should_stop, threads=threads, warm=warm
    )
    return drive(run, on_progress)


def training(
    segment: Segment,
    case: Case = "II",
    config: PinnConfig = FAST,
    *,
    store: Store | None = None,
    should_stop: ShouldStop | None = None,
    threads: int | None = None,
    warm: WarmStart | None = None,
) -> Run:
    """Learn the parameters of a segment with the physics-inspired neural network, step by step.

    Closing it keeps a checkpoint; a training of the same request goes on from there.

    Args:
        segment: speeds (N, M+1) in m/s and space-gaps (N, M) in m.
        case: "I" for one parameter set, "II" for one per follower.
        config: preset and settings.
        store: where results and checkpoints are kept; None keeps nothing.
        should_stop: asked several times a second; True ends with `Outcome.STOPPED`.
        threads: processor threads for torch; by default `DEFAULT_THREADS`.
        warm: an earlier fit's weights and parameters to begin with, in place of random weights and
            the initial values.

    Yields:
        The present moment, several times a second.

    Returns:
        The fit.

    Raises:
        ConfigError: when ``warm`` is another network's, or ``threads`` no sensible number.
        SegmentError: when the segment is too long to be trained on.
    """
    before = torch.get_num_threads()
    torch.set_num_threads(_allowed(threads))
    try:
        return (yield from _train(Problem(segment, case, config), warm, store, should_stop))
    finally:
        torch.set_num_threads(before)


def _allowed(threads: int | None) -> int:
    """How many threads torch gets; thousands would exhaust the system."""
    if threads is None:
        return DEFAULT_THREADS
    if type(threads) is not int or not 1 <= threads <= MOST_THREADS:
        raise ConfigError(
            f"threads: {str(threads)[:20]} is not allowed; choose 1 to {MOST_THREADS}."
        )
    return threads


def _train(
    problem: Problem, warm: WarmStart | None, store: Store | None, should_stop: ShouldStop | None
) -> Run:
    segment, case, config = problem.segment, problem.case, problem.config
    result_key, resume_key = request_keys(segment, case, config, warm)
    faults: list[str] = []
    if store and (known := store.load_fit(result_key, segment, faults.append)):
        return replace(known, cached=True)
    require_memory(segment, config)
    started = saved = time.perf_counter()
    run = _begin(problem, warm, store, (resume_key, result_key), faults.append)
    training, recorder, outcome = run.training, run.recorder, run.training.outcome

    def elapsed() -> Seconds:
        return run.earlier + time.perf_counter() - started

    def report() -> Progress:
        now = replace(training.progress, seconds=elapsed())
        recorder.add(now)
        return now

    def save() -> None:
        if store:
            state = training.state() | recorder.state() | {"seconds": np.array(elapsed())}
            store.save_state(run.key, state, faults.append)

    try:
        if not run.earlier:
            yield report()
        while outcome is None:
            if should_stop and should_stop():
                outcome = Outcome.STOPPED
                break
            training.advance()
            outcome = training.outcome
            yield report()
            if outcome is None and time.perf_counter() - saved > CHECKPOINT_EVERY:
                save()
                saved = time.perf_counter()
    finally:  # also where whoever drives it ends it
        if outcome is not Outcome.DIVERGED:
            save()
    fit = _as_fit(run, outcome, elapsed(), warm)
    if store and outcome in (Outcome.CONVERGED, Outcome.FINISHED):
        store.save_fit(result_key, fit, faults.append)
    # One may come at every checkpoint; they are about this run, so a kept result has none.
    problems = tuple(CacheProblem(sentence) for sentence in dict.fromkeys(faults))
    return replace(fit, findings=fit.findings + problems)


@dataclass(frozen=True, eq=False)
class _TrainingRun:
    """A training at its beginning, or where an earlier one ended."""

    training: Training
    recorder: Recorder
    key: str
    """Where its checkpoints are kept."""
    earlier: Seconds = 0.0
    """Time already spent."""
    findings: tuple[MethodFinding, ...] = ()


def _begin(
    problem: Problem, warm: WarmStart | None, store: Store | None, keys: tuple[str, str], say: Say
) -> _TrainingRun:
    """Go on from the checkpoint under the first of ``keys``, if there is one.

    A checkpoint beyond the planned iterations is a longer training's and stays untouched; the
    shorter one then has its own under the second key.
    """
    for key in keys:
        run = _new(problem, warm, key)
        state = store.load_state(key, say) if store else None
        if store is None or state is None:
            return run
        try:
            if state["history.rows"][-1][0] > run.training.progress.iterations:
                continue
            return _resume(run, state)
        except (KeyError, IndexError, TypeError, ValueError, RuntimeError) as fault:
            store.reject_state(key, fault, say)
            return _new(problem, warm, key)
    return run


def _new(problem: Problem, warm: WarmStart | None, key: str) -> _TrainingRun:
    """A training at its beginning."""
    training = TRAININGS[problem.config.preset](problem)
    if warm:
        try:
            training.begin_from(warm)
        except ValueError:
            raise ConfigError(
                f"The weights of {warm.origin} do not fit this network; choose the preset, the"
                " window and the highest frequency they were trained with, or start without them."
            ) from None
    return _TrainingRun(training, Recorder(), key)


def _resume(run: _TrainingRun, state: Checkpoint) -> _TrainingRun:
    run.training.restore(state)
    run.recorder.restore(state)
    continued = Continued(run.training.progress.iteration)
    return replace(run, earlier=float(state["seconds"]), findings=(continued,))


def _as_fit(run: _TrainingRun, outcome: Outcome, seconds: Seconds, warm: WarmStart | None) -> Fit:
    training = run.training
    problem, learned = training.problem, training.learned()
    speeds, gaps = output_columns(problem.followers)
    return Fit.of(
        "pinn",
        problem.segment,
        problem.case,
        learned.solution,
        surrogate=Trajectories(problem.time, learned.outputs[:, speeds], learned.outputs[:, gaps]),
        outcome=outcome,
        seconds=seconds,
        config=problem.config.to_json() | ({"started_from": warm.digest()} if warm else {}),
        loss=learned.loss,
        history=run.recorder.history(),
        iterations=training.progress.iteration,
        network_weights=learned.network_weights,
        arrays=learned.arrays,
        findings=[
            *([StartedFrom(warm.origin)] if warm else []),
            *learned.findings,
            *run.findings,
        ],
    )
