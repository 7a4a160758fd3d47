"""The physics-inspired neural network as a method of the registry; torch is loaded on first use."""

from collections.abc import Mapping
from typing import Any

from accpinn.methods.fit import Run
from accpinn.methods.method import Method, TaskContext
from accpinn.methods.pinn.config import FAST, PRESETS, PinnConfig
from accpinn.model.cthp import Case
from accpinn.segment.segment import Segment


def _run(segment: Segment, case: Case, settings: PinnConfig | None, context: TaskContext) -> Run:
    from accpinn.methods.pinn.training import training  # torch takes a second to import

    return training(
        segment,
        case,
        settings or FAST,
        store=context.store,
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
    run=_run,
    typical_seconds=2.9,
    tolerance=1e-3,
    parse_settings=lambda config: PinnConfig.from_json(dict(config)),
    variant=_variant,
)
