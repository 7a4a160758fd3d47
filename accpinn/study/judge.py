"""Which car-following model describes a car? Each is judged in windows that it has not seen.

One window of K is left out; a model is fitted by closed-loop simulation to the other windows
together (`methods.simulation`) and then drives in the one left out from its first state on, with
only the speed ahead given. The error is the RMSE of the gap; that of the time gap is the error of
the gap over the measured speed, where that is above `SLOW`. Of two models with RMSE x_k and y_k,
ln(x_k / y_k) has mean d and standard error s over the windows, and one is said to be better where
|d| exceeds s by the 95 % quantile of Student's distribution with K - 1 degrees of freedom.

A second judge is the measured gain: in stretches of at least `STRETCH` seconds, |H| of the model,
fitted to all windows and linearised at the stretch's median speed, is compared with Welch's
estimate (see `inference.gain_check`); the error is the rms difference in dB.

Where a recording has fewer than three windows, blocks of them are left out in turn.

A method of estimation is judged likewise: its estimate from the other windows, under its usual
model, drives in the one left out. Many recordings are judged by `study.judging`.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from scipy.special import stdtrit

from accpinn.errors import ConfigError, ParameterError, SegmentError, shown
from accpinn.findings import Finding, Labelled, Words, joined
from accpinn.inference.gain_check import LEAST, compared
from accpinn.methods import TaskContext
from accpinn.methods.registry import METHODS, VARIANTS, variant_of
from accpinn.methods.simulation import BLOCK, Drives, optima, refuse_short
from accpinn.model.cthp import collides
from accpinn.model.following import FollowingModel
from accpinn.model.registry import FOLLOWING
from accpinn.model.spec import ModelSpec
from accpinn.recordings import Recording, Window
from accpinn.segment import Segment, SegmentInfo
from accpinn.segment.cut import cut, default_vehicles
from accpinn.segment.windows import car_following
from accpinn.stability.lagged import frequency_response
from accpinn.stability.measured_gain import measured_gain
from accpinn.units import FloatArray, Mask, Metres, MetresPerSecond, Seconds, nanmean

LONGEST: Seconds = 150.0
"""Longest window of car-following that is left out."""
BLOCKS_OF: Seconds = 100.0
"""Length of the blocks where there are too few windows."""
STRETCH: Seconds = 250.0
"""Shortest stretch whose gain is measured."""
LONGEST_STRETCH: Seconds = 700.0
"""Longer stretches are cut, as their setting may change."""
SLOW: MetresPerSecond = 5.0
"""Least measured speed at which the time gap has an error."""
LARGEST: Metres = 100.0
"""Errors of the gap are clipped to this; a simulation that diverges gets it."""
CONFIDENCE = 0.95
LEAST_WINDOWS = 3
"""Fewer windows say nothing about which model is better."""


class Describes(Finding, frozen=True):
    """Which model describes a follower best in windows left out, and whether that is certain."""

    text = (
        "{vehicle}: the {model} describes this car best. In {windows} windows left out its gap"
        " error is {rmse:.2f} m (geometric mean); that of the {other}, the next best, is"
        " {more:.0f} % larger ({low:.0f} to {high:.0f} %, one standard error to either side)."
    )
    unclear = (
        "{vehicle}: no model is clearly better. In {windows} windows left out the {model} has the"
        " least gap error, {rmse:.2f} m (geometric mean), but that of the {other} is {more:.0f} %"
        " larger ({low:.0f} to {high:.0f} %, one standard error to either side), which may be"
        " chance.{worse_in_words}"
    )
    few = (
        "{vehicle}: {windows} windows are too few to say which model is better. The {model} has the"
        " least gap error in them, {rmse:.2f} m (geometric mean); that of the {other} is"
        " {more:.0f} % larger."
    )

    vehicle: int
    model: str
    other: str
    windows: int
    rmse: Metres
    more: float
    """Gap error of the next best model beyond that of the best, in percent."""
    low: float
    """That, one standard error lower."""
    high: float
    """One higher."""
    clear: bool
    worse: tuple[str, ...] = ()
    """Titles of models that are clearly worse than the best."""

    @property
    def worse_in_words(self) -> str:
        """A sentence on those; empty where there are none."""
        return f" Clearly worse: {joined(self.worse)}." if self.worse else ""

    def _words(self, about: Labelled) -> Words:
        return {"worse_in_words": self.worse_in_words}

    def sentence(self, about: Labelled) -> str:
        """The finding, as clear as it is."""
        if self.windows < LEAST_WINDOWS:
            return self.filled(self.few, about)
        return self.filled(self.text if self.clear else self.unclear, about)


@dataclass(frozen=True, eq=False)
class Subject:
    """One follower and the data by which models are judged on it."""

    windows: tuple[Segment, ...]
    """(K,) of this follower alone behind the measured vehicle ahead, two at least."""
    stretches: tuple[Segment, ...]
    """For the measured gain; overlapping the windows."""

    @property
    def vehicle(self) -> int:
        """Its number in the file."""
        return self.windows[0].vehicles[1]

    @cached_property
    def speeds(self) -> tuple[MetresPerSecond, MetresPerSecond, MetresPerSecond]:
        """Its least, median and largest speed; 5 % of the time it is slower or faster."""
        low, middle, high = np.nanquantile(
            np.concatenate([window.speeds[:, 1] for window in self.windows]), (0.05, 0.5, 0.95)
        )
        return float(low), float(middle), float(high)

    def judgement(self, scores: tuple["ModelScore", ...]) -> "Judgement":
        """The scores of models with what they are about."""
        windows, stretches = (
            tuple(segment.window for segment in part) for part in (self.windows, self.stretches)
        )
        return Judgement(self.windows[0].info, windows, stretches, self.speeds, scores)

    def gain_error(self, model: FollowingModel, theta: FloatArray) -> float:
        """Rms error of |H| in dB, the median over the stretches; nan where none is measured."""
        errors = []
        for stretch, (omega, gain) in zip(self.stretches, self._gains, strict=True):
            speed = float(np.median(stretch.speeds[:, 1]))
            try:
                near = model.linearised(theta, speed)
            except ParameterError:
                continue
            if len(omega) >= LEAST:
                with np.errstate(all="ignore"):
                    ratio = 20.0 * np.log10(np.abs(frequency_response(near[None], omega)[0]) / gain)
                errors.append(float(np.sqrt(np.mean(ratio**2))))
        return float(np.median(errors)) if errors else float("nan")

    @cached_property
    def _gains(self) -> list[tuple[FloatArray, FloatArray]]:
        """Frequencies and measured gains of each stretch; none where it cannot be measured."""
        gains = []
        for stretch in self.stretches:
            try:
                measured = measured_gain(stretch, 0)
            except SegmentError:
                gains.append((np.empty(0), np.empty(0)))
                continue
            kept = compared(measured)
            gains.append((measured.omega[kept], measured.gain[kept]))
        return gains


@dataclass(frozen=True)
class Candidate:
    """A model whose parameters are sought in closed loop, or a method with its usual model."""

    model: FollowingModel
    method: str = ""
    """Name of the method among `VARIANTS`; empty for closed-loop simulation."""

    @property
    def title(self) -> str:
        """Its name for people."""
        if not self.method:
            return self.model.title
        key, settings = variant_of(self.method)
        preset = "" if settings is None else f" ({settings.preset})"
        return f"{METHODS[key].title}{preset}: {self.model.title}"


def candidate(name: str) -> Candidate:
    """What is judged under a model's key or a method's name.

    Raises:
        ConfigError: for an unknown name.
    """
    if isinstance(name, str) and name in FOLLOWING:
        return Candidate(FOLLOWING[name])
    if isinstance(name, str) and name in VARIANTS:
        key, settings = variant_of(name)
        return Candidate(FOLLOWING[METHODS[key].usual_spec(settings).model], name)
    keys, name = ", ".join(FOLLOWING), shown(name).strip("'")
    raise ConfigError(
        f"models: {name} is not known; choose from {keys}, or a method: {', '.join(VARIANTS)}."
    )


@dataclass(frozen=True, eq=False)
class ModelScore:
    """How one model does on one follower."""

    key: str
    """The model's key in the registry, or the name of a method."""
    theta: FloatArray
    """(n,) its parameters from all windows together."""
    lower: FloatArray
    """(n,) lower ends of their intervals of `LEVEL`."""
    upper: FloatArray
    """(n,) upper ends."""
    determined: Mask
    """(n,) whether the data say more of a parameter than the prior."""
    rmse: FloatArray
    """(K,) of the gap in each window left out, in m."""
    mae: FloatArray
    """(K,) mean absolute error of the gap there, in m."""
    time_gap_rmse: FloatArray
    """(K,) in s; nan in a window where the vehicle is slower than `SLOW`."""
    collided: Mask
    """(K,) whether the vehicle collides in the window left out."""
    gain_error: float
    """Rms error of |H| in dB; nan where no gain is measured."""

    @property
    def model(self) -> FollowingModel:
        """The model; that of a method is its usual one."""
        return candidate(self.key).model

    @property
    def title(self) -> str:
        """Its name for people."""
        return candidate(self.key).title

    @property
    def named(self) -> dict[str, float]:
        """The parameters by their names."""
        return dict(zip(self.model.names, self.theta.tolist(), strict=True))

    @property
    def typical_rmse(self) -> Metres:
        """The geometric mean of `rmse`, as models are compared window by window."""
        return float(np.exp(np.log(self.rmse).mean()))


