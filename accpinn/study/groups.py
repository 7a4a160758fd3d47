"""The estimates of a batch by groups: typical value, spread between windows and between vehicles.

Each follower of a window has a posterior under the batch's model. The windows of one vehicle give
draws of its typical value (`inference.typical`), the same as for one recording. The vehicles of a
group are one level up what windows are below: their typical values differ as `inference.population`
describes, with what all cars taught as the prior; the centre is the typical value of the group. So
the interval of a group that has few vehicles is as wide as vehicles are known to differ. All of it
is sampled: no estimate is left out because it is zero, and no window or vehicle counts more than it
knows.

The share of vehicles that are string stable is the mean of the probabilities p_v that the typical
value of vehicle v is. For its interval, the number of stable ones among V vehicles is the sum of
independent events with these probabilities, and given that number S the share has the distribution
Beta(S + 1/2, V - S + 1/2) (Jeffreys); the interval has the quantiles of this mixture.
"""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from scipy.optimize import brentq
from scipy.special import betainc
from scipy.stats import multivariate_normal

from accpinn.arguments import check_level
from accpinn.errors import ConfigError
from accpinn.inference.coordinates import AT_SPEED, coordinates_of
from accpinn.inference.intervals import LEVEL
from accpinn.inference.population import WITHIN, Car, sampled_population
from accpinn.inference.typical import car_of
from accpinn.inference.window_posterior import DRAWS, STABILITY_DRAWS
from accpinn.methods import one_thread
from accpinn.methods.estimate import SPEEDS, Span
from accpinn.model.cthp import Parameters
from accpinn.model.registry import BEST, FOLLOWING, time_gap, value_of
from accpinn.model.spec import ModelSpec
from accpinn.segment import median_by_duration
from accpinn.stability.criteria import exact_margin, l2_margin, peaks
from accpinn.stability.margin import VehicleMargin, l2_margins, margins
from accpinn.study.rows import COLUMNS
from accpinn.study.studies import read_posteriors, read_request, read_rows
from accpinn.units import FloatArray, MetresPerSecond, Quantity, interval_ends

GROUPABLE = ("make", "model", "distance_setting", "campaign", "mode", "name", "file", "date")
"""Columns that rows may be grouped by."""
BY = ("make", "model", "distance_setting")
PLACE = ["sha256", "start", "vehicle"]
"""Columns that name one follower of one window, whatever the method."""
POSTERIOR = "posterior"
"""The column of the frame with each follower's posterior draws; it is in no file."""
FURTHEST = 100.0
"""Largest coordinate that a draw can have, as in a file that somebody has changed."""
KEPT_CARS = 1024
"""Vehicles whose draws are kept, so that other filters and groups take no time."""


