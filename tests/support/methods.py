"""Methods as tests call them."""

from collections.abc import Callable
from functools import partial
from typing import Any

from accpinn.methods import TaskContext
from accpinn.methods.estimate import Estimate
from accpinn.methods.pinn.config import FAST, PinnConfig, preset
from accpinn.methods.registry import METHODS
from accpinn.model.cthp import Case
from accpinn.model.spec import PAPER_SPEC, ModelSpec
from accpinn.segment import Segment

RIVALS = {
    key: partial(method.fit, spec=PAPER_SPEC)
    for key, method in METHODS.items()
    if not method.settings
}
"""Every method but the network, which takes longer, with the paper's model."""
WEIGHTED = preset("fast", weight_physics=(2.0, 0.5), weight_initial=1.5, weight_data=(3.0, 0.7))
"""The network's loss with another weight for every term."""


def train(
    segment: Segment,
    case: Case = "II",
    config: PinnConfig = FAST,
    spec: ModelSpec = PAPER_SPEC,
    **context: Any,
) -> Estimate:
    """The network's estimate; ``context`` as in `TaskContext`."""
    return METHODS["pinn"].fit(segment, case, config, TaskContext(**context), spec)


def after(count: int) -> Callable[[], bool]:
    """A user who presses Stop when asked for the ``count``-th time after the first."""
    asked = iter(range(count))
    return lambda: next(asked, None) is None
