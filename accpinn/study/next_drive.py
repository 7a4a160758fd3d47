"""The drive of the car ahead that would tell most of a follower's parameters, and how much.

A follower's posterior is where it begins; `inference.experiment` says what drives would add.
Widths of intervals before and after are those of normal distributions in the coordinates of
`inference.coordinates`. Windows of one car differ, so that a further drive, however long, narrows
the interval of its typical value only so far; of the car in that drive it may say more. A motorway
drive of the same length stands beside, as people usually have.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np
from scipy.special import ndtri

from accpinn.display import Displayed
from accpinn.errors import ConfigError
from accpinn.inference.coordinates import AT_SPEED, LEAST_GAP, free_of, time_gap_coordinates
from accpinn.inference.experiment import (
    Assessed,
    Drive,
    Limits,
    Prior,
    after_drive,
    best_drives,
    spread_of_draws,
)
from accpinn.methods.joint_likelihood import UNKNOWNS
from accpinn.methods.state_space import LEAST
from accpinn.model.cthp import Parameters
from accpinn.model.following import FollowingModel
from accpinn.recordings.synthetic import LeaderProfile, leader_speed
from accpinn.study.result import Result
from accpinn.units import FloatArray, MetresPerSecond, Seconds

if TYPE_CHECKING:
    from pandas import DataFrame

MOTORWAY = "motorway drive"
LIMITS = {
    "duration": (30.0, 1800.0), "slowest": (0.0, 60.0), "fastest": (1.0, 70.0),
    "acceleration": (0.2, 5.0),
}  # fmt: skip
"""Least and largest value of each limit."""
NARROWEST: MetresPerSecond = 2.0
"""Least difference of the speeds that a drive may have."""
RUNNERS_UP = 5
"""Drives that a table lists beside the best one."""


@dataclass(frozen=True)
class Narrowing:
    """How wide the interval of one parameter is, and would be: half of it, in its unit.

    In % it is the upper half of an interval that is symmetric in the logarithm.
    """

    name: str
    unit: str
    """"%" of a parameter whose interval is relative."""
    now: float
    """Of the typical value."""
    drive: float
    """Of the typical value, after the drive proposed."""
    motorway: float
    """After a motorway drive of the same length, likewise."""
    drive_alone: float
    """Of the car in the drive proposed, from that alone."""
    motorway_alone: float
    """Of the car in that motorway drive, likewise."""

    @property
    def relative_width(self) -> float:
        """Width of the interval from the drive alone, relative to that from the motorway drive.

        Where the interval is relative it is that of the logarithm.
        """
        if self.unit != "%":
            return self.drive_alone / self.motorway_alone
        return float(np.log1p(self.drive_alone / 100.0) / np.log1p(self.motorway_alone / 100.0))

    def text(self, half: float) -> str:
        """An interval of this parameter about its middle, in its unit, by its half."""
        if self.unit == "%":
            return f"-{100.0 * half / (100.0 + half):.0f}/+{half:.0f} %"
        return f"±{half:.{1 if self.unit == 'm' else 2}f} {self.unit}"


@dataclass(frozen=True, eq=False)
class NextDrive(Displayed):
    """A drive that is proposed, and what it would tell."""

    vehicle: int
    """The follower's number in the recording; 0 where all share their parameters."""
    name: str
    kind: str
    """The drive in words."""
    time: FloatArray
    """(N,) in s."""
    speed: FloatArray
    """(N,) of the car ahead in m/s."""
    gain: float
    """Expected information in nats."""
    motorway_gain: float
    """That of a motorway drive of the same length."""
    smallest_gap: float
    """Least gap in m of the simulated cars behind it."""
    level: float
    """Of the intervals."""
    model: str
    """Key of the CTHP."""
    narrowing: tuple[Narrowing, ...]
    offered: tuple[tuple[str, float], ...]
    """All drives that were compared, the best first, each with its information."""
    limits: Limits

    def __str__(self) -> str:
        """The drive, and a line a parameter."""
        lines = [
            f"Next drive for {self.name}: {self.kind}, {self.limits.duration:g} s;"
            f" {self.gain:.1f} nats, a motorway drive {self.motorway_gain:.1f}"
        ]
        for row in self.narrowing:
            lines.append(
                f"  {row.name}, in that drive: {row.text(row.drive_alone)}"
                f" (motorway {row.text(row.motorway_alone)}); typical value: now"
                f" {row.text(row.now)}, after the drive {row.text(row.drive)}"
            )
        return "\n".join([*lines, "More: .to_frame(), .to_csv(), .offered"])

    def to_frame(self) -> "DataFrame":
        """A row a parameter: half widths of its interval now, and after drives; see `Narrowing`."""
        from pandas import DataFrame

        return DataFrame([vars(row) for row in self.narrowing])

    def to_csv(self) -> str:
        """The drive as a table of time in s and speed in m/s."""
        rows = zip(self.time.tolist(), self.speed.tolist(), strict=True)
        return "\n".join(["time_s,speed_m_s", *(f"{t:.1f},{v:.3f}" for t, v in rows)]) + "\n"