@dataclass(frozen=True, eq=False)
class Group:
    """What the windows of a group say, under one model."""

    values: tuple[str, ...]
    """Values of the columns that it is grouped by; empty where a header does not tell."""
    windows: int
    """Followers of windows: K."""
    vehicles: int
    """Different names within a campaign; where a file names none, its vehicles count by number."""
    mean_time_gap: Quantity
    """In s: the median, and the quartiles of the windows."""
    model: str
    level: float
    """Level of all intervals but the quartiles."""
    drawn: Car
    """The group as one: its draws are those of a vehicle where it is one vehicle."""
    cars: tuple[Car, ...]
    """Its vehicles that some window determines."""
    speeds: FloatArray
    """(V,) their median speeds in m/s."""
    driven: tuple[MetresPerSecond, MetresPerSecond]
    """Lowest and highest speed in its windows; nan where a study does not tell."""
    differing: tuple[Car, ...]
    """Those with several windows."""
    point: Parameters | None = None
    """One parameter set in place of the mean of the draws, as the joint estimate of all windows."""

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the model's parameters."""
        return FOLLOWING[self.model].names

    def span(self, name: str) -> Span:
        """One parameter, by its name."""
        return self._span(lambda part: value_of(self.model, part, name))

    def gain(self, name: str) -> Span:
        """α or β; of a model that is no CTHP at the median speed of the group's vehicles."""
        return self._span(lambda part: getattr(part, name))

    def time_gap(self, speed: MetresPerSecond) -> Span:
        """The time gap in equilibrium at a speed, in s."""
        return self._span(lambda part: time_gap(self.model, part, speed))

    def is_driven(self, speed: MetresPerSecond) -> bool:
        """Whether its windows hold a speed; what is said of another is extrapolated."""
        low, high = self.driven
        return not (speed < low or speed > high)

    @property
    def typical(self) -> Parameters:
        """The typical parameters; of a model that is no CTHP linearised at `median_speed`."""
        return self._parts[0]

    @property
    def median_speed(self) -> MetresPerSecond:
        """The median of its vehicles' median speeds, in m/s."""
        return float(np.median(self.speeds)) if len(self.speeds) else AT_SPEED

    @cached_property
    def margins(self) -> VehicleMargin:
        """How far its time gap is from string stability by both norms, at `median_speed`."""
        middle, typical, _ = self._parts
        shown = Parameters.of(middle.everything[None])
        draws = Parameters.of(typical.everything[:, None])
        return margins(shown, self.median_speed, draws, self.level).vehicles[0]

    @cached_property
    def growth(self) -> Quantity:
        """The largest gain max |H| over all frequencies; 1 where none is amplified."""
        middle, typical, _ = self._parts
        if not np.isfinite(middle.complete).all():
            return Quantity(np.nan, np.nan, np.nan)
        drawn = peaks(typical[:: max(1, len(typical.alpha) // STABILITY_DRAWS)]).gain
        low, high = interval_ends(drawn, self.level)
        value = float(peaks(middle).gain)  # of a mean, so it may lie just outside
        return Quantity(value, min(float(low), value), max(float(high), value))

    @cached_property
    def margin(self) -> Quantity:
        """By how much the time gap exceeds the smallest L₂ string stable one, in s."""
        middle, typical, _ = self._parts
        if not np.isfinite(middle.complete).all():
            return Quantity(np.nan, np.nan, np.nan)
        drawn = typical[:: max(1, len(typical.alpha) // STABILITY_DRAWS)]
        return l2_margins(middle[None], drawn[:, None], self.level)[0].distance

    @cached_property
    def between_windows(self) -> dict[str, Quantity]:
        """Within what deviation 68 % of a vehicle's windows lie; empty where none has two.

        That of a CTHP's terms and of parameters that may be negative is absolute, all others are
        relative. The keys are the model's parameters; of a CTHP time_gap (at 100 km/h) is in place
        of tau.
        """
        variances = [np.diagonal(car.covariance, axis1=1, axis2=2) for car in self.differing]
        return self._spread(np.mean(variances, axis=0)) if variances else {}

    @cached_property
    def between_vehicles(self) -> dict[str, Quantity]:
        """How far the typical values of vehicles differ, as above; empty for one vehicle."""
        if len(self.cars) < 2:
            return {}
        return self._spread(np.diagonal(self.drawn.covariance, axis1=1, axis2=2))

    @cached_property
    def l2_stable(self) -> Quantity:
        """The share of vehicles that are L₂ string stable."""
        return self._share(l2_margin)

    @cached_property
    def linf_stable(self) -> Quantity:
        """The share of vehicles that are L∞ string stable, by the exact criterion."""
        return self._share(exact_margin)

    def _share(self, margin: Any) -> Quantity:
        space = coordinates_of(self.model)
        drawn = (
            space.parameters(_evenly(space.possible(car.value, at), STABILITY_DRAWS), at)
            for car, at in zip(self.cars, self.speeds.tolist(), strict=True)
        )
        stable = [(margin(part) >= 0).mean() for part in drawn]
        return share(np.array(stable, float), self.level)

    def _span(self, of: Callable[[Parameters], FloatArray]) -> Span:
        value, typical, further = map(of, self._parts)
        return Span.of(value, (typical, further), self.level)

    @cached_property
    def _parts(self) -> tuple[Parameters, Parameters, Parameters]:
        at, space = self.median_speed, coordinates_of(self.model)
        value, further = (
            space.parameters(space.possible(phi, at), at)
            for phi in (self.drawn.value, self.drawn.further)
        )
        return self.point or space.parameters(self.drawn.middle, at), value, further

    def _spread(self, variances: FloatArray) -> dict[str, Quantity]:
        spreads = coordinates_of(self.model).spreads
        deviations = WITHIN * np.sqrt(variances) * [*spreads.values()]
        low, high = interval_ends(deviations, self.level)
        rows = np.array([np.median(deviations, axis=0), low, high]).T
        return {name: Quantity(*map(float, row)) for name, row in zip(spreads, rows, strict=True)}


@dataclass(frozen=True)
class Groups:
    """The groups of a batch."""

    by: tuple[str, ...]
    model: str
    level: float
    """Level of all intervals but the quartiles."""
    groups: tuple[Group, ...]

    def ranked(self, speed: MetresPerSecond) -> "Groups":
        """The groups by their time gap at a speed, those that drive it before extrapolated ones."""

        def place(part: Group) -> tuple[bool, float]:
            gap = part.time_gap(speed).value
            return not part.is_driven(speed), gap if np.isfinite(gap) else np.inf

        return replace(self, groups=tuple(sorted(self.groups, key=place)))

    def to_frame(self) -> pd.DataFrame:
        """One row a group, as `Result.to_frame` has one a follower.

        Columns are what it is grouped by, windows, vehicles, following_model, mean_time_gap
        (median, and the quartiles as .._low and .._high), the typical time gap at 50 and 100 km/h
        and the parameters with their intervals, margin_l2 (of the time gap, in s), and the shares
        l2_stable and linf_stable.
        """
        rows = []
        for group in self.groups:
            row: dict[str, Any] = dict(zip(self.by, group.values, strict=True))
            row |= {"windows": group.windows, "vehicles": group.vehicles}
            row["following_model"] = self.model
            quantities: dict[str, Quantity] = {"mean_time_gap": group.mean_time_gap}
            for speed in SPEEDS:
                quantities[f"time_gap_at_{3.6 * speed:.0f}_kmh_s"] = group.time_gap(speed)
            quantities |= {name: group.span(name) for name in group.names}
            quantities |= {"margin_l2": group.margin}
            quantities |= {"l2_stable": group.l2_stable, "linf_stable": group.linf_stable}
            for name, of in quantities.items():
                row |= {name: of.value, f"{name}_low": of.lower, f"{name}_high": of.upper}
            for speed in SPEEDS:
                key = f"time_gap_at_{3.6 * speed:.0f}_kmh_s_extrapolated"
                row[key] = not group.is_driven(speed)
            rows.append(row)
        return pd.DataFrame(rows)


def read_study(study: str | Path) -> pd.DataFrame:
    """The rows of a batch with the columns of `COLUMNS` and `POSTERIOR`, also while it runs.

    What is no number is nan. ``attrs["model"]`` is the batch's model.

    Raises:
        RecordingError: where there is no batch, or its file is damaged.

    Examples:
        >>> import accpinn
        >>> rows = accpinn.read_study("study")  # the folder that batch wrote to
        >>> rows.make.tolist()
        ['Volvo', 'Audi']
    """
    folder = Path(study)
    frame = pd.DataFrame(read_rows(folder), columns=[column.name for column in COLUMNS])
    frame = frame.astype({column.name: float for column in COLUMNS if column.kind == "double"})
    request = read_request(folder)
    model = request.model if request else BEST
    drawn = read_posteriors(folder, model)
    places = frame[PLACE].itertuples(index=False, name=None)
    frame[POSTERIOR] = pd.Series([drawn.get(place) for place in places], frame.index, object)
    frame.attrs["model"] = model
    return frame


@one_thread
def group(rows: pd.DataFrame, by: Sequence[str] = BY, level: float = LEVEL) -> Groups:
    """Group the estimates of a batch.

    Args:
        rows: as `read_study` gives them, or some of these.
        by: columns, from `GROUPABLE`.
        level: of the intervals, above 0 and below 1.

    Raises:
        ConfigError: for a column or a level that is not allowed.

    Examples:
        >>> import accpinn
        >>> groups = accpinn.group(accpinn.read_study("study"), by=("make",))
        >>> groups.to_frame()[["make", "windows"]].values.tolist()
        [['Audi', 1], ['Volvo', 1]]
    """
    for name in by:
        if name not in GROUPABLE:
            raise ConfigError(
                f"by: {str(name)[:40]} is not known; choose from {', '.join(GROUPABLE)}."
            )
    check_level(level)
    if POSTERIOR not in rows:
        raise ConfigError(
            "rows: the frame lacks the draws of each posterior, which are in no Parquet file; read"
            " the study's folder by accpinn.read_study."
        )
    model = rows.attrs.get("model", BEST)
    part = rows.drop_duplicates(PLACE)
    part = part.assign(**{name: part[name].fillna("").astype(str) for name in by})
    parts = part.groupby(list(by)) if by else [((), part)] * (len(part) > 0)
    groups = [_group(key, members, model, level) for key, members in parts]
    return Groups(tuple(by), model, level, tuple(groups))


def _group(key: Iterable[Any], rows: pd.DataFrame, model: str, level: float) -> Group:
    gaps = rows["mean_time_gap"].dropna()
    quartiles = gaps.quantile([0.5, 0.25, 0.75]).tolist() if len(gaps) else [np.nan] * 3
    nameless = rows["make"].fillna("") == ""
    who = rows[["campaign", "name"]].fillna("").assign(sha256=rows["sha256"].where(nameless, ""))
    who = who.reset_index(drop=True)
    cars, differing, speeds = [], [], []
    # In Case I the followers of a platoon have one posterior, so they count as one.
    platoon = rows[["sha256", "leader", "start", "duration"]].reset_index(drop=True)
    is_again = platoon.duplicated() & (rows["case"] == "I").to_numpy()
    for _, members in who[~is_again].groupby(list(who), sort=False, dropna=False):
        of_vehicle = rows.iloc[members.index]
        posteriors = tuple(
            raw for drawn in of_vehicle[POSTERIOR] if (raw := _checked(drawn, model))
        )
        if posteriors:
            medians, durations = of_vehicle[["median_speed", "duration"]].to_numpy(float).T
            speeds.append(float(np.nan_to_num(median_by_duration(medians[:, None], durations)[0])))
            cars.append(_car(posteriors, model, speeds[-1]))
            differing += cars[-1:] if len(posteriors) > 1 else []
    return Group(
        values=tuple(map(str, key)),
        windows=len(rows),
        vehicles=len(who.drop_duplicates()),
        mean_time_gap=Quantity(*quartiles),
        model=model,
        level=level,
        drawn=_together(cars, model),
        cars=tuple(cars),
        speeds=np.array(speeds),
        driven=(float(rows["lowest_speed"].min()), float(rows["highest_speed"].max())),
        differing=tuple(differing),
    )


def _checked(posterior: Any, model: str) -> bytes:
    """The bytes of a posterior that can be one, else none."""
    if posterior is None or posterior.shape[-1] != coordinates_of(model).count:
        return b""
    if not (np.abs(posterior) <= FURTHEST).all() or not np.ptp(posterior, axis=0).any():
        return b""
    return bytes(posterior.tobytes())


@lru_cache(maxsize=KEPT_CARS)
def _car(windows: tuple[bytes, ...], model: str, speed: MetresPerSecond) -> Car:
    """The typical value of one vehicle, from the draws of its windows."""
    space = coordinates_of(model)
    drawn = (np.frombuffer(raw).reshape(-1, space.count) for raw in windows)
    return car_of(np.array([space.possible(phi, speed) for phi in drawn]), ModelSpec(model))


def _together(cars: Sequence[Car], model: str) -> Car:
    """A group's vehicles as one: its typical value, and a further window of a further vehicle."""
    space = coordinates_of(model)
    if len(cars) < 2:
        return cars[0] if cars else car_of(np.empty((0, 1, space.count)), ModelSpec(model))
    population = space.population
    values = np.array([_evenly(car.value, DRAWS) for car in cars])
    prior = (
        multivariate_normal(population.centre, population.cars)
        .logpdf(values)
        .reshape(values.shape[:2])
    )
    sampled = sampled_population(values, prior, population.of_cars)
    value, covariance, further = sampled
    each = np.arange(len(value))
    deviations = np.array([car.further - car.value for car in cars])
    further = further + deviations[each % len(cars), each]
    return Car(value, covariance, further)


def _evenly(drawn: FloatArray, count: int) -> FloatArray:
    """So many of the draws (n, p), at most, in even steps."""
    return np.asarray(drawn[np.linspace(0, len(drawn) - 1, min(len(drawn), count)).astype(int)])


def share(probabilities: FloatArray, level: float = LEVEL) -> Quantity:
    """The share of stable vehicles, from the probability (V,) of each to be stable."""
    count = len(probabilities)
    if not count:
        return Quantity(np.nan, np.nan, np.nan)
    weights = np.ones(1)  # of each possible number of stable ones
    for p in probabilities:
        weights = np.convolve(weights, [1.0 - p, p])
    stable = np.arange(len(weights))

    def quantile(tail: float) -> float:
        def beyond(x: float) -> float:
            return float(weights @ betainc(stable + 0.5, count - stable + 0.5, x)) - tail

        return float(brentq(beyond, 0.0, 1.0, xtol=1e-9))

    tail, value = (1.0 - level) / 2.0, float(np.mean(probabilities))
    # A share of 0 or 1 is an end of its interval.
    return Quantity(value, min(quantile(tail), value), max(quantile(1.0 - tail), value))
