"""What a training is to learn, and what the store has of it already."""

from dataclasses import dataclass, replace
from functools import cached_property

from accpinn.methods.fit import Fit
from accpinn.methods.pinn import method as pinn
from accpinn.methods.pinn.config import PinnConfig
from accpinn.methods.pinn.method import WarmStart
from accpinn.methods.store import Store
from accpinn.model.cthp import Case
from accpinn.segment.segment import Segment


@dataclass(frozen=True, eq=False)
class TrainingRequest:
    """Everything that determines the result of a training."""

    segment: Segment
    case: Case
    config: PinnConfig
    warm: WarmStart | None = None
    """The weights it begins with in place of random ones."""

    @cached_property
    def key(self) -> str:
        """Its content address: requests of equal keys have the same result."""
        return pinn.request_keys(self.segment, self.case, self.config, self.warm)[0]

    def recall(self, store: Store) -> Fit | None:
        """The stored result, None where there is none."""
        known = store.load_fit(self.key, self.segment)
        return replace(known, cached=True) if known else None

    def resume_iteration(self, store: Store) -> int | None:
        """The iteration from which a stopped training of it would go on; None where it is new."""
        return pinn.resume_iteration(store, self.segment, self.case, self.config, self.warm)

    def drop_checkpoints(self, store: Store) -> None:
        """Let its next training begin anew."""
        pinn.drop_checkpoints(store, self.segment, self.case, self.config, self.warm)
