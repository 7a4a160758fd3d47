"""The physics-inspired neural network as a method of the registry; torch is loaded on first use."""

from collections.abc import Mapping
from typing import Any

from accpinn.methods.fit import Fit
from accpinn.methods.method import Method, TaskContext
from accpinn.methods.pinn.config import FAST, PRESETS, PinnConfig
from accpinn.methods.pinn.numpy_forward import curve
from accpinn.model.cthp import Case
from accpinn.segment.segment import Segment


def _estimate(
    segment: Segment, case: Case, settings: PinnConfig | None, context: TaskContext
) -> Fit:
    from accpinn.methods.pinn.training import train  # torch takes a second to import

    return train(
        segment,
        case,
        settings or FAST,
        store=context.store,
        on_progress=context.on_progress,
        should_stop=context.should_stop,
        threads=context.threads,
    )


def _variant(config: Mapping[str, Any]) -> str:
    """The preset, and whether settings differ from it."""
    name = str(config.get("preset", ""))
    usual = PRESETS[name].to_json() if name in PRESETS else {}
    return f"{name} preset" + ("" if dict(config) == usual else ", own options")


METHOD = Method(
    key="pinn",
    title="PiNN",
    estimate=_estimate,
    typical_seconds=2.9,
    tolerance=1e-3,
    parse_settings=lambda config: PinnConfig.from_json(dict(config)),
    variant=_variant,
    redraw=curve,
)
