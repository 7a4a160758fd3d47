"""Closed-loop simulation: the parameters of any model whose simulation is nearest the recording.

A window is driven from its first measured state on with only the speed ahead given. With the errors
e of gap [m] and speed [m/s] at N instants of all windows, the parameters θ of a model minimise

    ½ m ln(Σ e² / N) + ½ |z|²,     m = time simulated / `MEMORY`

where z are the parameters in standard deviations of their priors (see `model.following`). As errors
of a closed loop last for seconds, m and not N is the number of independent ones. The search is
Levenberg and Marquardt's with exact derivatives of the simulation by the complex step, for many
data sets and starts at once: all of them are one array, so that the only loop is that over time.

Intervals are those of the Laplace approximation, with Ĵ = ∂e/∂z, w = m / Σ e² and blocks b of
`BLOCK` seconds, across which errors are taken as independent,

    cov z = H⁻¹ (w² Σ_b g_b g_bᵀ + 1) H⁻¹,    H = w ĴᵀĴ + 1,
    g_b = (1 - w Ĵ_bᵀĴ_b H⁻¹)⁻¹ Ĵ_bᵀe_b,

as if each block were left out in turn, since the parameters follow its own errors; and Student's t
with the number of blocks less that of parameters stands in place of the normal distribution.
Each stretch between excluded instants starts anew from its measured state. A parameter whose
deviation is more than `OPEN` of its prior's is not determined by the data.

Sources: Gunter et al., IEEE Transactions on Intelligent Transportation Systems 22 (2021) 6992-7003,
and Punzo and Montanino, Transportation Research Part B 91 (2016) 21-33, for closed-loop simulation;
Newey and West, Econometrica 55 (1987) 703-708, for errors that last; Bell and McCaffrey, Survey
Methodology 28 (2002) 169-181, for few blocks.
"""

import time
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import chain, pairwise

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtri, stdtrit

from accpinn.errors import SegmentError
from accpinn.methods import Method, Segments, TaskContext, one_thread
from accpinn.methods.estimate import Estimate, Outcome, Progress, Recorder
from accpinn.methods.findings import Implausible, MethodFinding, SimulatedSeparately, Undetermined
from accpinn.methods.forecast import CURVES, PARAMETERS, Pace, Phase
from accpinn.methods.series import determined_followers
from accpinn.model.cthp import Case, Parameters, Trajectories
from accpinn.model.following import COMPLEX_STEP, STEP, FollowingModel
from accpinn.model.registry import BEST, FOLLOWING, Fixed, value_of
from accpinn.model.spec import ModelSpec
from accpinn.segment import Segment, median_speeds
from accpinn.units import FloatArray, Mask, Seconds, nanmean, stretches

KEY = "simulation"
MEMORY: Seconds = 10.0
"""Time that an independent error of a closed loop is worth."""
BLOCK: Seconds = 30.0
"""Blocks across which errors are taken as independent for the intervals."""
LEAST_SPARE = 3
"""Least number of blocks beyond that of parameters for which Student's t is taken."""
OPEN = 0.8
"""Posterior deviation, as a share of the prior's, from which a parameter is not determined."""
IMPLAUSIBLE = 3.0
"""Deviations of the prior beyond which the value of a parameter is none of a car's. A b of 77 m/s²
of the IDM says that braking has no limit, as do all others that large."""
LEAST_STRETCH = MEMORY
"""Shortest stretch between excluded instants that is simulated."""
LEVEL = 0.9
"""Probability that an interval is to cover the parameter."""
STARTS, LATE_STARTS = 2, 4
"""Parameter sets from which each search begins, and one with a lag or a delay before a model that
is no CTHP: the typical set and draws from the prior. They mostly end in the same maximum, see
docs/validation.md."""
ROUNDS, USUAL_ROUNDS = 40, 25
"""Most steps of a search, and those that many take."""
CONVERGED = 1e-4
"""Decrease of the objective in one step below which a search ends."""
ALIKE = 5
"""Rounds after which starts end that are `BEHIND` the best one."""
BEHIND = 5.0


