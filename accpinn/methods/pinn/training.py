"""The PiNN as a method of the registry: from settings to estimate; curves drawn again from one.

All presets are driven the same way. A training that takes minutes (`paper`) continues from its last
checkpoint where it was stopped, or where its process died; the others take a second and begin anew.
PyTorch takes a second or two to be imported, in a thread while something else is done.
"""

import os
import time
from bisect import bisect_right
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from functools import cache, partial
from importlib import import_module
from threading import Thread
from typing import Any

import numpy as np

from accpinn.errors import AccpinnError, ConfigError, SegmentError
from accpinn.methods import TYPICAL_SAMPLES, Method, Segments, TaskContext
from accpinn.methods.estimate import Estimate, Outcome, Recorder, of_window
from accpinn.methods.findings import Continued
from accpinn.methods.forecast import CURVES, PARAMETERS, Pace, Phase
from accpinn.methods.pinn.calibrated import FIRST_ROUNDS, FURTHER_ROUNDS, CalibratedTraining
from accpinn.methods.pinn.config import (
    CALIBRATED,
    CYCLE,
    FAST,
    METHOD_VERSION,
    PAPER,
    PRESET_INFOS,
    PRESETS,
    USUAL_CYCLES,
    USUAL_ROUNDS,
    PinnConfig,
    PresetInfo,
    PresetName,
)
from accpinn.methods.pinn.initial import initial_parameters
from accpinn.methods.pinn.loss import Training, trajectories
from accpinn.methods.pinn.network import Network
from accpinn.model.cthp import Case, Trajectories
from accpinn.model.registry import BEST, FOLLOWING
from accpinn.model.registry import PAPER as PAPER_MODEL
from accpinn.model.spec import ModelSpec
from accpinn.segment import Segment
from accpinn.units import FloatArray, Seconds

MOST_THREADS = 4 * (os.cpu_count() or 2)
CHECKPOINT_EVERY = 5.0
"""Seconds between checkpoints: what a killed process can lose."""
TYPICAL: dict[PresetName, tuple[Seconds, float, int]] = {
    "fast": (0.4, 0.25, FAST.iterations),
    "calibrated": (0.9, 0.7, CALIBRATED.iterations),
    "paper": (450.0, 0.44, PAPER.iterations),
}
"""Seconds on 300 s of one follower, the share that each further one adds, and the iterations of
that measurement; see docs/validation.md."""
LBFGS_EVALUATIONS = 1.4
"""Evaluations of the loss that an iteration of L-BFGS takes."""
MOST_BYTES = 1.4e9
_PER_FEATURE = {
    "usual": (18, 1), "masked": (21, 1), "other model": (105, 10), "late model": (115, 70),
    "late calibrated": (120, 8),
}  # fmt: skip
"""Bytes per instant and input feature that `fast` and `calibrated` take at their peak, and for each
follower; measured. Another model's derivatives differ from instant to instant; a late one has a lag
or a delay, of which `calibrated` takes one follower at a time."""
_PER_PAIR = {False: (210, 40), True: (240, 110)}
"""Bytes per pair of columns that the output layer sees, and for each follower, without and with a
mask; measured."""
_PER_INSTANT, _LATE_INSTANT = 15_000, 25_000
"""Bytes per instant that `paper` takes at its peak, and with a lag or a delay; measured. Larger
networks take more, as the neurons of all layers do: twice as much for six layers, four times as
much for 200 neurons."""
MOST_FEATURES = 20_000
"""`redraw` refuses more; a window of a day has fewer."""
TORCH_ABSENT = (ImportError, OSError)
"""Errors of the import of PyTorch; the latter for a library of another system."""


@cache
def start_loading() -> None:
    """Begin to import PyTorch in a thread; called as soon as a training is asked for."""

    def load() -> None:
        with suppress(*TORCH_ABSENT):  # whoever needs it reports it
            import_module("torch")

    Thread(target=load, daemon=True).start()


