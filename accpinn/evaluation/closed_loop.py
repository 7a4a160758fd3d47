"""Errors of trajectories against the data, and the closed-loop simulation with its failures.

A follower that diverges has no errors, nor have those behind it, as a mean over what comes after
has no meaning. One that collides or drives backwards keeps its errors, because the simulation goes
on through the vehicle ahead; the finding belongs wherever such an error is shown.

Missing samples have no errors. Where the leader's speed is missing for longer than a straight line
may bridge, the simulation ends, and starts anew once all vehicles are measured again.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Self

import numpy as np

from accpinn.findings import Finding
from accpinn.methods.estimate import Estimate
from accpinn.methods.registry import METHODS
from accpinn.model.cthp import Parameters, Trajectories, collides
from accpinn.model.registry import simulate
from accpinn.recordings import Window
from accpinn.segment import Segment
from accpinn.segment.cut import BRIDGE, SLACK
from accpinn.units import (
    FloatArray,
    Mask,
    Metres,
    MetresPerSecond,
    Seconds,
    Stretch,
    nanmean,
    stretches,
)

DIVERGED: Metres = 1000.0
"""Gap beyond which a follower no longer follows; measured gaps stay below 200 m."""
BACKWARDS: MetresPerSecond = -0.5
"""Speed below which a vehicle drives backwards: the model has no standstill and comes to rest with
slower backward motion."""


@dataclass(frozen=True, eq=False)
class TrackingErrors:
    """Mean absolute errors against the data, per vehicle; nan where they have no meaning."""

    speed_mae: FloatArray
    """(M+1,) in m/s, leader first."""
    gap_mae: FloatArray
    """(M,) in m."""


class SimulatedCollision(Finding, frozen=True):
    """A follower touches the vehicle ahead in the closed-loop simulation, but not in the data."""

    text = (
        "In the closed-loop simulation, {vehicle} collides with the vehicle ahead at {time:.1f} s;"
        " its gap falls to {smallest_gap:z.1f} m."
    )

    vehicle: int
    time: Seconds
    """Time of the first contact, from the recording's first sample."""
    smallest_gap: Metres
    """Smallest gap of the whole simulation; below zero."""


class SimulatedReversing(Finding, frozen=True):
    """A follower drives backwards in the closed-loop simulation."""

    text = (
        "In the closed-loop simulation, {vehicle} drives backwards at {time:.1f} s, at up to"
        " {speed:.1f} m/s."
    )

    vehicle: int
    time: Seconds
    """First such instant, from the recording's first sample."""
    speed: MetresPerSecond
    """Largest backward speed."""


class SimulatedDivergence(Finding, frozen=True):
    """A follower's gap leaves ±`DIVERGED` in the closed-loop simulation."""

    text = (
        "In the closed-loop simulation, {vehicle} diverges: its gap leaves"
        f" ±{DIVERGED:.0f} m at"
        " {time:.1f} s, so neither it nor the vehicles behind it have closed-loop errors."
    )

    vehicle: int
    time: Seconds
    """First such instant, from the recording's first sample."""


ClosedLoopFinding = SimulatedCollision | SimulatedReversing | SimulatedDivergence


def tracking_errors(segment: Segment, trajectories: Trajectories) -> TrackingErrors:
    """Errors of trajectories given on the segment's instants, where a sample was measured.

    A vehicle without errors has trajectories of nan; single instants of nan are not compared.
    """
    return TrackingErrors(
        nanmean(np.abs(trajectories.speeds - segment.measured_speeds)),
        nanmean(np.abs(trajectories.gaps - segment.measured_gaps)),
    )


def surrogate_errors(segments: Sequence[Segment], estimate: Estimate) -> tuple[TrackingErrors, ...]:
    """(K,) errors of the method's curves; empty for one without, or that fits in closed loop."""
    if not estimate.curves or METHODS[estimate.method].is_closed_loop:
        return ()
    return tuple(map(tracking_errors, segments, estimate.curves))


def closed_loop(segment: Segment, estimate: Estimate) -> Trajectories | None:
    """The closed-loop simulation of an estimate; see `simulated`."""
    return simulated(segment, estimate.model, estimate.parameters)


def simulated(segment: Segment, model: str, parameters: Parameters) -> Trajectories | None:
    """The closed-loop simulation of a model with parameters (M,) behind the measured leader.

    Returns:
        The motion on the segment's instants, nan where the leader's speed is missing for long;
        None where τ is undetermined, or at no instant all vehicles are measured.
    """
    if not np.isfinite(parameters.everything).all() or not (pieces := simulable(segment)):
        return None
    speeds, gaps = np.full_like(segment.speeds, np.nan), np.full_like(segment.gaps, np.nan)
    for piece in pieces:
        rows, first = piece.rows, piece.first
        time, leader = segment.time[rows], segment.speeds[rows, 0]
        start = segment.speeds[first, 1:], segment.gaps[first]
        with np.errstate(over="ignore", invalid="ignore"):  # divergence is found below
            motion = simulate(model, parameters, time, leader, *start)
        speeds[rows], gaps[rows] = motion.speeds, motion.gaps
    return Trajectories(segment.time, speeds, gaps)


