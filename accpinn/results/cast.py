"""Who drives in a simulated platoon, under the names that legends and sentences have."""

from dataclasses import dataclass
from functools import cached_property

from accpinn.findings import capital
from accpinn.model.published import ParameterSet


@dataclass(frozen=True)
class Cast:
    """Who drives in a simulated platoon: some vehicles, by their indices in driving order.

    In the vehicles' own order each goes by its own name, otherwise by its place.
    """

    vehicles: ParameterSet
    order: tuple[int, ...]
    source: str = "platoon"

    @property
    def is_in_order(self) -> bool:
        """Whether each vehicle drives once, in its own place."""
        return self.order == tuple(range(len(self.vehicles)))

    @cached_property
    def labels(self) -> tuple[str, ...]:
        """(M+1,) for legends, leader first."""
        own = [self.vehicles.labels[k] for k in self.order]
        if not self.is_in_order:
            own = [f"Follower {place}: {label}" for place, label in enumerate(own, 1)]
        return ("Leader", *own)

    @property
    def numbers(self) -> tuple[str, ...]:
        """(M+1,) in place of labels beside a line: numbers in a recording, or the places."""
        if self.is_in_order and self.vehicles.numbered:
            return ("L", *map(str, self.vehicles.vehicles[1:]))
        return tuple(map(str, range(1 + len(self.order))))

    def label(self, place: int) -> str:
        """The name of the vehicle in a place, 0 for the leader, at the beginning of a sentence."""
        return capital(self.spoken(place))

    def spoken(self, place: int) -> str:
        """The same within a sentence."""
        if not place:
            return "the leader"
        return self.vehicles.spoken[place - 1] if self.is_in_order else f"follower {place}"