def redraw(estimate: Estimate, window: int, time: FloatArray, duration: Seconds) -> Trajectories:
    """The surrogate of a window from its stored weights alone, at any instants (N,) in s.

    Raises:
        ConfigError: when the weights are missing, or another network's.
    """
    config = PinnConfig.from_json(estimate.settings)
    try:
        if 2 * duration * config.highest_frequency > MOST_FEATURES:
            raise ValueError(duration)
        network = Network(len(estimate.parameters), config, duration)
        network.load_arrays(of_window(estimate.arrays, window))
    except (KeyError, ValueError):
        raise ConfigError(
            "The network's weights are missing, or another network's; train again."
        ) from None
    return trajectories(time, network(time)[0])


def training(
    segments: Segments,
    case: Case,
    settings: PinnConfig | None,
    context: TaskContext,
    spec: ModelSpec,
) -> Estimate:
    """Learn the parameters of windows (K,) with the physics-inspired neural network.

    Whatever ends it leaves a checkpoint, from which a training with the same settings goes on. The
    threads are as many as help, at most four.

    Raises:
        AccpinnError: where PyTorch cannot be loaded.
        ConfigError: when the number of threads is no sensible one.
        SegmentError: when the windows are too long to be trained on.
    """
    config = settings or PinnConfig.default()
    threads = _threads(config.preset, context)
    require_memory(segments, config, spec.model)
    return _driven(partial(_begun, segments, case, config, threads, spec), context)


def _begun(
    segments: Segments, case: Case, config: PinnConfig, threads: int, spec: ModelSpec
) -> Training:
    """The preset's training; `calibrated` needs no PyTorch."""
    if config.preset == "calibrated":
        return CalibratedTraining(segments, case, config, spec)
    try:
        import_module("torch")
    except TORCH_ABSENT as fault:
        raise AccpinnError(
            f"PyTorch, which the PiNN needs, cannot be loaded ({str(fault)[:80]}); install the"
            " packages of requirements.txt again, or choose another method."
        ) from fault
    if config.preset == "paper":
        from accpinn.methods.pinn.paper import PaperTraining

        return PaperTraining(segments, case, config, threads, spec)
    if spec.model == PAPER_MODEL:
        from accpinn.methods.pinn.fast import FastTraining

        return FastTraining(segments, case, config, threads, spec)
    from accpinn.methods.pinn.following import FollowingFast

    return FollowingFast(segments, case, config, threads, spec)


def _driven(begin: Callable[[], Training], context: TaskContext) -> Estimate:
    """Drive a training to its end, or from its last checkpoint on."""
    started = saved = time.perf_counter()
    pace = Pace()
    training, recorder, earlier = begin(), Recorder(), 0.0
    checkpoints = context.checkpoints if training.has_checkpoints else None
    state = checkpoints.load(training.planned) if checkpoints else None
    if checkpoints and state:
        try:
            training.restore(state)
            recorder.restore(state)
            earlier = float(state["seconds"])
        except (KeyError, IndexError, TypeError, ValueError, RuntimeError) as fault:
            checkpoints.reject(fault)
            training, recorder = begin(), Recorder()
    begun = [Continued(training.progress.iteration)] if earlier else []

    def elapsed() -> Seconds:
        return earlier + time.perf_counter() - started

    def report() -> None:
        now = replace(training.progress, seconds=elapsed())
        recorder.add(now)
        if not context.on_progress:
            return
        curves = pace.drawn(training.curves) if training.outcome is None else None
        context.on_progress(replace(now, curves=curves))

    def save() -> None:
        if checkpoints:
            seconds = {"seconds": np.array(elapsed())}
            checkpoints.save(training.state() | recorder.state() | seconds)

    try:
        if not earlier:
            report()
        while training.outcome is None and not context.is_stopped:
            before = training.progress
            training.advance()
            if training.progress is not before:
                report()
            if training.outcome is None and time.perf_counter() - saved > CHECKPOINT_EVERY:
                save()
                saved = time.perf_counter()
    finally:  # also where it is interrupted
        if training.outcome is not Outcome.DIVERGED:
            save()
    if point := training.point():
        if context.on_estimate:
            context.on_estimate(point)
        if context.on_progress:
            now = replace(training.progress, phase=CURVES, iteration=0, iterations=1)
            context.on_progress(replace(now, seconds=elapsed()))
    estimate = training.estimate()
    findings = (*estimate.findings, *begun)
    history = recorder.history()
    return replace(estimate, seconds=elapsed(), history=history, findings=findings)