def simulable(segment: Segment) -> list[Stretch]:
    """The stretches that can be simulated.

    The leader's speed is known throughout; each begins where all vehicles are measured.
    """
    if segment.missing is None:
        return [Stretch(0, segment.samples - 1)]
    leader: Mask = np.ones(segment.samples, bool)
    for block in stretches(segment.missing[:, 0]):
        leader[block.rows] = len(block) * segment.sample_time <= BRIDGE + SLACK
    complete: Mask = np.asarray(~segment.missing.any(axis=1))
    pieces = []
    for stretch in stretches(leader):
        if complete[stretch.rows].any():
            first = stretch.first + int(complete[stretch.rows].argmax())
            pieces.append(Stretch(first, stretch.last))
    return [piece for piece in pieces if len(piece) > 1]


@dataclass(frozen=True, eq=False)
class ClosedLoop:
    """Errors and events of the closed-loop simulation of one window."""

    window: Window
    errors: TrackingErrors | None
    """They are nan from the first follower that diverges on; None where nothing is simulated."""
    findings: tuple[ClosedLoopFinding, ...] = ()

    @classmethod
    def of(cls, segment: Segment, estimate: Estimate) -> Self:
        """The simulation of an estimate behind the leader of a segment."""
        motion = closed_loop(segment, estimate)
        if motion is None:
            return cls(segment.window, None)
        void = np.logical_or.accumulate(_diverged(segment, motion).any(axis=0))
        speeds = np.where(np.r_[False, void], np.nan, motion.speeds)
        gaps = np.where(void, np.nan, motion.gaps)
        errors = tracking_errors(segment, Trajectories(motion.time, speeds, gaps))
        return cls(segment.window, errors, closed_loop_findings(segment, motion))


def closed_loop_findings(
    segment: Segment, simulated: Trajectories
) -> tuple[ClosedLoopFinding, ...]:
    """Collisions, reversing and divergence in a closed-loop simulation, follower by follower.

    A collision counts only where the measured gap is positive.
    """
    touching = collides(simulated.gaps) & (segment.measured_gaps > 0)
    diverged = _diverged(segment, simulated)
    floor = np.minimum(BACKWARDS, segment.speeds[:, 1:].min(axis=0))
    backwards = (simulated.speeds[:, 1:] < floor) & ~diverged
    events: list[ClosedLoopFinding] = []
    for k, vehicle in enumerate(segment.vehicles[1:]):
        if touching[:, k].any():
            smallest = max(float(np.nanmin(simulated.gaps[:, k])), -DIVERGED)
            events.append(SimulatedCollision(vehicle, _first(segment, touching[:, k]), smallest))
        if backwards[:, k].any():
            speed = -float(simulated.speeds[backwards[:, k], k + 1].min())
            events.append(SimulatedReversing(vehicle, _first(segment, backwards[:, k]), speed))
        if diverged[:, k].any():
            events.append(SimulatedDivergence(vehicle, _first(segment, diverged[:, k])))
    return tuple(events)


def collision_times(findings: Sequence[ClosedLoopFinding], vehicles: Sequence[int]) -> FloatArray:
    """(M,) the time of each follower's first collision in s, from the recording's first sample.

    It is nan for one that never collides. The findings are all those of one closed-loop simulation,
    the vehicles (M+1,) numbers in the file, leader first.
    """
    collisions = [finding for finding in findings if isinstance(finding, SimulatedCollision)]
    times = {collision.vehicle: collision.time for collision in collisions}
    return np.array([times.get(vehicle, np.nan) for vehicle in vehicles[1:]])


def _diverged(segment: Segment, simulated: Trajectories) -> Mask:
    """(N, M) True from the first instant on at which a follower's gap leaves ±`DIVERGED`."""
    far = ~(np.abs(simulated.gaps) <= DIVERGED)
    run = np.zeros(len(far), bool)
    for piece in simulable(segment):
        run[piece.rows] = True
    return np.asarray(np.logical_or.accumulate(far & run[:, None], axis=0))


def _first(segment: Segment, when: Mask) -> Seconds:
    """The first instant at which ``when`` (N,) is True, from the recording's first sample."""
    return float(segment.start + segment.time[when.argmax()])