@lru_cache(maxsize=8)  # a page is drawn again and again
def next_drive(
    result: Result, *, vehicle: int | None = None, duration: Seconds = 120.0,
    slowest: MetresPerSecond = 15.0, fastest: MetresPerSecond = 33.0, acceleration: float = 2.0,
) -> NextDrive:  # fmt: skip
    """The drive of the car ahead that tells most of a follower's α, β, τ, s₀, lag or delay.

    Args:
        result: with a posterior, of a CTHP.
        vehicle: the follower's number in the file; by default the first that is determined.
        duration: of the drive in s.
        slowest: least speed of the car ahead in m/s.
        fastest: its largest speed in m/s.
        acceleration: its largest acceleration and braking in m/s².

    Raises:
        ConfigError: for a result without such a posterior, a vehicle that is no follower, or limits
            within which nothing can be driven.

    Examples:
        >>> import accpinn
        >>> result = accpinn.fit(accpinn.sample("motorway"), vehicles="1-2")
        >>> drive = accpinn.next_drive(result, duration=60)
        >>> drive.gain > drive.motorway_gain
        True
    """
    limits = Limits(duration, slowest, fastest, acceleration)
    _check(limits)
    k = _follower(result, vehicle)
    spec, estimate = result.analysis.spec, result.estimate
    posterior, model = estimate.posterior, estimate.following
    assert posterior is not None  # as there is a follower
    free = free_of(spec)
    further = _coordinates(model, posterior.further[:, k])
    unknowns = estimate.arrays[UNKNOWNS]
    prior = Prior(spec, further, unknowns[min(k, len(unknowns) - 1)], free)
    ordinary = Drive(MOTORWAY, _motorway(limits))
    *ranked, usual = best_drives(prior, limits, [ordinary])
    if not ranked:
        raise ConfigError(
            "next_drive: behind every drive within these limits the car comes too close; allow less"
            " acceleration, or a smaller range of speeds."
        )
    best = ranked[0]
    typical = spread_of_draws(_coordinates(model, posterior.typical[:, k])[:, free])
    pair = typical, spread_of_draws(further[:, free])
    narrowing = tuple(_narrowing(model, free, further, pair, best, usual, posterior.level))
    info = result.info
    is_shared = info.shares(estimate.case)
    return NextDrive(
        0 if is_shared else info.vehicles[k + 1],
        "all followers" if is_shared else info.labels[k + 1],
        best.drive.kind,
        limits.time,
        best.drive.speed,
        best.gain,
        usual.gain,
        best.smallest_gap,
        posterior.level,
        model.key,
        narrowing,
        tuple((a.drive.kind, a.gain) for a in ranked),
        limits,
    )


def _check(limits: Limits) -> None:
    for name, (low, high) in LIMITS.items():
        value = getattr(limits, name)
        if not low <= value <= high:
            raise ConfigError(
                f"{name}: {value:g} is not allowed; choose a number from {low:g} to {high:g}."
            )
    if limits.fastest < limits.slowest + NARROWEST:
        raise ConfigError(
            f"fastest: {limits.fastest:g} m/s is not at least {NARROWEST:g} m/s above slowest,"
            f" {limits.slowest:g} m/s; choose a wider range of speeds."
        )