def _threads(preset: PresetName, context: TaskContext) -> int:
    """The number of threads of a training; thousands would exhaust the system.

    They share each small product, and one that waits for a busy core costs far more than another
    gains: where nobody chose, minibatches get one, and `paper` leaves a core to others.
    """
    threads = context.threads
    if threads is None:
        return 1 if preset != "paper" else max(1, min(4, (os.cpu_count() or 1) - 1))
    if type(threads) is not int or not 1 <= threads <= MOST_THREADS:
        raise ConfigError(
            f"threads: {str(threads)[:20]} is not allowed; choose 1 to {MOST_THREADS}."
        )
    return threads


def require_memory(
    segments: Sequence[Segment], config: PinnConfig, model: str = PAPER_MODEL
) -> None:
    """Refuse windows whose training would not fit.

    Raises:
        SegmentError: naming the longest window that can be trained on, or how many are too many.
    """
    needs = [bytes_needed(s, s.window.duration, config, model) for s in segments]
    # The networks of `calibrated` are drawn one after the other.
    needed = max(needs) if config.preset == "calibrated" else sum(needs)
    if needed <= MOST_BYTES:
        return
    largest = segments[int(np.argmax(needs))]
    if max(needs) <= MOST_BYTES:
        raise SegmentError(
            f"{largest.source}: {len(segments)} windows would take {needed / 1e9:,.1f} GB of memory"
            f" to train on; take at most {int(MOST_BYTES / max(needs))} as long as the longest."
        )
    duration = largest.window.duration
    shorter = range(10, int(duration), 10)
    fitting = bisect_right(
        shorter, MOST_BYTES, key=lambda lasts: bytes_needed(largest, lasts, config, model)
    )
    raise SegmentError(
        f"{largest.source}: a window of {duration:,.0f} s would take {max(needs) / 1e9:,.1f} GB of"
        f" memory to train on; take at most {shorter[fitting - 1]:,} s."
    )


def bytes_needed(segment: Segment, duration: Seconds, config: PinnConfig, model: str) -> float:
    """The peak of a training on a segment like this one, of another duration."""
    samples = duration / segment.sample_time + 1
    is_late = FOLLOWING[model].is_late
    if config.preset == "paper":
        usual = PRESETS["paper"].layers * PRESETS["paper"].width
        larger = max(1.0, config.layers * config.width / usual)
        return samples * larger * (_LATE_INSTANT if is_late else _PER_INSTANT)
    kind = "usual" if segment.mask is None else "masked"
    if config.preset == "fast" and model != PAPER_MODEL:
        kind = "late model" if is_late else "other model"
    elif is_late:
        kind = "late calibrated"
    features = 2 * len(config.angular_frequencies(duration)) + 2
    by_follower = 1, segment.followers
    per_feature = np.dot(_PER_FEATURE[kind], by_follower)
    per_pair = np.dot(_PER_PAIR[segment.mask is not None], by_follower)
    return float(per_feature * samples * features + per_pair * (features + config.width) ** 2)


def typical_seconds(segments: Segments, settings: PinnConfig | None) -> Seconds:
    """Expected duration of a training that runs all its iterations."""
    config = settings or PinnConfig.default()
    typical, further, iterations = TYPICAL[config.preset]
    samples = sum(segment.samples for segment in segments)
    followers = 1 + further * (segments[0].followers - 1)
    size = samples / TYPICAL_SAMPLES * config.iterations / iterations
    larger = max(1.0, config.layers / FAST.layers * (config.width / FAST.width) ** 2)
    return typical * size * followers * larger


