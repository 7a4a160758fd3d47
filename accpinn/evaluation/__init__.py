"""Errors of an estimate on its windows, held out and outside of them.

Errors are of two kinds, never mixed. *Surrogate fit*: the method's own trajectories (the network's,
the spline's) against the data. The paper's tables report this; it measures how well a curve was
drawn, not how well the model predicts. *Closed-loop simulation*: only the leader's measured speed
is given, and the model's own states are integrated from the first measured instant on.

Of several windows each is held out in turn, some together. Of one window blocks of time are held
out, because the neighbours of a single instant predict it too well. Each third of the window is
simulated with the parameters fitted to the other two, from its own first measured instant on. No
time is left out between a block and the rest, so disturbances that last for some seconds across a
border make these errors slightly too small.

A block at either end of the window is cut off. One in the middle is masked, as a regime is, and
what was measured there is replaced by a bridge: the leader's speed is straight, each space-gap the
cubic with the values and slopes (Δv) at both ends, and the speeds follow from dp/dt = Δv. So
even a method that smooths over the block learns nothing of it, nothing is spliced, and both sides
keep their time. The bridge itself moves an estimate by less than half a percent.

A *validation* is the `ClosedLoop` on another window beside that on the window that the parameters
were learned from: if the errors on the other window are far larger, the parameters describe only
the first window.
"""

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from accpinn.errors import SegmentError
from accpinn.evaluation.closed_loop import (
    ClosedLoop,
    ClosedLoopFinding,
    TrackingErrors,
    collision_times,
    simulable,
    surrogate_errors,
)
from accpinn.findings import Finding, Labelled, Words
from accpinn.methods.estimate import Estimate
from accpinn.recordings import Recording
from accpinn.segment import Segment
from accpinn.segment.cut import MINIMUM_DURATION, cut
from accpinn.segment.windows import complete_windows
from accpinn.units import FloatArray, Seconds

BLOCKS = 3
"""Number of blocks of the same length that make up the window."""


@dataclass(frozen=True, eq=False)
class Evaluation:
    """Errors of an estimate on its one or several windows, and outside of them."""

    surrogate: TrackingErrors | None
    """Errors of the method's own curves; None where it has none."""
    closed_loop: TrackingErrors | None
    """Errors of the closed-loop simulation on the windows; None where nothing is simulated."""
    blocks: tuple[ClosedLoop, ...]
    """The blocks that were held out one by one, without errors where too little is left to estimate
    from; empty where nothing was held out."""
    out_of_window: TrackingErrors | None
    """Closed-loop errors outside the windows; None where nothing is simulated there."""
    out_of_window_seconds: Seconds
    """Duration of what is simulated outside the windows."""
    findings: tuple[ClosedLoopFinding, ...]
    """Collisions, reversing and divergence in the closed-loop simulation on the data."""
    out_of_window_findings: tuple[ClosedLoopFinding, ...]
    """Collisions, reversing and divergence outside the windows."""

    @property
    def holdout(self) -> TrackingErrors | None:
        """Closed-loop errors on all blocks together, each with parameters fitted to the others."""
        return of_blocks(self.blocks)

    def collision_times(self, vehicles: Sequence[int]) -> FloatArray:
        """(M,) time of each follower's first collision on the data, in s; nan without one."""
        return collision_times(self.findings, vehicles)