def can_propose(result: Result) -> bool:
    """Whether the estimate has what `next_drive` needs."""
    return result.posterior is not None and UNKNOWNS in result.estimate.arrays


def _follower(result: Result, vehicle: int | None) -> int:
    """The place of the follower that is asked for."""
    estimate, numbers = result.estimate, result.info.vehicles[1:]
    posterior = estimate.posterior
    if posterior is None or not can_propose(result):
        raise ConfigError(
            "next_drive: this estimate has no likelihood that tells what a drive would add; take"
            " the PiNN's preset calibrated, under a CTHP."
        )
    determined = np.isfinite(posterior.typical.alpha).all(axis=0)
    if vehicle is None:
        if not determined.any():
            raise ConfigError("next_drive: the data determine no follower; take a longer window.")
        return int(determined.argmax())
    if vehicle not in numbers:
        raise ConfigError(
            f"vehicle: {vehicle} is no follower here; choose from {', '.join(map(str, numbers))}."
        )
    k = numbers.index(vehicle)
    if not determined[k]:
        raise ConfigError(
            f"vehicle: the data do not determine the parameters of vehicle {vehicle}; choose"
            " another, or take a longer window."
        )
    return k


def _coordinates(model: FollowingModel, draws: Parameters) -> FloatArray:
    """(n, p) φ of draws (n,) of a CTHP."""
    gap = np.maximum(draws.time_gap(AT_SPEED), LEAST_GAP)
    sizes = np.maximum(draws.alpha, LEAST), np.maximum(draws.beta, LEAST), gap
    return np.column_stack([*np.log(sizes), *(getattr(draws, term) for term in model.terms)])


def _motorway(limits: Limits) -> FloatArray:
    """(N,) the speed of a car on a motorway, which changes its speed now and then."""
    middle = (limits.slowest + limits.fastest) / 2.0
    profile = LeaderProfile(middle, limits.slowest, limits.fastest, (8.0, 25.0), (0.4, 1.2), 0.15)
    return leader_speed(profile, limits.time, np.random.default_rng(0))


def _narrowing(
    model: FollowingModel,
    free: np.ndarray,
    draws: FloatArray,
    pair: tuple[FloatArray, FloatArray],
    best: Assessed,
    usual: Assessed,
    level: float,
) -> Iterator[Narrowing]:
    """The half widths of each parameter's interval, see `Narrowing`.

    The pair are the covariances of the typical value and of a further window.
    """
    typical, further = pair
    alone = np.diag(time_gap_coordinates(model.key).prior_spread[free] ** -2.0)
    after = {
        "now": typical[None],
        "drive": after_drive(typical, further, best.information)[0],
        "motorway": after_drive(typical, further, usual.information)[0],
        "drive_alone": np.linalg.inv(alone + best.information),
        "motorway_alone": np.linalg.inv(alone + usual.information),
    }
    reach = float(ndtri((1.0 + level) / 2.0))
    middle = np.median(draws, axis=0)
    gap, terms = float(np.exp(middle[2])), dict(zip(model.terms, model.parameters[3:], strict=True))
    slopes = {"alpha": {0: 1.0}, "beta": {1: 1.0}, "tau": {2: gap}, "time_gap": {2: gap}}
    for place, term in enumerate(terms, 3):
        slopes[term] = {place: 1.0}
        if term == "s0":
            slopes["tau"] = {2: gap, place: -1.0 / AT_SPEED}
    units = {"alpha": "%", "beta": "%", "tau": "s", "time_gap": "s"}
    units |= {term: parameter.unit for term, parameter in terms.items()}
    for name, slope in slopes.items():
        row = np.zeros(len(free))
        row[[*slope]] = [*slope.values()]
        row = row[free]
        if not row.any():
            continue
        widths = {
            key: reach * float(np.sqrt(np.einsum("i,dij,j->d", row, part, row).mean()))
            for key, part in after.items()
        }
        if units[name] == "%":
            widths = {key: 100.0 * float(np.expm1(width)) for key, width in widths.items()}
        yield Narrowing(name, units[name], **widths)