def _phases(
    segments: Segments, settings: PinnConfig | None, spec: ModelSpec
) -> Mapping[str, Phase]:
    """The phases of a preset, measured on two cores."""
    config, followers = settings or PinnConfig.default(), segments[0].followers
    windows = len(segments)
    samples = sum(segment.samples for segment in segments)
    size, model = samples * followers, FOLLOWING[spec.model]
    if config.preset == "calibrated":
        rounds = FIRST_ROUNDS + (FURTHER_ROUNDS if spec.model != PAPER_MODEL else 0)
        drawing = 18e-6 * (samples + size) if model.is_late else 6e-6 * size
        return {
            PARAMETERS: Phase(rounds, 1e-3 + 6e-7 * samples + 2e-7 * size),
            CURVES: Phase(1, drawing),
        }
    if config.preset == "paper":
        typical, further, iterations = TYPICAL["paper"]
        larger = max(1.0, config.layers * config.width / (PAPER.layers * PAPER.width))
        each = typical / iterations * samples / TYPICAL_SAMPLES * (1 + further * (followers - 1))
        refining = {"L-BFGS": Phase(config.lbfgs_iterations, LBFGS_EVALUATIONS * larger * each)}
        return {"Adam": Phase(config.iterations, larger * each)} | (
            refining if config.lbfgs_iterations else {}
        )
    usual = spec.model == PAPER_MODEL
    solving = 3e-3 + 7e-7 * (samples + size) if usual else (3e-5 if model.is_late else 9e-6) * size
    cycle = 0.2 + windows * (0.1 + 0.02 * followers) + 5 * solving
    return {
        "start": Phase(USUAL_ROUNDS[usual], solving),
        "Adam": Phase(int(CYCLE * USUAL_CYCLES[usual]), cycle / CYCLE),
    }


def _resumable(settings: dict[str, Any]) -> dict[str, Any] | None:
    """The settings that trainings with one checkpoint share; None for presets of seconds.

    A longer training of `paper` goes on where a shorter one ends, unless L-BFGS follows.
    """
    if settings["preset"] != "paper":
        return None
    shared = dict(settings)
    if not settings["lbfgs_iterations"]:
        del shared["iterations"]
    return shared


def _info(settings: Mapping[str, Any]) -> PresetInfo:
    """The properties of the settings' preset; without one, as of a hand-made estimate, none."""
    return PRESET_INFOS.get(settings.get("preset", ""), PresetInfo("", ""))


def _models(settings: Mapping[str, Any]) -> tuple[str, ...]:
    """All models, the paper's first; of a preset with a posterior the CTHPs, the best one first."""
    if _info(settings).has_posterior:
        linear = (key for key, model in FOLLOWING.items() if model.is_linear and key != BEST)
        return (BEST, *linear)
    return tuple(FOLLOWING)


def _variant(config: Mapping[str, Any]) -> str:
    """The preset, and whether settings differ from it."""
    name = str(config.get("preset", ""))
    usual = PRESETS[name].to_json() if name in PRESETS else {}
    return f"{name} preset" + ("" if dict(config) == usual else ", own options")


METHOD = Method(
    key="pinn",
    title="PiNN",
    run=training,
    summary="physics-inspired neural network: trajectories and parameters learned together",
    typical_seconds=2.0,
    version=METHOD_VERSION,
    resumable_settings=_resumable,
    tolerance=1e-3,
    settings=PinnConfig,
    variant=_variant,
    duration=typical_seconds,
    phases=_phases,
    initial=initial_parameters,
    redraw=redraw,
    models=_models,
    posterior=lambda settings: "likelihood" if _info(settings).has_posterior else None,
    allows_missing=lambda settings: _info(settings).has_posterior,
    description=lambda settings: _info(settings).description,
    curve_title="network",
    minimises_papers_loss=lambda settings: _info(settings).minimises_papers_loss,
)