@dataclass(frozen=True, eq=False)
class Drives:
    """W windows of single followers on even instants, ready to be simulated together."""

    step: Seconds
    """Between the K+1 instants."""
    ahead: FloatArray
    """(2K+1, W) speed ahead at every half step, in m/s."""
    gaps: FloatArray
    """(K+1, W) measured, in m."""
    speeds: FloatArray
    """(K+1, W) measured, in m/s."""
    counts: Mask
    """(K+1, W) instants within the window at which all is measured and none is excluded."""

    @classmethod
    def of(cls, segments: Sequence[Segment], model: FollowingModel) -> "Drives":
        """The windows of segments with one follower each, as the model is to be simulated.

        Shorter windows are filled up with their last row, which does not count.
        """
        step = STEP / 2 if model.is_late else STEP  # a lag or a delay may be as fast
        parts = []
        for segment in segments:
            count = int(segment.window.duration / step + 1e-6)
            half = segment.time[0] + step / 2 * np.arange(2 * count + 1)
            channels = np.column_stack([segment.speeds, segment.gaps])
            values = np.array([np.interp(half, segment.time, part) for part in channels.T])
            nearest = np.rint((half[::2] - segment.time[0]) / segment.sample_time).astype(int)
            nearest = np.minimum(nearest, segment.samples - 1)
            parts.append((values, segment.counts[nearest, 0]))
        longest = max(len(counts) for _, counts in parts)
        filled, counted = [], []
        for values, counts in parts:
            more = longest - len(counts)
            filled.append(np.pad(values, ((0, 0), (0, 2 * more)), "edge"))
            counted.append(np.pad(counts, (0, more)))
        ahead, speeds, gaps = np.stack(filled, axis=-1)
        return cls(step, ahead, gaps[::2], speeds[::2], np.stack(counted, axis=-1))

    def __getitem__(self, index: NDArray[np.intp]) -> "Drives":
        """The windows at an array of indices, in its shape."""
        ahead, gaps, speeds = (part[:, index] for part in (self.ahead, self.gaps, self.speeds))
        return Drives(self.step, ahead, gaps, speeds, np.asarray(self.counts[:, index]))

    def simulated(self, model: FollowingModel, theta: FloatArray) -> FloatArray:
        """(K+1, 2, W) gaps and speeds by θ (n, W) from the first measured state on."""
        start = self.gaps[:1], self.speeds[:1]
        return np.asarray(model.integrate(theta[:, None], self.ahead, *start, self.step)[:, :, 0])

    def motion(self, model: FollowingModel, parameters: Parameters) -> Trajectories:
        """Motion in one window of W followers (W,); nan of those that diverge or are unknown."""
        theta = np.array([value_of(model.key, parameters, name) for name in model.names])
        gaps, speeds = np.moveaxis(self.simulated(model, theta), 1, 0)
        time = self.step * np.arange(len(gaps), dtype=np.float64)
        return Trajectories(time, np.column_stack([self.ahead[::2, 0], speeds]), gaps)


@dataclass(frozen=True, eq=False)
class Optimum:
    """The best parameters of one follower under one model, complete and with intervals."""

    model: FollowingModel
    theta: FloatArray
    """(n,) in the order of the model's parameters."""
    lower: FloatArray
    """(n,) lower ends of the intervals of `LEVEL`."""
    upper: FloatArray
    """(n,) upper ends."""
    determined: Mask
    """(n,) whether the data say more of a parameter than the prior."""
    scores: FloatArray
    """(n,) the parameters in standard deviations of their priors, z."""
    covariance: FloatArray
    """(n, n) of z."""
    converged: bool
    """Whether the search ended by itself."""

    def draws(self, count: int) -> FloatArray:
        """(count, n) draws of z, within the bounds of the search."""
        free = np.flatnonzero(np.diag(self.covariance) > 0)
        root = np.linalg.cholesky(self.covariance[np.ix_(free, free)])
        normal = np.random.default_rng(0).standard_normal((count, len(root)))
        drawn = np.tile(self.scores, (count, 1))
        drawn[:, free] += normal @ root.T
        return np.clip(drawn, *bounds_of(self.model))

    @property
    def undetermined(self) -> tuple[str, ...]:
        """Symbols of the parameters that the data do not determine."""
        pairs = zip(self.model.parameters, self.determined, strict=True)
        return tuple(parameter.symbol for parameter, is_determined in pairs if not is_determined)

    @property
    def implausible(self) -> tuple[str, ...]:
        """Symbols of those that are determined, yet far outside what is known of cars."""
        far = self.determined & (np.abs(self.scores) > IMPLAUSIBLE)
        far &= np.diag(self.covariance) > 0  # what is fixed was chosen
        pairs = zip(self.model.parameters, far, strict=True)
        return tuple(parameter.symbol for parameter, is_far in pairs if is_far)


