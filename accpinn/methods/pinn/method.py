"""The PiNN as a method of the registry; its surrogate drawn again from a fit's weights."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from accpinn.errors import ConfigError
from accpinn.methods.fit import Fit, Run
from accpinn.methods.method import Method, TaskContext
from accpinn.methods.pinn import training
from accpinn.methods.pinn.config import FAST, METHOD_VERSION, PRESETS, PinnConfig
from accpinn.methods.pinn.network import HIDDEN_FREQUENCY, FourierFeatures, output_columns
from accpinn.methods.pinn.request import typical_seconds
from accpinn.model.cthp import Case, Trajectories
from accpinn.segment.segment import Segment
from accpinn.units import FloatArray, Seconds

MOST_FEATURES = 20_000
"""`redraw` refuses more; a window of a day has fewer."""


def redraw(fit: Fit, time: FloatArray, duration: Seconds) -> Trajectories:
    """The surrogate of a fit from its stored weights alone.

    Args:
        fit: a PiNN's.
        time: (N,) in s from the window's start; any instants of it.
        duration: of the window, in s.

    Raises:
        ConfigError: when the weights are missing, or another network's.
    """
    settings = {name: value for name, value in fit.config.items() if name != "started_from"}
    config = PinnConfig.from_json(settings)
    try:
        is_paper = config.preset == "paper"
        outputs = _paper(fit, time) if is_paper else _fourier(fit, time, duration, config)
        speeds, gaps = output_columns(len(fit.parameters))
        return Trajectories(time, outputs[:, speeds], outputs[:, gaps])
    except (KeyError, ValueError, IndexError):
        raise ConfigError(
            "The network's weights are missing, or another network's; train again."
        ) from None


def _fourier(fit: Fit, time: FloatArray, duration: Seconds, config: PinnConfig) -> FloatArray:
    """[φ, h(φ)] W; see `pinn.fast` and `pinn.calibrated`."""
    if 2 * duration * config.highest_frequency > MOST_FEATURES:
        raise ValueError(duration)
    of = FourierFeatures.up_to(config.highest_frequency, duration)
    seen = of.below(HIDDEN_FREQUENCY) if config.preset == "calibrated" else of
    features = of(time)
    active = _hidden(fit, features[:, 1 : seen.size], "hidden.layers")
    return np.asarray(np.hstack([features, active]) @ fit.arrays["output.weight"])


def _paper(fit: Fit, time: FloatArray) -> FloatArray:
    """See `pinn.paper.PaperNetwork`."""
    active = _hidden(fit, time[:, None], "network.hidden.layers")
    return _linear(fit, active, "network.output")


def _hidden(fit: Fit, values: FloatArray, prefix: str) -> FloatArray:
    count = sum(name.startswith(prefix) and name.endswith("weight") for name in fit.arrays)
    for k in range(count):
        values = np.tanh(_linear(fit, values, f"{prefix}.{k}"))
    return values


def _linear(fit: Fit, values: FloatArray, name: str) -> FloatArray:
    weight, bias = (np.asarray(fit.arrays[f"{name}.{part}"], float) for part in ("weight", "bias"))
    return np.asarray(values @ weight.T + bias)


def _run(segment: Segment, case: Case, settings: PinnConfig | None, context: TaskContext) -> Run:
    return training.training(
        segment,
        case,
        settings or FAST,
        checkpoints=context.checkpoints,
        should_stop=context.should_stop,
        threads=context.threads,
    )


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


def _variant(config: Mapping[str, Any]) -> str:
    """The preset, and whether settings differ from it."""
    name = str(config.get("preset", ""))
    usual = PRESETS[name].to_json() if name in PRESETS else {}
    return f"{name} preset" + ("" if dict(config) == usual else ", own options")


METHOD = Method(
    key="pinn",
    title="PiNN",
    run=_run,
    summary="physics-inspired neural network: trajectories and parameters learned together",
    typical_seconds=2.0,
    version=METHOD_VERSION,
    resumable_settings=_resumable,
    tolerance=1e-3,
    settings=PinnConfig,
    variant=_variant,
    description="a physics-inspired neural network (PiNN)",
    is_iterative=True,
    duration=typical_seconds,
    redraw=redraw,
)