@dataclass(frozen=True, eq=False)
class Judgement:
    """The models on one follower, in the order in which they were judged."""

    info: SegmentInfo
    """The first window left out, with both vehicles."""
    windows: tuple[Window, ...]
    """(K,) windows left out."""
    stretches: tuple[Window, ...]
    """Those of the measured gain."""
    speeds: tuple[MetresPerSecond, MetresPerSecond, MetresPerSecond]
    """See `Subject.speeds`."""
    scores: tuple[ModelScore, ...]

    @cached_property
    def ranked(self) -> tuple[ModelScore, ...]:
        """The scores by their typical RMSE, the best first."""
        return tuple(sorted(self.scores, key=lambda score: score.typical_rmse))

    @property
    def is_clear(self) -> bool:
        """Whether the best model is better than the next by more than chance explains."""
        return len(self.scores) > 1 and self.ranked[1] in self.worse

    @property
    def worse(self) -> tuple[ModelScore, ...]:
        """The models that are worse than the best by more than chance explains."""
        windows = len(self.windows)
        if not self.scores or windows < LEAST_WINDOWS:
            return ()
        best, *others = self.ranked
        pairs = ((other, *difference([best], [other])) for other in others)
        least = stdtrit(windows - 1, CONFIDENCE)
        return tuple(other for other, mean, error in pairs if -mean > least * error)

    @property
    def findings(self) -> tuple[Describes, ...]:
        """Which model describes the follower; nothing where one was judged."""
        if len(self.scores) < 2:
            return ()
        best, other = self.ranked[:2]
        describes = Describes(
            self.info.vehicles[1],
            best.title,
            other.title,
            len(best.rmse),
            best.typical_rmse,
            *beyond(other, best),
            self.is_clear,
            tuple(score.title for score in self.worse),
        )
        return (describes,)