def evaluate(
    segments: Segment | Sequence[Segment],
    estimate: Estimate,
    recording: Recording | None = None,
    blocks: tuple[ClosedLoop, ...] = (),
) -> Evaluation:
    """Errors of an estimate in its windows and outside of them.

    Args:
        segments: the window that the parameters were estimated from, or (K,) windows of one run.
        estimate: by any method.
        recording: what the windows were cut from; without it nothing outside is simulated.
        blocks: what `cross_validate` found.

    Examples:
        >>> import accpinn
        >>> result = accpinn.fit(accpinn.sample("motorway"), vehicles="1-2", method="splines")
        >>> found = accpinn.evaluate(result.segments, result.estimate)
        >>> found.closed_loop.gap_mae.shape
        (1,)
    """
    windows = (segments,) if isinstance(segments, Segment) else tuple(segments)
    inside = [ClosedLoop.of(part, estimate) for part in windows]
    outside: list[ClosedLoop] = []  # in complete windows beside these, each long enough for one
    if recording:
        vehicles, used = windows[0].vehicles, [part.window for part in windows]
        for window in complete_windows(recording, vehicles, used):
            piece = cut(recording, window.start, window.duration, vehicles)
            if not estimate.following.is_linear:
                piece = from_following(piece)
            simulation = ClosedLoop.of(piece, estimate)
            if simulation.errors:
                outside.append(simulation)
    surrogate = surrogate_errors(windows, estimate)
    return Evaluation(
        surrogate=pooled((s.samples, part) for s, part in zip(windows, surrogate, strict=False)),
        closed_loop=pooled(
            (s.samples, part.errors) for s, part in zip(windows, inside, strict=True)
        ),
        blocks=blocks,
        out_of_window=of_blocks(outside),
        out_of_window_seconds=float(sum(part.window.duration for part in outside)),
        findings=tuple(event for part in inside for event in part.findings),
        out_of_window_findings=tuple(event for part in outside for event in part.findings),
    )


def cross_validate(
    segments: Sequence[Segment], estimate: Callable[[tuple[Segment, ...]], Estimate]
) -> tuple[ClosedLoop, ...]:
    """Hold out parts of the data in turn, and simulate each with parameters from the rest.

    The parts of a single window are its blocks; several windows are held out whole, every
    `BLOCKS`-th together. ``estimate`` is the method, from windows to an estimate. A block in which
    at no instant all vehicles are measured has nothing to compare, so none is held out there.
    """
    if len(segments) > 1:
        folds = [tuple(segments[k::BLOCKS]) for k in range(min(BLOCKS, len(segments)))]
        return tuple(part for fold in folds for part in _fold(segments, fold, estimate))
    (segment,) = segments
    ends = [round(end) for end in np.linspace(0, segment.samples, BLOCKS + 1)]
    return tuple(
        _block(segment, first, end, estimate)
        for first, end in pairwise(ends)
        if simulable(segment.part(first, end))
    )


def _fold(
    segments: Sequence[Segment],
    fold: tuple[Segment, ...],
    estimate: Callable[[tuple[Segment, ...]], Estimate],
) -> Iterator[ClosedLoop]:
    """The windows of a fold, with parameters from the others."""
    try:
        refitted = estimate(tuple(segment for segment in segments if segment not in fold))
    except SegmentError:  # too little is left for this method
        yield from (ClosedLoop(segment.window, None) for segment in fold)
        return
    yield from (ClosedLoop.of(segment, refitted) for segment in fold if simulable(segment))


def pooled(parts: Iterable[tuple[float, TrackingErrors | None]]) -> TrackingErrors | None:
    """The errors of several stretches as on one, each with its weight.

    None without any stretch, or where one has no errors.
    """
    weighted = [*parts]
    computed = [errors for _, errors in weighted if errors is not None]
    if not computed or len(computed) < len(weighted):
        return None
    weights = [weight for weight, _ in weighted]
    return TrackingErrors(
        np.average([errors.speed_mae for errors in computed], axis=0, weights=weights),
        np.average([errors.gap_mae for errors in computed], axis=0, weights=weights),
    )


def of_blocks(blocks: Sequence[ClosedLoop]) -> TrackingErrors | None:
    """The errors of all blocks together, by their durations."""
    return pooled((block.window.duration, block.errors) for block in blocks)


def from_following(segment: Segment) -> Segment:
    """The segment from the first instant on at which every follower is in car-following.

    A model that is no CTHP may have a gap at standstill, below which it would drive backwards. The
    segment stays as it is where too little would be left.
    """
    close = segment.car_following.all(axis=1)
    left = segment.samples - int(close.argmax())
    if not close.any() or left * segment.sample_time < MINIMUM_DURATION:
        return segment
    return segment.part(segment.samples - left, segment.samples)