@one_thread
def optima(
    model: FollowingModel,
    drives: Drives,
    groups: Sequence[Sequence[int]],
    should_stop: Callable[[], bool] | None = None,
    *,
    fixed: Fixed = (),
    on_round: Callable[[int, FloatArray, FloatArray], object] | None = None,
) -> tuple[Optimum, ...]:
    """The best parameters for each of P groups of windows, all searched at once.

    A group is the indices of the windows that share one parameter set. ``should_stop`` is asked
    before every round; True ends the search with what it has. ``on_round`` is given the number of
    the round, the best z (P, n) and their objectives (P,).
    """
    search = _Search(model, drives, groups, fixed)
    problems, rng = len(groups), np.random.default_rng(0)
    count = len(model.parameters)
    starts = starts_of(model)
    z = np.concatenate([np.zeros((1, count)), 0.7 * rng.standard_normal((starts - 1, count))])
    z = np.clip(np.tile(z, (problems, 1)), *search.bounds)  # (P·S, n)
    owner = np.repeat(np.arange(problems), starts)
    damping, active = np.full(len(z), 1e-2), np.ones(len(z), bool)
    value, gradient, curvature = search.expanded(z, owner)
    by_group = np.arange(len(z)).reshape(problems, -1)
    for turn in range(ROUNDS):
        if on_round:
            best_rows = by_group[np.arange(problems), value[by_group].argmin(axis=1)]
            on_round(turn, z[best_rows], value[best_rows])
        if not active.any() or (should_stop and should_stop()):
            break
        rows = np.flatnonzero(active)
        trial = search.step(z[rows], gradient[rows], curvature[rows], damping[rows])
        lost = ~np.isfinite(value[rows])
        middle = np.clip(0.5 * z[rows], *search.bounds)
        trial[lost] = middle[lost]  # as a start moves that cannot be simulated
        new, slope, bend = search.expanded(trial, owner[rows])
        gain = np.subtract(value[rows], new, out=np.full(len(rows), np.inf), where=~lost)
        better = np.isfinite(new) & (gain >= 0)
        improved = rows[better]
        z[improved], value[improved] = trial[better], new[better]
        gradient[improved], curvature[improved] = slope[better], bend[better]
        damping[rows] *= np.where(better, 0.2, 8.0)
        active[rows] = ~(better & (gain < CONVERGED)) & (damping[rows] < 1e8)
        if turn >= ALIKE:
            best = np.full(problems, np.inf)
            np.minimum.at(best, owner, value)
            active &= value < best[owner] + BEHIND
    chosen = by_group[np.arange(problems), value[by_group].argmin(axis=1)]
    return search.optima(z[chosen], (~active & np.isfinite(value))[chosen])


def starts_of(model: FollowingModel) -> int:
    """The number of parameter sets from which a search of a model begins."""
    return LATE_STARTS if model.is_late and not model.is_linear else STARTS


def bounds_of(model: FollowingModel, fixed: Fixed = ()) -> FloatArray:
    """(2, n) least and largest z; the same for parameters that keep their values."""
    ends = ("lower", "upper")
    bounds = np.array([[p.score(getattr(p, end)) for p in model.parameters] for end in ends])
    for name, value in fixed:
        at = model.names.index(name)
        bounds[:, at] = model.parameters[at].score(value)
    return bounds


