"""Methods as tests call them."""

from typing import Any

from accpinn import METHODS, Case, Fit, PinnConfig, Segment
from accpinn.methods import PAPERS, Law, TaskContext
from accpinn.methods.pinn.config import FAST

RIVALS = {key: method.fit for key, method in METHODS.items() if not method.settings}
"""Every method but the network, which takes longer."""
WEIGHTED = PinnConfig(weight_physics=(2.0, 0.5), weight_initial=1.5, weight_data=(3.0, 0.7))
"""The network's loss with another weight for every term."""


def train(
    segment: Segment,
    case: Case = "II",
    config: PinnConfig = FAST,
    law: Law = PAPERS,
    **context: Any,
) -> Fit:
    """The network's fit; ``context`` as in `TaskContext`."""
    return METHODS["pinn"].fit(segment, case, config, TaskContext(**context), law)
