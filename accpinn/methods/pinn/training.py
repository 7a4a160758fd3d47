"""Training from request to result: cache, checkpoints, progress, stop and continue.

All presets are driven the same way. An identical request is answered from the cache; a training
that was stopped, or whose process died, goes on from its last checkpoint.
"""

import os
import time
from dataclasses import replace

import numpy as np

from accpinn.errors import AccpinnError, ConfigError
from accpinn.methods.fit import (
    CacheProblem,
    Continued,
    Fit,
    MethodFinding,
    Outcome,
    Progress,
    Recorder,
    Run,
    ShouldStop,
    StartedFrom,
)
from accpinn.methods.pinn.config import FAST, PinnConfig, PresetName
from accpinn.methods.pinn.loss import Training
from accpinn.methods.pinn.network import output_columns
from accpinn.methods.pinn.request import TrainingRequest, WarmStart, require_memory
from accpinn.methods.store import Store
from accpinn.model.cthp import Case, Trajectories
from accpinn.segment.segment import Segment
from accpinn.units import FloatArray, Seconds

MOST_THREADS = 4 * (os.cpu_count() or 2)
CURVE_EVERY = 1.0
"""Seconds between two moments that carry the surrogate's curves, which cost an evaluation."""
CHECKPOINT_EVERY = 5.0
"""Seconds between checkpoints: what a killed process can lose."""


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
        threads: processor threads; by default as many as help, at most four.
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
    count = _default(config.preset) if threads is None else _allowed(threads)

    def begin() -> Training:
        return _begun(_kind(config.preset)(segment, case, config, count), warm)

    result_key, resume_key = TrainingRequest(segment, case, config, warm).keys
    faults: list[str] = []
    if store and (known := store.load_fit(result_key, segment, faults.append)):
        return replace(known, cached=True)
    require_memory(segment, config)
    started = saved = drawn = time.perf_counter()
    training, recorder, earlier = begin(), Recorder(), 0.0
    # A checkpoint beyond the planned iterations is a longer training's and stays untouched; the
    # shorter one then has its own under the result's key.
    for key in (resume_key, result_key):
        state = store.load_state(key, faults.append) if store else None
        if store is None or state is None:
            break
        try:
            if state["history.rows"][-1][0] > training.planned:
                continue
            training.restore(state)
            recorder.restore(state)
            earlier = float(state["seconds"])
        except (KeyError, IndexError, TypeError, ValueError, RuntimeError) as fault:
            store.reject_state(key, fault, faults.append)
            training, recorder = begin(), Recorder()
        break
    outcome = training.outcome
    begun: list[MethodFinding] = [Continued(training.progress.iteration)] if earlier else []

    def elapsed() -> Seconds:
        return earlier + time.perf_counter() - started

    def motion(outputs: FloatArray) -> Trajectories:
        speeds, gaps = output_columns(segment.followers)
        return Trajectories(segment.time, outputs[:, speeds], outputs[:, gaps])

    def report() -> Progress:
        nonlocal drawn
        now = replace(training.progress, seconds=elapsed())
        recorder.add(now)
        if outcome is None and time.perf_counter() - drawn > CURVE_EVERY:
            drawn = time.perf_counter()
            outputs = training.outputs()
            return now if outputs is None else replace(now, surrogate=motion(outputs))
        return now

    def save() -> None:
        if store:
            state = training.state() | recorder.state() | {"seconds": np.array(elapsed())}
            store.save_state(key, state, faults.append)

    try:
        if not earlier:
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
    learned = training.learned()
    fit = Fit.of(
        "pinn",
        segment,
        case,
        learned.solution,
        surrogate=motion(learned.outputs),
        outcome=outcome,
        seconds=elapsed(),
        config=config.to_json() | ({"started_from": warm.digest()} if warm else {}),
        loss=learned.loss,
        history=recorder.history(),
        iterations=training.progress.iteration,
        network_weights=learned.network_weights,
        arrays=learned.arrays,
        findings=[*([StartedFrom(warm.origin)] if warm else []), *learned.findings, *begun],
    )
    if store and outcome in (Outcome.CONVERGED, Outcome.FINISHED):
        store.save_fit(result_key, fit, faults.append)
    # One may come at every checkpoint; they are about this run, so a kept result has none.
    problems = tuple(CacheProblem(sentence) for sentence in dict.fromkeys(faults))
    return replace(fit, findings=fit.findings + problems)


def _kind(preset: PresetName) -> type[Training]:
    """The preset's training, imported only now: each takes its time.

    Raises:
        AccpinnError: where PyTorch, which `paper` needs, cannot be loaded.
    """
    if preset == "fast":
        from accpinn.methods.pinn.fast import FastTraining

        return FastTraining
    if preset == "calibrated":
        from accpinn.methods.pinn.calibrated import CalibratedTraining

        return CalibratedTraining
    try:
        from accpinn.methods.pinn.paper import PaperTraining
    except (ImportError, OSError) as fault:  # the latter for a library of another system
        raise AccpinnError(
            f"PyTorch, which the preset paper needs, cannot be loaded ({str(fault)[:80]}); install"
            " the packages of requirements.txt again, or choose another preset."
        ) from fault
    return PaperTraining


def _default(preset: PresetName) -> int:
    """How many threads a training gets where nobody chose.

    Those of `fast` have work of their own. With `paper` they share each small product, and one that
    waits for a busy core costs far more than another gains: a core is left to others.
    """
    cores = os.cpu_count() or 1
    return max(1, min(4, cores if preset == "fast" else cores - 1))


def _allowed(threads: int) -> int:
    """How many threads a training gets; thousands would exhaust the system."""
    if type(threads) is not int or not 1 <= threads <= MOST_THREADS:
        raise ConfigError(
            f"threads: {str(threads)[:20]} is not allowed; choose 1 to {MOST_THREADS}."
        )
    return threads


def _begun(training: Training, warm: WarmStart | None) -> Training:
    """A training at its beginning."""
    if warm:
        try:
            training.begin_from(warm)
        except ValueError:
            raise ConfigError(
                f"The weights of {warm.origin} do not fit this network; choose the preset, the"
                " window and the highest frequency they were trained with, or start without them."
            ) from None
    return training
