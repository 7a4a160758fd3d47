"""Regimes: what a follower does at each instant, and instants left out of its law because of it.

    manual          a driver, not ACC, controls the vehicle (where the file says so)
    standstill      speed at most 1 m/s
    catching up     time gap p/v above 2 s: the vehicle catches up or drives freely
    car-following   all else: where the law is meant to hold

Each instant has one regime, the first of these that applies. A file that gives no driver modes
has no manual instants here, and `Regimes.mode_known` says so.

Nothing is left out unless the user asks. What is left out keeps its data: the motion there is
measured as well as elsewhere, and dp/dt = Δv holds; only the equation of dv/dt does not count.
Leaving out by the time gap looks at what the law is to explain, so it biases too.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from accpinn.errors import SegmentError
from accpinn.recordings.recording import Mode, Recording
from accpinn.segment.missing import MINIMUM_DURATION
from accpinn.segment.quality import CAR_FOLLOWING, MOVING, time_gaps
from accpinn.segment.segment import Segment
from accpinn.units import Seconds, frozen

FOLLOWING, CATCHING_UP, MANUAL, STANDSTILL = range(4)
REGIMES = ("car-following", "catching up", "manual", "standstill")
"""Names by code."""
EXCLUDABLE = REGIMES[CATCHING_UP:]
"""Those that can be left out; the law is learned from the first."""
LEAST_LEFT: Seconds = MINIMUM_DURATION
"""Instants of so much time must be left of each follower: less says too little, as for windows."""


@dataclass(frozen=True, eq=False)
class Regimes:
    """The regime of each of M followers at each of N instants."""

    codes: NDArray[np.uint8]
    """(N, M) indices into `names`."""
    mode_known: tuple[bool, ...]
    """(M,) whether driver modes were at hand, so that manual driving could be seen."""
    names: tuple[str, ...] = REGIMES

    def __post_init__(self) -> None:
        """Lock the array."""
        object.__setattr__(self, "codes", frozen(self.codes, dtype=np.uint8))

    @property
    def shares(self) -> tuple[tuple[float, ...], ...]:
        """(M, 4) share of instants in each regime, 0 to 1."""
        return tuple(
            tuple(float((column == code).mean()) for code in range(len(self.names)))
            for column in self.codes.T
        )


def label_regimes(segment: Segment, recording: Recording | None = None) -> Regimes:
    """The regime of each follower at each instant.

    Args:
        segment: the data.
        recording: what it was cut from, for the driver modes; without it none is manual.
    """
    gaps = time_gaps(segment)
    codes = np.full(gaps.shape, FOLLOWING, np.uint8)
    codes[gaps > CAR_FOLLOWING] = CATCHING_UP
    codes[segment.speeds[:, 1:] <= MOVING] = STANDSTILL
    if recording is None:
        return Regimes(codes, (False,) * segment.followers)
    modes = _modes(segment, recording)
    codes[(modes == Mode.HUMAN).any(axis=0)] = MANUAL
    known = (modes != Mode.UNKNOWN).any(axis=(0, 1))
    return Regimes(codes, tuple(bool(value) for value in known))


def parse_regimes(names: str | Sequence[str]) -> tuple[str, ...]:
    """Regimes that can be left out, from "catching-up,standstill" or from their names.

    Raises:
        SegmentError: for a name that is not known.
    """
    known = {spelt: name for name in EXCLUDABLE for spelt in (name, as_typed(name))}
    chosen = [part.strip() for part in (names.split(",") if isinstance(names, str) else names)]
    for part in chosen:
        if part not in known:
            listed = ", ".join(map(as_typed, EXCLUDABLE))
            raise SegmentError(f'"{part[:40]}" cannot be left out; choose from {listed}.')
    return tuple(known[part] for part in chosen)


def as_typed(name: str) -> str:
    """A regime's name as it is typed, without spaces."""
    return name.replace(" ", "-")


def exclude_regimes(segment: Segment, regimes: Regimes, names: Sequence[str]) -> Segment:
    """The segment with the instants of the named regimes left out of the law's equations.

    Raises:
        SegmentError: when a name is not known, or too little is left of a follower.
    """
    chosen = tuple(name for name in EXCLUDABLE if name in names)
    for name in names:
        if name not in EXCLUDABLE:
            raise SegmentError(f'"{name}" cannot be left out; choose from {", ".join(EXCLUDABLE)}.')
    if not chosen:
        return segment
    excluded = np.isin(regimes.codes, [regimes.names.index(name) for name in chosen])
    if not excluded.any():
        note = f"Nothing to leave out: no instant is {' or '.join(chosen)}."
        return replace(segment, notes=(*segment.notes, note))
    mask = ~excluded if segment.mask is None else segment.mask & ~excluded
    _refuse_too_little(segment, mask, chosen)
    return replace(
        segment,
        mask=mask,
        excluded_regimes=tuple(dict.fromkeys((*segment.excluded_regimes, *chosen))),
        notes=(*segment.notes, _sentence(segment, mask, chosen)),
    )


def _modes(segment: Segment, recording: Recording) -> NDArray[np.int8]:
    """(2, N, M) modes at the recording's samples on either side of each instant.

    An instant on a sample has that sample on both sides; one that was interpolated draws on two.
    """
    if segment.sha256 != recording.sha256:
        raise SegmentError(
            f"{recording.source} is not the recording that this window was cut from; take the"
            f" modes from {segment.source}."
        )
    instants = segment.start + segment.time
    slack = 0.01 * segment.sample_time
    last = recording.samples - 1
    before = np.searchsorted(recording.time, instants + slack, side="right") - 1
    after = np.searchsorted(recording.time, instants - slack, side="left")
    rows = np.stack([before, after]).clip(0, last)
    followers = np.array(segment.vehicles[1:]) - 1
    return np.asarray(recording.mode[rows][:, :, followers])


def _refuse_too_little(segment: Segment, mask: NDArray[np.bool_], chosen: tuple[str, ...]) -> None:
    left = mask.sum(axis=0) * segment.sample_time
    worst = int(left.argmin())
    if left[worst] < LEAST_LEFT:
        raise SegmentError(
            f"{segment.source}: without {_listed(chosen)} only {left[worst]:.1f} s are left of"
            f" {segment.labels[worst + 1]}, and {LEAST_LEFT:g} s are the least to learn from; leave"
            " out less, or take another window."
        )


def _sentence(segment: Segment, mask: NDArray[np.bool_], chosen: tuple[str, ...]) -> str:
    shares = zip(segment.labels[1:], (~mask).mean(axis=0), strict=True)
    each = ", ".join(f"{name}: {100 * share:.0f} %" for name, share in shares)
    return f"Left out of the law's equations: {_listed(chosen)} ({each} of the instants)."


def _listed(names: tuple[str, ...]) -> str:
    return " and ".join([*filter(None, [", ".join(names[:-1])]), names[-1]])
