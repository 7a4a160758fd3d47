"""What a segment is, without its data: enough for legends, tables and a report."""

from dataclasses import dataclass
from typing import Protocol

from accpinn.units import Seconds


class Described(Protocol):
    """What a `Segment` and an `Outline` have in common; see there for the meaning."""

    @property
    def vehicles(self) -> tuple[int, ...]:
        """(M+1,) numbers in the file, leader first."""

    @property
    def names(self) -> tuple[str, ...]:
        """(M+1,) names in the file's header."""

    @property
    def start(self) -> Seconds:
        """In s from the recording's first sample."""

    @property
    def duration(self) -> Seconds:
        """In s."""

    @property
    def samples(self) -> int:
        """N."""

    @property
    def sample_time(self) -> Seconds:
        """In s."""

    @property
    def source(self) -> str:
        """File name of the recording."""

    @property
    def sha256(self) -> str:
        """Of the recording's bytes."""

    @property
    def notes(self) -> tuple[str, ...]:
        """What was done to the data."""

    @property
    def excluded_regimes(self) -> tuple[str, ...]:
        """Names of the regimes left out of the law's equations."""

    @property
    def followers(self) -> int:
        """M."""

    @property
    def labels(self) -> tuple[str, ...]:
        """(M+1,) for legends and tables."""


@dataclass(frozen=True)
class SegmentInfo:
    """A segment's window, vehicles and origin."""

    vehicles: tuple[int, ...]
    """(M+1,) the vehicles' numbers in the file (1 = first), leader first."""
    names: tuple[str, ...]
    """(M+1,) their names in the file's header."""
    start: Seconds
    """Window start, in s from the recording's first sample."""
    duration: Seconds
    samples: int
    """N, both ends of the window included."""
    sample_time: Seconds
    source: str
    """File name of the recording."""
    sha256: str
    """Of the recording's bytes; empty for data made in memory."""
    notes: tuple[str, ...]
    """What was done to the data (resampled, bridged, left out), in plain sentences."""
    digest: str
    """SHA-256 of the segment's data: equal digests mean equal data."""
    left_out: tuple[str, ...] = ()
    """Names of the regimes left out of the law's equations; empty where all instants count."""
    left_out_share: tuple[float, ...] = ()
    """(M,) share of each follower's instants left out, 0 to 1; empty where all count."""

    @property
    def excluded_regimes(self) -> tuple[str, ...]:
        """The same names, as a `Segment` calls them."""
        return self.left_out

    @property
    def followers(self) -> int:
        """M."""
        return len(self.vehicles) - 1

    @property
    def labels(self) -> tuple[str, ...]:
        """(M+1,) number and name of each vehicle, for legends and tables."""
        return labels(self.vehicles, self.names)


def labels(vehicles: tuple[int, ...], names: tuple[str, ...]) -> tuple[str, ...]:
    """Number and name of each vehicle; the number alone where the file gives no name."""
    return tuple(
        name if name == f"Vehicle {number}" else f"{number} {name}"
        for number, name in zip(vehicles, names, strict=True)
    )