def without(segment: Segment, first: int, end: int) -> Segment:
    """The segment without its samples ``first`` to ``end`` - 1."""
    if first == 0:
        return segment.part(end, segment.samples)
    if end == segment.samples:
        return segment.part(0, first)
    mask = np.ones(segment.gaps.shape, dtype=bool) if segment.mask is None else segment.mask.copy()
    mask[first:end] = False
    speeds, gaps = segment.speeds.copy(), segment.gaps.copy()
    speeds[first:end], gaps[first:end] = _bridge(segment, first - 1, end)
    return replace(segment, speeds=speeds, gaps=gaps, mask=mask)


def _block(
    segment: Segment,
    first: int,
    end: int,
    estimate: Callable[[tuple[Segment, ...]], Estimate],
) -> ClosedLoop:
    held = segment.part(first, end)
    try:
        return ClosedLoop.of(held, estimate((without(segment, first, end),)))
    except SegmentError:  # too little is left for this method
        return ClosedLoop(held.window, None)


def _bridge(segment: Segment, near: int, far: int) -> tuple[FloatArray, FloatArray]:
    """Speeds (K, M+1) and gaps (K, M) between two samples, computed from these two alone."""
    from scipy.interpolate import CubicHermiteSpline  # takes a second to import

    ends, times = [near, far], segment.time[near + 1 : far]
    relative = segment.speeds[ends, :-1] - segment.speeds[ends, 1:]
    gaps = CubicHermiteSpline(segment.time[ends], segment.gaps[ends], relative)
    leader = np.interp(times, segment.time[ends], segment.speeds[ends, 0])[:, None]
    return np.hstack([leader, leader - np.cumsum(gaps(times, 1), axis=1)]), gaps(times)


class ValidationOverlaps(Finding, frozen=True):
    """The window of the validation overlaps one that was learned from."""

    text = (
        "The validation window shares {seconds:.0f} s with what was learned from, so its errors are"
        " too small; choose one outside."
    )

    seconds: Seconds
    """Duration of the overlap."""


class OtherVehicles(Finding, frozen=True):
    """The vehicles of the validation have other names than those learned from."""

    text = (
        "The validation is on other vehicles: {pairs}. The errors show how well the parameters of"
        " one car describe another."
    )

    learned: tuple[str, ...]
    """Labels of the followers that were learned from."""
    validated: tuple[str, ...]
    """Labels of the followers of the validation, in the same order."""

    def _words(self, about: Labelled) -> Words:
        pairs = zip(self.learned, self.validated, strict=True)
        replaced = (f"{new} instead of {old}" for old, new in pairs if old != new)
        return {"pairs": "; ".join(replaced)}


def validation_findings(
    segments: Sequence[Segment], other: Segment
) -> tuple[ValidationOverlaps | OtherVehicles, ...]:
    """Why the errors of a validation may say less than they seem to.

    The other segment has as many followers, in the same order.

    Raises:
        SegmentError: if the number of followers differs.
    """
    if other.followers != segments[0].followers:
        raise SegmentError(
            f"{other.source}, {other.window}: {other.followers} followers cannot validate the"
            f" parameters of {segments[0].followers}; choose as many."
        )
    findings: list[ValidationOverlaps | OtherVehicles] = []
    segment = segments[0]
    same_run = (segment.sha256, segment.source) == (other.sha256, other.source)
    if same_run and np.isin(other.vehicles[1:], segment.vehicles[1:]).any():
        shared = sum(
            max(0.0, min(part.window.end, other.window.end)
                - max(part.window.start, other.window.start))
            for part in segments
        )  # fmt: skip
        if shared > 0:
            findings.append(ValidationOverlaps(float(shared)))
    # In another run the same car may have another place; in one run two may have the same name.
    learned, validated = ((s.labels if same_run else s.names)[1:] for s in (segment, other))
    if learned != validated:
        findings.append(OtherVehicles(segment.labels[1:], other.labels[1:]))
    return tuple(findings)
