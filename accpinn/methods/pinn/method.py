"""The PiNN as a method of the registry; its surrogate drawn again from a fit's weights."""

from collections.abc import Mapping
from typing import Any

from accpinn.errors import ConfigError
from accpinn.methods.fit import Fit, Run
from accpinn.methods.method import Method, TaskContext
from accpinn.methods.pinn import training
from accpinn.methods.pinn.config import FAST, METHOD_VERSION, PRESETS, PinnConfig
from accpinn.methods.pinn.loss import output_columns
from accpinn.methods.pinn.torch_loading import wait_until_loaded
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
    config = PinnConfig.from_json(fit.config)
    wait_until_loaded()
    from accpinn.methods.pinn.network import Network

    try:
        if 2 * duration * config.highest_frequency > MOST_FEATURES:
            raise ValueError(duration)
        network = Network(len(fit.parameters), config, duration)
        network.load_arrays(fit.arrays)
    except (KeyError, ValueError, RuntimeError):
        raise ConfigError(
            "The network's weights are missing, or another network's; train again."
        ) from None
    outputs = network.curves(time)
    speeds, gaps = output_columns(len(fit.parameters))
    return Trajectories(time, outputs[:, speeds], outputs[:, gaps])


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
    duration=training.typical_seconds,
    redraw=redraw,
)
