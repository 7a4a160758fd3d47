"""The exact likelihood of a linear state-space model, by a Kalman filter over many models at once.

With predicted state x and covariance P, of which the first three states are measured (C), noise R,
transition F and added covariance Q, an instant with measurements y is

    C P Cᵀ + R = W⁻¹ V W⁻ᵀ,   e = W (y - C x),   K = V⁻¹ W C P Fᵀ,
    log L = -½ Σ (e²/v + log 2πv),   x = F x + Kᵀ e,   P = F P Fᵀ - Kᵀ V K + Q

with V diagonal and W unit lower triangular: e are the innovations of the measurements taken in one
by one, as their noise is independent. A missing sample has infinite noise. Once P no longer changes
and nothing is missing, neither do the gains K, and what is left is one linear recursion, which goes
on in blocks of instants (`constant_gain`).

Where nothing is missing at all, that recursion does for all instants. P has its limit P* from the
first one on if the first state's mean is δ ~ N(0, P₀ - P*), and δ enters linearly: with b and O
from Σ e²/v = const - 2 bᵀδ + δᵀO δ, its most probable value is δ = (1 + (P₀ - P*) O)⁻¹ (P₀ - P*) b,

    log L = -½ [Σ (e²/v + log 2πv) + δᵀ(b - O δ) + log |1 + (P₀ - P*) O|],   e with that δ.

P* and the information on the first state, from which O follows, come from doubling the instants.

Models, each with r series of measurements, lie on the first axis here, states and measurements on
the last, as products of many small matrices are fastest so.

Sources: Durbin and Koopman, Time Series Analysis by State Space Methods, 2nd ed., 2012, chapters 4
(filter, smoother) and 6.4 (one measurement at a time); Lainiotis, IEEE Trans. Autom. Control 16
(1971) 160-170 (a first state in two parts).
"""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from accpinn.methods.constant_gain import (
    BLOCK,
    WIDTH,
    ConstantGain,
    Gains,
    blocks_of,
    evened,
    first_axis,
    limits,
    turned,
)
from accpinn.methods.state_space import OBSERVED, Columns, StateSpace
from accpinn.units import FloatArray, Mask

SETTLED = 1e-11
"""Largest change of the covariance in a step, in units of its deviations, taken for none."""
STRETCH = 40_000
"""Instants times models with constant gains at once, so that they fit the cache."""
JOINED = 64
"""Most instants with gains of their own whose innovations are summed at once."""
LOG_TWO_PI = float(np.log(2 * np.pi))
Places = NDArray[np.intp]


@dataclass(frozen=True, eq=False)
class Innovations:
    """The part of each measurement that the filter did not predict; (N, 3, B)."""

    errors: FloatArray
    """Independent of each other if the model holds; 0 where a sample is missing."""
    present: Mask
    """Whether the sample is present."""
    distinct: FloatArray
    """(V, 3, B) the variances before each of their changes; 1 where a sample is missing."""
    which: NDArray[np.intp]
    """(N,) of V, in order."""

    @property
    def variances(self) -> FloatArray:
        """(N, 3, B)."""
        return self.distinct[self.which]

    @property
    def log_density(self) -> FloatArray:
        """(N, 3, B): what each measurement adds to log L; 0 where it is missing."""
        density = -0.5 * (self.errors**2 / self.variances + np.log(self.variances) + LOG_TWO_PI)
        return np.where(self.present, density, 0.0)


class Pairs(NamedTuple):
    """Pairs of a model and a series of measurements."""

    models: Places
    """(B,) of U models."""
    series: Places
    """(B,) of S series of measurements."""

    @classmethod
    def one_to_one(cls, count: int) -> "Pairs":
        """Every model with measurements of its own."""
        return cls(np.arange(count), np.arange(count))


