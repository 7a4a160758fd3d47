"""Regimes: what a follower does at each instant, and which instants a segment excludes for it.

    manual          a driver, not ACC, controls the vehicle (where the file has modes)
    standstill      speed at most 1 m/s
    catching up     time gap p/v above 2 s: the vehicle catches up or drives freely
    car-following   all else: where the model is meant to hold

Each instant has one regime, the first of these that applies. A file that gives no driver modes
has no manual instants here; `Regimes.mode_known` is False then.

Nothing is excluded unless the user asks. Excluded instants keep their data: the motion there is
measured as well as elsewhere, and dp/dt = Δv holds; only the equation of dv/dt does not count.
A choice of instants by the time gap depends on what the model is to explain, so it biases too.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from accpinn.errors import SegmentError
from accpinn.mask import Mask
from accpinn.recordings.checks import MOVING
from accpinn.recordings.recording import Mode, Recording
from accpinn.segment.cut import MINIMUM_DURATION
from accpinn.segment.quality import CAR_FOLLOWING, time_gaps
from accpinn.segment.segment import NothingToExclude, RegimesExcluded, Segment
from accpinn.units import frozen

FOLLOWING, CATCHING_UP, MANUAL, STANDSTILL = range(4)
REGIMES = ("car-following", "catching up", "manual", "standstill")
"""Names by code."""
EXCLUDABLE = REGIMES[CATCHING_UP:]
"""All but the first, for which the model is meant."""


@dataclass(frozen=True, eq=False)
class Regimes:
    """The regime of each of M followers at each of N instants."""

    codes: NDArray[np.uint8]
    """(N, M) indices into `REGIMES`."""
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

    Raises:
        SegmentError: for another recording.
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
    return Regimes(codes, tuple(known.tolist()))


def parse_regimes(names: str | Sequence[str]) -> tuple[str, ...]:
    """Regimes that can be excluded, from "catching-up,standstill" or from their names.

    Raises:
        SegmentError: for a name that is not known.
    """
    known = {spelt: name for name in EXCLUDABLE for spelt in (name, as_typed(name))}
    chosen = [part.strip() for part in (names.split(",") if isinstance(names, str) else names)]
    for part in chosen:
        if part not in known:
            listed = ", ".join(map(as_typed, EXCLUDABLE))
            raise SegmentError(f'"{part[:40]}" cannot be excluded; choose from {listed}.')
    return tuple(known[part] for part in chosen)


def as_typed(name: str) -> str:
    """A regime's name as it is typed, without spaces."""
    return name.replace(" ", "-")


def exclude_regimes(segment: Segment, regimes: Regimes, names: Sequence[str]) -> Segment:
    """The segment with a mask that excludes the instants of some regimes.

    Args:
        segment: the data; instants that its own mask excludes stay excluded.
        regimes: of the same segment.
        names: of the regimes to exclude, from `EXCLUDABLE`.

    Raises:
        SegmentError: when a name is not known, or too little of a follower's data remains.
    """
    named = parse_regimes(names)
    chosen = tuple(name for name in EXCLUDABLE if name in named)
    if not chosen:
        return segment
    excluded = np.isin(regimes.codes, [regimes.names.index(name) for name in chosen])
    if not excluded.any():
        return replace(segment, findings=(*segment.findings, NothingToExclude(chosen)))
    mask = ~excluded if segment.mask is None else segment.mask & ~excluded
    _refuse_too_little(segment, mask, chosen)
    shares = tuple((~mask).mean(axis=0).tolist())
    found = RegimesExcluded(regimes=chosen, vehicles=segment.vehicles[1:], shares=shares)
    return replace(
        segment,
        mask=mask,
        excluded_regimes=tuple(dict.fromkeys((*segment.excluded_regimes, *chosen))),
        findings=(*segment.findings, found),
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
    before = np.searchsorted(recording.time, instants + slack, side="right") - 1
    after = np.searchsorted(recording.time, instants - slack, side="left")
    rows = np.stack([before, after]).clip(0, recording.samples - 1)
    followers = np.array(segment.vehicles[1:]) - 1
    return np.asarray(recording.mode[rows][:, :, followers])


def _refuse_too_little(segment: Segment, mask: Mask, chosen: tuple[str, ...]) -> None:
    """Few instants, like a short window, hardly identify three parameters."""
    left = mask.sum(axis=0) * segment.sample_time
    worst = int(left.argmin())
    if left[worst] < MINIMUM_DURATION:
        raise SegmentError(
            f"{segment.source}: without {' and '.join(chosen)} only {left[worst]:.1f} s of"
            f" {segment.labels[worst + 1]} remain, where {MINIMUM_DURATION:g} s are needed; exclude"
            " less, or take another window."
        )