def bounded_step(
    z: FloatArray, gradient: FloatArray, system: FloatArray, bounds: FloatArray
) -> FloatArray:
    """(B, n) the next z within bounds (2, n); one at a bound that pushes outward stays there."""
    lower, upper = bounds
    usable = np.isfinite(system).all(axis=(1, 2)) & np.isfinite(gradient).all(axis=1)
    outward = np.where(gradient > 0, z <= lower, z >= upper) & (gradient != 0)
    fixed: Mask = np.logical_or(outward, np.reshape(~usable, (-1, 1)))
    system = np.where(fixed[:, :, None] | fixed[:, None, :], np.eye(len(z.T)), system)
    down = np.where(fixed, 0.0, -gradient)
    move = np.linalg.solve(system, down[..., None])[..., 0]
    return np.asarray(np.clip(z + np.clip(move, -2.0, 2.0), lower, upper))


class _Search:
    """The objective of P groups of windows, and its derivatives."""

    def __init__(
        self,
        model: FollowingModel,
        drives: Drives,
        groups: Sequence[Sequence[int]],
        fixed: Fixed,
    ) -> None:
        self._model, self._drives, size = model, drives, max(map(len, groups))
        self._index = np.array([[*group] + [group[0]] * (size - len(group)) for group in groups])
        self._used = np.array([np.arange(size) < len(group) for group in groups])
        self.bounds = bounds_of(model, fixed)
        self._free: Mask = np.asarray(self.bounds[0] < self.bounds[1])

    @np.errstate(over="ignore", invalid="ignore")  # of what diverges, whose objective is infinite
    def expanded(
        self, z: FloatArray, owner: NDArray[np.intp]
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Objective (B,), gradient (B, n) and Gauss-Newton curvature (B, n, n) at z (B, n)."""
        errors, slopes, freedom = self._linear(z, owner)
        squares = np.einsum("kcbw,kcbw->b", errors, errors)
        count = np.maximum(freedom[0], 1)
        weight = (freedom[1] / squares)[:, None]
        gradient = weight * np.einsum("kcbw,kcbwn->bn", errors, slopes) + z
        curvature = weight[..., None] * _products(slopes) + np.eye(z.shape[1])
        value = 0.5 * freedom[1] * np.log(squares / count) + 0.5 * (z**2).sum(axis=1)
        return np.where(np.isfinite(value), value, np.inf), gradient, curvature

    def step(
        self, z: FloatArray, gradient: FloatArray, curvature: FloatArray, damping: FloatArray
    ) -> FloatArray:
        """(B, n) the next z within the bounds."""
        diagonal = np.einsum("bii->bi", curvature)
        system = curvature + np.einsum("bi,ij->bij", damping[:, None] * diagonal, np.eye(len(z.T)))
        return bounded_step(z, gradient, system, self.bounds)

    def optima(self, z: FloatArray, converged: Mask) -> tuple[Optimum, ...]:
        """The optima of all groups, with intervals."""
        owner, model = np.arange(len(z)), self._model
        errors, slopes, freedom = self._linear(z, owner)
        weight = freedom[1] / np.einsum("kcbw,kcbw->b", errors, errors)
        scores = np.einsum("kcbw,kcbwn->kbwn", errors, slopes) * weight[:, None, None]
        ends = np.arange(0, len(scores), max(1, round(BLOCK / self._drives.step)))
        blocks = np.add.reduceat(scores, ends, axis=0)
        squares = np.add.reduceat(np.einsum("kcbwi,kcbwj->kbwij", slopes, slopes), ends, axis=0)
        curvature = weight[:, None, None] * _products(slopes) + np.eye(z.shape[1])
        inverse = np.zeros_like(curvature)
        free = np.ix_(owner, self._free, self._free)
        inverse[free] = np.linalg.inv(curvature[free])
        leverage = np.einsum("kbwij,b,bjl->kbwil", squares, weight, inverse)
        left_out = np.linalg.solve(np.eye(z.shape[1]) - leverage, blocks[..., None])[..., 0]
        meat = np.einsum("kbwi,kbwj->bij", left_out, left_out) + np.eye(z.shape[1])
        filled = (blocks != 0.0).any(axis=3).sum(axis=(0, 2))
        spare = np.maximum(filled - self._free.sum(), LEAST_SPARE)
        wider = stdtrit(spare, 0.5 + LEVEL / 2) / ndtri(0.5 + LEVEL / 2)
        covariance = inverse @ meat @ inverse * (wider**2)[:, None, None]
        deviation = np.sqrt(np.einsum("bii->bi", covariance))
        shrunk = 1.0 / np.maximum(1.0, deviation)  # the prior's at most
        covariance *= shrunk[:, :, None] * shrunk[:, None, :]
        deviation = deviation * shrunk
        reach = ndtri(0.5 + LEVEL / 2) * deviation
        ends_of = (z, np.maximum(z - reach, self.bounds[0]), np.minimum(z + reach, self.bounds[1]))
        theta, lower, upper = (model.values_at(part).T for part in ends_of)
        return tuple(
            Optimum(
                model,
                theta[k],
                lower[k],
                upper[k],
                determined=np.asarray(deviation[k] < OPEN),
                scores=z[k],
                covariance=covariance[k],
                converged=bool(converged[k]),
            )
            for k in range(len(z))
        )

    def _linear(
        self, z: FloatArray, owner: NDArray[np.intp]
    ) -> tuple[FloatArray, FloatArray, tuple[FloatArray, FloatArray]]:
        """Errors (K+1, 2, B, W), their derivatives (.., n), and N and m of each row."""
        drives, used = self._drives[self._index[owner]], self._used[owner]
        count = z.shape[1]
        # (B, n, n): one perturbed copy a parameter
        at = z[:, None, :] + 1j * COMPLEX_STEP * np.eye(count)
        theta = self._model.values_at(at)
        starts = drives.gaps[:1, ..., None], drives.speeds[:1, ..., None]
        moved = self._model.integrate(
            theta[:, None, :, None, :], drives.ahead[..., None], *starts, drives.step
        )[:, :, 0]  # (K+1, 2, B, W, n)
        counts = drives.counts & used
        measured = np.stack([drives.gaps, drives.speeds], axis=1)
        with np.errstate(over="ignore", invalid="ignore"):  # what diverges is set below
            errors = (moved[..., 0].real - measured) * counts[:, None]
            slopes = moved.imag * (counts[:, None, ..., None] / COMPLEX_STEP)
        is_finite = np.isfinite(moved).all(axis=(1, 4)) & np.isfinite(slopes).all(axis=(1, 4))
        diverged = ~is_finite.all(axis=(0, 2))
        errors[:, :, diverged], slopes[:, :, diverged] = np.inf, 0.0
        samples = counts.sum(axis=(0, 2))
        return errors, slopes, (2.0 * samples, samples * drives.step / MEMORY)


def _products(slopes: FloatArray) -> FloatArray:
    """(B, n, n) the sums of products of slopes (K+1, 2, B, W, n)."""
    flat = slopes.transpose(2, 0, 1, 3, 4).reshape(slopes.shape[2], -1, slopes.shape[4])
    return np.asarray(flat.transpose(0, 2, 1) @ flat)


def refuse_short(segment: Segment) -> None:
    """Refuse a window that is shorter than a block.

    Raises:
        SegmentError: for such a window.
    """
    if segment.window.duration < BLOCK:
        raise SegmentError(
            f"{segment.source}: {segment.window} is too short to be simulated; choose a window of"
            f" at least {BLOCK:g} s."
        )


def estimates(
    segments: Segments, case: Case, spec: ModelSpec
) -> tuple[tuple[list[int], Optimum], ...]:
    """The optimum of each follower that several windows together determine, and whose it is.

    Each follower is simulated behind the measured vehicle ahead. Case I has one optimum for all.

    Raises:
        SegmentError: where a window is too short, or simulations almost diverge.
    """
    return _searched(segments, case, spec)


def _searched(
    segments: Segments,
    case: Case,
    spec: ModelSpec,
    should_stop: Callable[[], bool] | None = None,
    on_round: Callable[[list[list[int]], int, FloatArray, FloatArray], object] | None = None,
) -> tuple[tuple[list[int], Optimum], ...]:
    for segment in segments:
        refuse_short(segment)
    followers = range(segments[0].followers)
    parts = [[part for s in segments for part in counted_stretches(s.pair(k))] for k in followers]
    if not any(parts):
        raise SegmentError(
            f"{segments[0].source}: without the instants left out, no follower has a stretch of"
            f" {LEAST_STRETCH:g} s to simulate; leave out less, or choose another model."
        )
    usable = [k for k in determined_followers(segments, case) if parts[k]]
    if not usable:
        return ()
    model = spec.following
    rows = [usable] if case == "I" else [[k] for k in usable]
    simulated = [[part for k in row for part in parts[k]] for row in rows]
    ends = np.cumsum([0, *map(len, simulated)]).tolist()
    groups = [range(*pair) for pair in pairwise(ends)]
    drives = Drives.of([*chain(*simulated)], model)
    report = partial(on_round, rows) if on_round else None
    try:
        best = optima(model, drives, groups, should_stop, fixed=spec.fixed, on_round=report)
    except np.linalg.LinAlgError:
        raise SegmentError(
            f"{segments[0].source}: simulations by the {model.title} almost diverge with what is"
            " fixed; fix other values, or none."
        ) from None
    return tuple(zip(rows, best, strict=True))


def counted_stretches(segment: Segment) -> list[Segment]:
    """The parts of one follower's window that are simulated, each from its own first state on.

    A window from which instants are excluded has several, or none that is long enough: what was
    excluded would move the rest.
    """
    if segment.mask is None:
        return [segment]
    runs = [run for run in stretches(segment.mask[:, 0]) if len(run) > 1]
    parts = (segment.part(run.first, run.last + 1) for run in runs)
    return [part for part in parts if part.window.duration >= LEAST_STRETCH]


def fit(
    segments: Segments, case: Case, _settings: None, context: TaskContext, spec: ModelSpec
) -> Estimate:
    """The parameters of the best closed-loop simulation of all windows (K,).

    The curves are those of each follower behind the measured vehicle ahead.

    Raises:
        SegmentError: where a window is too short.
    """
    started, model, speeds = time.perf_counter(), spec.following, median_speeds(segments)
    first, recorder = segments[0], Recorder()
    is_shared = case == "I"

    def parameters_of(rows: Sequence[Sequence[int]], values: Sequence[FloatArray]) -> Parameters:
        theta = np.full((len(model.parameters), first.followers), np.nan)
        for row, vector in zip(rows, values, strict=True):
            theta[:, row] = vector[:, None]
        return model.linearisations(theta, speeds)

    live, pace = Drives.of([first.pair(k) for k in range(first.followers)], model), Pace()

    def note(rows: list[list[int]], turn: int, z: FloatArray, value: FloatArray) -> None:
        now = parameters_of(rows, [*model.values_at(z).T])
        moment = Progress(
            PARAMETERS, turn, max(USUAL_ROUNDS, min(turn + 2, ROUNDS)),
            time.perf_counter() - started, float(value.sum()),
            np.nan, np.nan, np.nan, now[:1] if is_shared else now,
        )  # fmt: skip
        recorder.add(moment)
        if context.on_progress:
            curves = pace.drawn(lambda: live.motion(model, now))
            context.on_progress(replace(moment, curves=curves))
            last.append(moment)

    last = deque[Progress](maxlen=1)
    searched = _searched(segments, case, spec, context.should_stop, note)
    for moment in last:
        assert context.on_progress
        seconds = time.perf_counter() - started
        context.on_progress(
            replace(moment, phase=CURVES, iteration=0, iterations=1, seconds=seconds)
        )
    findings: list[MethodFinding] = [SimulatedSeparately()] if first.followers > 1 else []
    for row, best in [] if context.is_stopped else searched:  # what the data say shows at its end
        vehicle = 0 if first.shares(case) else first.vehicles[row[0] + 1]
        if best.undetermined:
            findings.append(Undetermined(vehicle, model.title, best.undetermined))
        if best.implausible:
            findings.append(Implausible(vehicle, model.title, best.implausible))
    parameters = parameters_of([row for row, _ in searched], [best.theta for _, best in searched])
    symbols = tuple(parameter.symbol for parameter in model.parameters)
    for k in np.flatnonzero(np.isnan(parameters.alpha)):
        findings.append(Undetermined(first.vehicles[k + 1], model.title, symbols))
    outcome = Outcome.FINISHED
    if context.is_stopped:
        outcome = Outcome.STOPPED
    elif all(best.converged for _, best in searched):
        outcome = Outcome.CONVERGED
    curves = tuple(_driven(segment, model, parameters) for segment in segments)
    squares = [
        ((motion.gaps - s.gaps) ** 2 + (motion.speeds - s.speeds)[:, 1:] ** 2)[s.counts]
        for s, motion in zip(segments, curves, strict=True)
    ]
    return Estimate.of(
        KEY,
        segments,
        case,
        spec,
        parameters,
        curves=curves,
        outcome=outcome,
        seconds=time.perf_counter() - started,
        settings={"starts": starts_of(model)},
        loss={"total": float(nanmean(np.concatenate(squares)))},
        history=recorder.history() if len(recorder) else None,
        iterations=max(0, len(recorder) - 1),
        findings=findings,
    )


def _driven(segment: Segment, model: FollowingModel, parameters: Parameters) -> Trajectories:
    """The motion of each follower (M,) behind the measured vehicle ahead; nan of unknown ones."""
    gaps, speeds = np.full_like(segment.gaps, np.nan), segment.speeds.copy()
    theta = np.array([value_of(model.key, parameters, name) for name in model.names])
    for k in range(segment.followers):
        if not np.isfinite(theta[:, k]).all():
            speeds[:, k + 1] = np.nan
            continue
        pair = segment.pair(k)
        start = pair.speeds[0, 1:], pair.gaps[0]
        motion = model.simulate(theta[:, k], segment.time, pair.speeds[:, 0], *start)
        gaps[:, k], speeds[:, k + 1] = motion.gaps[:, 0], motion.speeds[:, 1]
    return Trajectories(segment.time, speeds, gaps)


def round_seconds(segments: Segments) -> Seconds:
    """Typical time of a step of the search: that of the longest simulation, and of all."""
    longest = max(segment.window.duration for segment in segments)
    size = sum(segment.samples for segment in segments) * segments[0].followers
    return 2.2e-4 * longest + 1e-6 * size


def _phases(segments: Segments, _settings: None, spec: ModelSpec) -> Mapping[str, Phase]:
    return {
        PARAMETERS: Phase(USUAL_ROUNDS, round_seconds(segments)),
        CURVES: Phase(1, 6e-5 * segments[0].followers * sum(s.samples for s in segments)),
    }


def _initial(segments: Segments, _settings: None, spec: ModelSpec) -> tuple[str, Parameters]:
    """The first of the parameter sets from which the search begins, the typical one."""
    model = spec.following
    scores = np.clip(np.zeros((1, len(model.parameters))), *bounds_of(model, spec.fixed))
    theta = np.repeat(model.values_at(scores), segments[0].followers, axis=1)
    return spec.model, model.linearisations(theta, median_speeds(segments))


METHOD = Method(
    KEY, "Simulation", fit, typical_seconds=1.4, version=3, is_closed_loop=True,
    phases=_phases, initial=_initial,
    models=lambda _: (BEST, *(key for key in FOLLOWING if key != BEST)),
    posterior=lambda _: "simulation",
    description=lambda _: "Closed-loop simulation, with intervals.",
    summary="the parameters whose closed-loop simulation is nearest the recording",
)  # fmt: skip