class Part(NamedTuple):
    """A part of -2 log L: of u models, each with r series, over K instants."""

    columns: Places
    """(u, r) of B pairs; -1 where a model has fewer series than others."""
    instants: int
    """K."""
    errors: FloatArray
    """(u, r, K or more, 3) e, in units; 0 where a sample is missing, and from K on."""
    variances: FloatArray
    """(u, K, 3) v, or (u, 1, 3) where all instants have the same; 1 where a sample is missing."""
    units: FloatArray | None
    """The variances of the first of the models that are together, whose roots are the units; None
    where each is by itself."""
    more: FloatArray | float = 0.0
    """(u, r) what the first state adds."""
    first: FloatArray | None = None
    """(u, r, n) the most probable first state, in its deviations, where models are together."""

    @property
    def repeats(self) -> int:
        """The number of instants that share each of the variances."""
        return int(self.instants // self.variances.shape[1])

    @property
    def deviance(self) -> FloatArray:
        """(u, r): the part, without the constant."""
        if self.units is None:
            flat = self.errors.reshape(*self.columns.shape, -1)
            squares = np.einsum("urk,urk->ur", flat, flat)
        elif self.repeats > 1:
            by_row = np.einsum("urkc,urkc->urc", self.errors, self.errors)
            squares = (by_row * (self.units / self.variances)).sum(axis=2)
        else:
            by_instant = self.errors**2 * (self.units / self.variances)[:, None]
            squares = by_instant.sum(axis=(2, 3))
        logs = self.repeats * np.log(self.variances).sum(axis=(1, 2))
        return np.asarray(squares + logs[:, None] + self.more)


def log_likelihood(
    model: StateSpace, measured: FloatArray, pairs: Pairs | None = None
) -> FloatArray:
    """(B,) log L of pairs of U models and S measurements (N, 3, S) of p, v, u, nan where missing.

    By default each model meets its own measurements.
    """
    pairs = pairs or Pairs.one_to_one(measured.shape[2])
    total = constant(measured, pairs)
    for part in parts(model, measured, pairs):
        is_there = part.columns >= 0
        total[part.columns[is_there]] += part.deviance[is_there]
    return -0.5 * total


def constant(measured: FloatArray, pairs: Pairs) -> FloatArray:
    """(B,): the constant of -2 log L."""
    counts = np.count_nonzero(~np.isnan(measured), axis=(0, 1))
    return np.asarray(LOG_TWO_PI * counts[pairs.series])


def parts(
    model: StateSpace, measured: FloatArray, pairs: Pairs, together: int = 1
) -> Iterator[Part]:
    """The parts of -2 log L of all pairs; arguments as for `log_likelihood`.

    So many models one after another as are ``together`` hardly differ and have the same series;
    they have their innovations in the same units.
    """
    used, own_series = np.unique(pairs.series, return_inverse=True)
    present = ~np.isnan(measured[:, :, used])
    for alike in _alike(present):
        part = present[:, :, alike]
        end = _end(part)
        member = np.full(len(used), -1)
        member[alike] = np.arange(part.shape[2])
        columns = np.flatnonzero(member[own_series] >= 0)
        models, taken = pairs.models[columns], measured[:end, :, used[alike]]
        if end and part[:end].all():
            models, columns = _by_model(models, columns)
            series = member[own_series[columns]]
            yield from _whole_parts(model.of(models), taken, series, columns, together)
        else:
            taken = taken[:, :, member[own_series[columns]]]
            yield from _instants_parts(model.of(models), taken, columns[:, None], together)


def _by_model(models: Places, columns: Places) -> tuple[Places, Places]:
    """Different models (u,), and the columns (u, r) of each, from (B,); -1 where one has fewer."""
    different, which, counts = np.unique(models, return_inverse=True, return_counts=True)
    order = np.argsort(which, kind="stable")
    rank = np.arange(len(which)) - np.repeat(counts.cumsum() - counts, counts)
    table = np.full((len(different), counts.max(initial=0)), -1)
    table[which[order], rank] = columns[order]
    return different, table


def _instants_parts(
    model: StateSpace, measured: FloatArray, columns: Places, together: int
) -> Iterator[Part]:
    """The parts of models each with measurements (N, 3, u), of which some are missing."""
    waiting = list[_Step]()
    for step in _filtered(model, measured):
        if waiting and (step.constant or len(waiting) == JOINED):
            yield _joined(waiting, columns, together)
            waiting = []
        if step.constant is None:
            waiting.append(step)
        else:
            variances = step.gains.variances[:, None]
            units = _units(variances, together)
            errors = (step.errors / np.sqrt(variances if units is None else units))[:, None]
            yield Part(columns, errors.shape[2], errors, variances, units)
    if waiting:
        yield _joined(waiting, columns, together)


def _joined(steps: "list[_Step]", columns: Places, together: int) -> Part:
    """The innovations of instants with gains of their own."""
    variances = np.stack([step.gains.variances for step in steps], axis=1)
    variances[np.isinf(variances)] = 1.0
    units = _units(variances, together)
    errors = np.concatenate([step.errors for step in steps], axis=1)
    errors /= np.sqrt(variances if units is None else units)
    return Part(columns, errors.shape[1], errors[:, None], variances, units)


def _units(variances: FloatArray, together: int) -> FloatArray | None:
    """(u, ..) the variances of the first of the models that are together."""
    return None if together == 1 else np.repeat(variances[::together], together, axis=0)


def innovations(
    model: StateSpace, measured: FloatArray, pairs: Pairs | None = None
) -> tuple[FloatArray, Innovations]:
    """Log L (B,), and the innovations it is made of; arguments as for `log_likelihood`."""
    pairs = pairs or Pairs.one_to_one(measured.shape[2])
    measured = measured[:, :, pairs.series]
    present: Mask = np.asarray(~np.isnan(measured))
    errors, variances = np.zeros(present.shape), np.ones(present.shape)
    changes = np.zeros(len(present) + 1, bool)
    changes[0] = True
    for alike in _alike(present):
        end = _end(present[:, :, alike])
        changes[end] = True
        part = model.of(pairs.models[alike])
        for step in _filtered(part, measured[:end, :, alike]):
            changed = step.gains.variances.T
            errors[step.at, :, alike] = step.errors.transpose(1, 2, 0)
            variances[step.at, :, alike] = np.where(np.isinf(changed), 1.0, changed)
            changes[step.at.start] = True
    which = changes[:-1].cumsum() - 1
    sequence = Innovations(errors, present, variances[changes[:-1]], which)
    return np.asarray(sequence.log_density.sum(axis=(0, 1))), sequence


def _alike(present: Mask) -> Iterator[Columns]:
    """The columns of (N, 3, B) that are best filtered together, group by group.

    A missing sample keeps the gains of its group from settling. So series that miss different
    samples, such as those of different length, go apart if fewer instants are incomplete then.
    """
    if present.all():
        yield slice(None)
        return
    patterns = np.packbits(present.reshape(-1, present.shape[2]).T, axis=1)
    alike: dict[bytes, list[int]] = {}
    for column, pattern in enumerate(patterns):
        alike.setdefault(pattern.tobytes(), []).append(column)
    groups = [np.array(columns) for columns in alike.values()]
    if sum(_incomplete(present[:, :, columns[:1]]) for columns in groups) < _incomplete(present):
        yield from groups
    else:
        yield slice(None)


def _incomplete(present: Mask) -> int:
    """Instants (N, 3, B) before the last sample at which one is missing."""
    return _end(present) - int(present.all(axis=(1, 2)).sum())


def _end(present: Mask) -> int:
    """The number of instants (N, 3, B) up to the last sample."""
    instants = np.flatnonzero(present.any(axis=(1, 2)))
    return int(instants[-1]) + 1 if len(instants) else 0


# Where nothing is missing


def _whole_parts(
    model: StateSpace, measured: FloatArray, series: Places, columns: Places, together: int
) -> Iterator[Part]:
    """The parts of complete measurements (N, 3, S); each of u models has the ``series`` (u, r)."""
    samples, (count, repeats) = len(measured), series.shape
    filled = np.concatenate([measured, np.tile(measured[-1:], (-samples % BLOCK, 1, 1))])
    blocks, transition = blocks_of(filled), first_axis(model.transition)
    process = first_axis(model.process)
    covariance, information = limits(transition, process, model.noise, together)
    gains = Gains.of(covariance, turned(transition), model.noise)
    apart = first_axis(model.first_covariance) - covariance
    width = max(1, STRETCH // (samples * repeats * together)) * together
    for at in range(0, count, width):
        some = slice(at, min(at + width, count))
        chosen, inputs = gains.models(some), blocks[series[some]]
        inputs[..., ::WIDTH] -= model.shift[some, None, None, None]
        constant = ConstantGain(transition[some], chosen)
        errors, push, more = constant.whole(inputs, samples, apart[some], information[some])
        variances, first = chosen.variances[:, None], None
        units = _units(variances, together)
        if units is not None:
            first = push @ _root(apart[some])
            errors *= np.tile(np.sqrt(variances / units), BLOCK)[:, None]
        errors = errors.reshape(*series[some].shape, -1, WIDTH)
        yield Part(columns[some], samples, errors, variances, units, more, first)


def _root(covariance: FloatArray) -> FloatArray:
    """Cholesky's root of matrices (u, n, n) that may be singular, or negative by rounding."""
    root = np.zeros_like(covariance)
    for k in range(covariance.shape[1]):
        column = covariance[:, k:, k] - (root[:, k:, :k] @ root[:, k, :k, None])[:, :, 0]
        is_there = column[:, 0] > 1e-12 * covariance[:, k, k]
        pivot = np.sqrt(np.where(is_there, column[:, 0], 1.0))
        root[:, k:, k] = column * (is_there / pivot)[:, None]
    return root


# Instant by instant


class _Step(NamedTuple):
    """The filter at one instant, or at several that have the same gains."""

    first: int
    """The instant, or the first of them."""
    covariance: FloatArray
    """(u, n, n): predicted."""
    state: FloatArray
    """(u, n): predicted for the first instant."""
    gains: Gains
    errors: FloatArray
    """(u, K, 3) e; 0 where a sample is missing."""
    measured: FloatArray | None = None
    """(u, K, 3): the measurements of several instants, without the intercept."""
    constant: ConstantGain | None = None
    """The maps that these share."""

    @property
    def at(self) -> slice:
        """The instants."""
        return slice(self.first, self.first + self.errors.shape[1])


def _filtered(model: StateSpace, measured: FloatArray) -> Iterator[_Step]:
    """The filter over measurements (N, 3, u), each with a model of its own."""
    present = ~np.isnan(measured)
    whole: Mask = np.asarray(present.all(axis=(1, 2)))
    instants = np.ascontiguousarray(measured.transpose(0, 2, 1))
    instants[:, :, OBSERVED[0]] -= model.shift
    transition, process, covariance = map(
        first_axis, (model.transition, model.process, model.first_covariance)
    )
    back, state, samples, k = turned(transition), model.first.T, len(measured), 0
    while k < samples:
        away, noise = instants[k] - state[:, :WIDTH], model.noise
        missing = ~present[k].T
        if not whole[k]:
            away[missing], noise = 0.0, np.where(missing.T, np.inf, noise)
        gains = Gains.of(covariance, back, noise)
        errors = np.einsum("uij,uj->ui", gains.whitening, away)
        errors[missing] = 0.0
        yield _Step(k, covariance, state, gains, errors[:, None])
        before, gain = covariance, gains.gains
        state = (state[:, None] @ back + errors[:, None] @ gain)[:, 0]
        covariance = transition @ (covariance @ back) - turned(gains.moved) @ gain
        covariance = evened(covariance + process)
        k += 1
        may_settle = k < samples and whole[k - 1] and whole[k]
        if may_settle and _has_settled(before, covariance):
            end = samples if whole[k:].all() else k + int(np.argmin(whole[k:]))
            constant = ConstantGain(transition, gains)
            for last in (end - (end - k) % BLOCK, end):
                if last > k:
                    taken_in = instants[k:last].transpose(1, 0, 2)
                    blocks = blocks_of(instants[k:last].transpose(0, 2, 1))[:, None]
                    errors, after = constant.over(blocks, state[:, None])
                    errors = errors.reshape(len(state), -1, WIDTH)
                    errors *= np.sqrt(gains.variances)[:, None]
                    yield _Step(k, covariance, state, gains, errors, taken_in, constant)
                    state, k = after[:, 0], last


def _has_settled(before: FloatArray, after: FloatArray) -> bool:
    """Whether the covariances (u, n, n) are the same."""
    former, variances = np.einsum("uii->ui", before), np.einsum("uii->ui", after)
    if (np.abs(variances - former) > SETTLED * variances).any():
        return False
    deviation = np.sqrt(np.maximum(variances, 1e-30))
    change = np.abs(after - before) / (deviation[:, :, None] * deviation[:, None])
    return bool(change.max(initial=0.0) < SETTLED)


def smooth(model: StateSpace, measured: FloatArray) -> FloatArray:
    """(N, n, B) the mean of every state, given all measurements (N, 3, B), before and after.

    Backward, Durbin and Koopman's r: the measurements of an instant are taken out, last first.
    """
    means = np.empty((len(measured), *model.first.shape))
    for alike in _alike(~np.isnan(measured)):
        part = model.of(alike)
        transition, information = first_axis(part.transition), np.zeros(part.first.T.shape)
        for step in reversed(list(_filtered(part, measured[:, :, alike]))):
            if step.constant is None or step.measured is None:
                gains = step.gains
                left = step.errors - information[:, None] @ turned(gains.moved)
                information = (information[:, None] @ transition)[:, 0]
                weighted = left / gains.variances[:, None]
                information[:, :WIDTH] += (weighted @ gains.whitening)[:, 0]
                every, states = information[:, None], step.state[:, None]
            else:
                errors = step.errors / np.sqrt(step.gains.variances)[:, None]
                every = step.constant.backward(errors, information)
                states = step.constant.states(step.measured, step.state)
                information = every[:, 0]
            smoothed = states + every @ step.covariance
            means[step.at, :, alike] = smoothed.transpose(1, 2, 0)
    return means