def difference(scores: Sequence[ModelScore], others: Sequence[ModelScore]) -> tuple[float, float]:
    """Mean of ln RMSE minus that of other scores, window by window, and its standard error."""
    pairs = zip(scores, others, strict=True)
    ratios = np.concatenate([np.log(score.rmse / other.rmse) for score, other in pairs])
    error = ratios.std(ddof=1) / np.sqrt(len(ratios)) if len(ratios) > 1 else np.nan
    return float(ratios.mean()), float(error)


def beyond(score: ModelScore, best: ModelScore) -> tuple[float, float, float]:
    """RMSE beyond that of the best in %: in the mean, and one standard error lower and higher."""
    mean, error = difference([score], [best])
    more, low, high = 100.0 * np.expm1([mean, mean - error, mean + error])
    return float(more), float(low), float(high)


def wins(judgements: Sequence[Judgement]) -> FloatArray:
    """(models,) the share of windows in which each model has the least RMSE of the gap."""
    errors = [np.array([score.rmse for score in judged.scores]) for judged in judgements]
    best = np.concatenate([error.argmin(axis=0) for error in errors])
    return np.asarray(np.bincount(best, minlength=len(errors[0])) / len(best))


def subjects_of(
    recording: Recording, vehicles: Sequence[int] | None = None, windows: Sequence[Window] = ()
) -> tuple[Subject, ...]:
    """The followers of a recording that models can be judged on.

    Vehicles are consecutive numbers, leader first; by default see `default_vehicles`. By default
    each follower's windows in car-following under ACC are left out in turn, and of fewer than three
    windows blocks.

    Raises:
        SegmentError: where there is none.
    """
    subjects, faults = [], []
    for pair in pairwise(vehicles or default_vehicles(recording)):
        try:
            chosen = windows or car_following(recording, pair, LONGEST)
            long = windows or car_following(recording, pair, LONGEST_STRETCH)
            subjects.append(subject_of(recording, pair, chosen, long))
        except SegmentError as fault:
            faults.append(fault)
    if not subjects:
        raise faults[0]
    return tuple(subjects)


