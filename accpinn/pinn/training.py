"""Training from request to result: cache, checkpoints, progress, stop and continue.

Every recipe is driven the same way. An identical request is answered from the cache; a training
that was stopped, or whose process died, goes on from its last checkpoint.
"""

import hashlib
import json
import time
from dataclasses import replace

import numpy as np
import torch

from accpinn.cthp import Case, Trajectories
from accpinn.fit import (
    Fit,
    OnProgress,
    Outcome,
    Progress,
    ShouldStop,
    bound_notes,
    parameters_of,
)
from accpinn.pinn.config import FAST, METHOD_VERSION, PinnConfig
from accpinn.pinn.fast import FastTraining
from accpinn.pinn.history import Recorder
from accpinn.pinn.network import output_columns
from accpinn.pinn.paper import PaperTraining
from accpinn.pinn.recipe import Learned, Problem, Training
from accpinn.segment import Segment
from accpinn.store import Store

CHECKPOINT_EVERY = 5.0
"""Seconds between checkpoints: what a killed process can lose."""

RECIPES: dict[str, type[FastTraining] | type[PaperTraining]] = {
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
) -> Fit:
    """Learn the parameters of a segment with the physics-inspired neural network.

    Args:
        segment: speeds (N, M+1) in m/s and space-gaps (N, M) in m.
        case: "I" for one parameter set, "II" for one per follower.
        config: recipe and settings.
        store: where results and checkpoints are kept; None keeps nothing.
        on_progress: called several times a second with the present moment.
        should_stop: asked several times a second; True ends with `Outcome.STOPPED`.
        threads: processor threads for torch; None leaves its setting alone.
    """
    before = torch.get_num_threads()
    torch.set_num_threads(threads or before)
    try:
        return _train(segment, case, config, store, on_progress, should_stop)
    finally:
        torch.set_num_threads(before)


def _train(
    segment: Segment,
    case: Case,
    config: PinnConfig,
    store: Store | None,
    on_progress: OnProgress | None,
    should_stop: ShouldStop | None,
) -> Fit:
    result_key, resume_key = request_keys(segment, case, config)
    if store and (known := store.load_fit(result_key)):
        return replace(known, cached=True)
    started = time.perf_counter()
    training: Training = RECIPES[config.preset](Problem(segment, case, config))
    recorder = Recorder()
    earlier, notes = _resume(training, recorder, store, resume_key)
    saved = started

    def elapsed() -> float:
        return earlier + time.perf_counter() - started

    def report() -> Progress:
        now = replace(training.progress, seconds=elapsed())
        recorder.add(now)
        if on_progress:
            on_progress(now)
        return now

    def save() -> None:
        if store:
            state = training.state() | recorder.state() | {"seconds": np.array(elapsed())}
            store.save_state(resume_key, state)

    now = report() if not earlier else replace(training.progress, seconds=elapsed())
    outcome = training.outcome
    while outcome is None:
        if should_stop and should_stop():
            outcome = Outcome.STOPPED
            break
        training.advance()
        now, outcome = report(), training.outcome
        if time.perf_counter() - saved > CHECKPOINT_EVERY:
            save()
            saved = time.perf_counter()
    if outcome is not Outcome.DIVERGED:
        save()
    fit = _as_fit(segment, case, config, training.learned(), outcome, recorder, elapsed())
    fit = replace(fit, iterations=now.iteration, notes=fit.notes + notes)
    if store and outcome in (Outcome.SETTLED, Outcome.FINISHED):
        store.save_fit(result_key, fit)
    return fit


def _resume(
    training: Training, recorder: Recorder, store: Store | None, key: str
) -> tuple[float, tuple[str, ...]]:
    """Seconds already spent, and what to tell the user about it."""
    state = store.load_state(key) if store else None
    if state is None:
        return 0.0, ()
    if int(state["history.rows"][-1][0]) > training.problem.config.iterations:
        return 0.0, ()
    seconds = float(state["seconds"])
    training.restore(state)
    recorder.restore(state)
    iteration = training.progress.iteration
    return seconds, (f"Continued from iteration {iteration:,} of an earlier training.",)


def request_keys(segment: Segment, case: Case, config: PinnConfig) -> tuple[str, str]:
    """Content addresses of a request's result and of its checkpoint.

    Equal addresses mean equal data, settings and method. Where a longer training only goes on
    where a shorter one ends (`paper` without L-BFGS), both share a checkpoint.
    """
    settings = config.to_json()
    resumable = settings.copy()
    if config.preset == "paper" and not config.lbfgs_iterations:
        del resumable["iterations"]
    return _address(segment, case, settings), _address(segment, case, resumable)


def _address(segment: Segment, case: Case, settings: dict[str, object]) -> str:
    request = {
        "method": METHOD_VERSION,
        "segment": segment.digest(),
        "case": case,
        "config": settings,
    }
    return hashlib.sha256(json.dumps(request, sort_keys=True).encode()).hexdigest()


def _as_fit(
    segment: Segment,
    case: Case,
    config: PinnConfig,
    learned: Learned,
    outcome: Outcome,
    recorder: Recorder,
    seconds: float,
) -> Fit:
    speed_columns, gap_columns = output_columns(segment.gaps.shape[1])
    return Fit(
        method="pinn",
        case=case,
        parameters=parameters_of(learned.solution.theta),
        surrogate=Trajectories(
            segment.time, learned.outputs[:, speed_columns], learned.outputs[:, gap_columns]
        ),
        outcome=outcome,
        seconds=seconds,
        config=config.to_json(),
        loss=learned.loss,
        unconstrained=parameters_of(learned.solution.unconstrained),
        active_bounds=learned.solution.active,
        history=recorder.history(),
        network_weights=learned.network_weights,
        notes=learned.notes + bound_notes(segment.vehicles, learned.solution),
        arrays=learned.arrays,
    )