def subject_of(
    recording: Recording, pair: Sequence[int], windows: Sequence[Window], long: Sequence[Window]
) -> Subject:
    """One follower in these windows, and the stretches of ``long`` that are long enough.

    Raises:
        SegmentError: where the windows are too short.
    """
    if len(windows) < LEAST_WINDOWS:
        each = -(-LEAST_WINDOWS // len(windows))
        windows = [part for whole in windows for part in blocks(whole, each)]
    if len(windows) < 2:
        raise SegmentError(
            f"{recording.source}: {windows[0]} is too short to judge models by; it takes"
            f" {2 * BLOCK:g} s of which each half can be left out."
        )
    segments = tuple(cut(recording, w.start, w.duration, pair) for w in windows)
    stretches = [cut(recording, w.start, w.duration, pair) for w in long]
    return Subject(segments, tuple(part for part in stretches if part.window.duration >= STRETCH))


def blocks(window: Window, least: int) -> tuple[Window, ...]:
    """A window in blocks near `BLOCKS_OF` seconds: ``least`` of them, if they are long enough."""
    count = max(least, round(window.duration / BLOCKS_OF))
    count = max(1, min(count, int(window.duration / BLOCK)))
    ends = np.linspace(window.start, window.end, count + 1).round(1).tolist()
    return tuple(Window(*pair) for pair in pairwise(ends))


def judge(
    subjects: Sequence[Subject],
    models: Sequence[str],
    should_stop: Callable[[], bool] | None = None,
) -> Iterator[tuple[Judgement, ...]]:
    """Judge one model after the other, on all followers at once; yields the judgements so far.

    Raises:
        ConfigError: for an unknown model.
        SegmentError: where a window is too short.
    """
    done: list[tuple[ModelScore, ...]] = []
    for key in models:
        scores = _scores(subjects, key, should_stop)
        if should_stop and should_stop():
            return
        done.append(scores)
        yield tuple(
            subject.judgement(of_models)
            for subject, of_models in zip(subjects, zip(*done, strict=True), strict=True)
        )


def judged_again(judgements: Sequence[Judgement], recording: Recording) -> tuple[Judgement, ...]:
    """The judgements of the same models in the same windows of the recording."""
    subjects = []
    for stored in judgements:
        windows, stretches = (
            tuple(cut(recording, w.start, w.duration, stored.info.vehicles) for w in part)
            for part in (stored.windows, stored.stretches)
        )
        subjects.append(Subject(windows, stretches))
    *_, anew = judge(subjects, [score.key for score in judgements[0].scores])
    return anew


def seconds_of(windows: int) -> Seconds:
    """How long judging the usual models in so many windows takes, to a factor of two or so."""
    return 0.3 + 0.5 * windows


def _scores(
    subjects: Sequence[Subject], key: str, should_stop: Callable[[], bool] | None
) -> tuple[ModelScore, ...]:
    judged, windows = candidate(key), [w for subject in subjects for w in subject.windows]
    for window in windows:
        refuse_short(window)
    model, drives = judged.model, Drives.of(windows, judged.model)
    ends = np.cumsum([0, *(len(subject.windows) for subject in subjects)])
    of_subjects = [list(range(*pair)) for pair in pairwise(ends.tolist())]
    groups = [[k for k in rows if k != left_out] for rows in of_subjects for left_out in rows]
    if judged.method:
        fits = _fits(judged, windows, groups + of_subjects, should_stop)
    else:
        found = optima(model, drives, groups + of_subjects, should_stop)
        fits = [_Fit(part.theta, part.lower, part.upper, part.determined) for part in found]
    theta = np.array([part.theta for part in fits[: len(groups)]]).T
    driven, known = drives.simulated(model, theta)[:, 0], drives.counts
    errors = np.nan_to_num(driven - drives.gaps, nan=LARGEST, posinf=LARGEST, neginf=-LARGEST)
    errors = np.where(known, errors.clip(-LARGEST, LARGEST), np.nan)
    fast = np.where(drives.speeds > SLOW, drives.speeds, np.nan)
    rmse, time_gap_rmse = (np.sqrt(nanmean(e**2)) for e in (errors, errors / fast))
    mae, collided = nanmean(np.abs(errors)), np.asarray((known & collides(driven)).any(axis=0))
    return tuple(
        ModelScore(
            key,
            *whole,
            *(rmse[rows], mae[rows], time_gap_rmse[rows], collided[rows]),
            subject.gain_error(model, whole.theta),
        )
        for subject, rows, whole in zip(subjects, of_subjects, fits[len(groups) :], strict=True)
    )


class _Fit(NamedTuple):
    """The parameters (n,) from a group of windows, with the ends of their intervals."""

    theta: FloatArray
    lower: FloatArray
    upper: FloatArray
    determined: Mask


def _fits(
    judged: Candidate,
    windows: Sequence[Segment],
    groups: Sequence[Sequence[int]],
    should_stop: Callable[[], bool] | None,
) -> list[_Fit]:
    """A method's estimate from each group of windows; a point, as intervals are not judged."""
    key, settings = variant_of(judged.method)
    method, model, fits = METHODS[key], judged.model, list[_Fit]()
    open_ends, context = np.full(len(model.names), np.nan), TaskContext(should_stop=should_stop)
    for group in groups:
        chosen = tuple(windows[k] for k in group)
        found = method.fit(chosen, "II", settings, context, ModelSpec(model.key))
        theta = np.array([found.values(found.parameters, name)[0] for name in model.names])
        fits.append(_Fit(theta, open_ends, open_ends, np.isfinite(theta)))
    return fits
