"""The posterior distribution of the parameters, given the exact likelihood, as weighted draws.

    p(z | recording) ∝ L(z) p(z),   z = ln of all unknowns (see `methods.maximum_likelihood`)

is sampled as `inference.importance_sampling` tells; the first proposal has the curvature at the
maximum. An unknown that a bound holds at the maximum stays there, except α, ατ, β and the further
unknown of a form.

With a lag or a delay the posterior is a curved ridge and may have two modes. The proposal is then a
mixture with a part at the maximum and one for each of several values of the lag. Each of these lies
at the maximum of the criterion for its value, is as wide as these values are apart, and adapts to
the draws near it. What is proposed below the least value is folded back there.

With an intercept s₀ it is the time gap at the mean speed v that is determined, and of τ and s₀ only
τ + s₀/v. So proposals are of w, which is z with ln α(τ + s₀/v) in place of ln ατ: there the ridge
is straight. Its end, τ = 0, is folded as well; a part whose maximum lies there is moved along the
ridge into the inside.

The prior of α, β and τ is wide: normal in their logarithms, so that 95 % of α lie within a factor
of fifty of 0.08 1/s², of β within one of twenty of 0.2 1/s, and of τ within one of three of 1.4 s.
It matters only where a recording contains little information, and keeps intervals finite there.
"""

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from accpinn.inference.coordinates import LEAST_GAP, PRIOR_SPREAD, time_gap_coordinates
from accpinn.inference.importance_sampling import (
    S0,
    Posterior,
    Proposal,
    Sampling,
    Student,
    floored,
    normalised,
)
from accpinn.methods.likelihood import Criterion, Groups, Maximum, search
from accpinn.methods.series import Series
from accpinn.methods.state_space import Form
from accpinn.model.cthp import TYPICAL
from accpinn.model.registry import FOLLOWING
from accpinn.model.spec import ModelSpec
from accpinn.units import FloatArray, MetresPerSecond

STAGES = (150, 150, 150, 200)
"""Number of draws in each stage."""
FURTHER = 40
"""Largest number of further stages, as large as the last one."""
GRID, ROUGH = (0.3, 0.8, 1.4), 1e-2
"""Lags or delays in s of the parts of the first proposal, and the gain in log density that is worth
no further round in the search for a part's maximum."""
INSIDE = 0.2
"""Share that τ has in the time gap τ + s₀/v of a part that is moved inside; a quarter of it is too
near to the end of the ridge."""
LEAST_PRECISION = 0.25
"""Least precision of the first proposal in any direction, against a flat criterion."""
SLOWEST: MetresPerSecond = 2.0
"""Least speed v for a time gap that is to hold in a window."""


def log_prior_of_theta(form: Form, z: FloatArray) -> FloatArray:
    """(..) log prior of α, β and the time gap at coordinates (.., P), up to a constant.

    It is a density over φ of `inference.coordinates`, so dτ counts relative to the change of the
    time gap.
    """
    shape = time_gap_coordinates(form).of_unknowns(z)[..., :3]
    away = (shape - np.log(TYPICAL.values)) / PRIOR_SPREAD
    volume = z[..., 1] - z[..., 0] - shape[..., 2]
    return np.asarray(-0.5 * (away**2).sum(axis=-1) + volume)


def sample(
    series: Series,
    maxima: Sequence[Maximum],
    spec: ModelSpec,
    seeds: Sequence[int],
    others: Callable[[FloatArray], FloatArray] | None = None,
) -> tuple[Posterior, ...]:
    """Sample the posterior of each of G groups from its maximum (G,) on, by its seed (G,).

    A group's draws do not depend on the other groups. ``others`` gives the logarithms (n,) of a
    further factor of the density at draws (n, P), as what other cars say; enough draws count with
    it, too.
    """
    criterion, form = Criterion(series, spec), spec.model
    rngs = [np.random.default_rng(seed) for seed in seeds]
    means = (np.nanmean(series.measured[:, 1, series.members(g)]) for g in range(len(maxima)))
    speeds = [max(SLOWEST, float(mean)) for mean in means]
    least = criterion.lower[-1] if FOLLOWING[form].is_late else -np.inf
    fixed = criterion.lower == criterion.upper
    is_ridge = "s0" in FOLLOWING[form].terms and not fixed[S0]
    samplings = []
    for g, (first, speed) in enumerate(zip(_first_parts(criterion, maxima), speeds, strict=True)):
        inside = (_inside(criterion, g, part, speed) if is_ridge else part for part in first)
        ends = least, speed if is_ridge else np.inf
        first_proposal = _first_proposal([_by_time_gap(part, speed) for part in inside], *ends)
        samplings.append(Sampling(first_proposal, criterion.size))
    wanted = list(range(len(maxima)))
    for stage, count in enumerate((*STAGES, *[STAGES[-1]] * FURTHER)):
        drawn = [samplings[g].proposal.draw(count, rngs[g]) for g in wanted]
        for w in drawn:
            w[:, fixed] = criterion.lower[fixed]  # a mean of equal values may round
        pairs = zip(wanted, drawn, strict=True)
        coordinates = np.concatenate([_from_time_gap(form, w, speeds[g]) for g, w in pairs])
        places = np.repeat(np.array(wanted), count)
        prior, likelihood = log_posterior(criterion, coordinates, places)
        shape = len(wanted), count
        parts = coordinates.reshape(*shape, -1), prior.reshape(shape), likelihood.reshape(shape)
        for g, w, z, priors, likelihoods in zip(wanted, drawn, *parts, strict=True):
            target = likelihoods + priors + w[:, 1] - z[:, 1]  # the last two are ln |dz/dw|
            factor = others(z) if others else np.zeros(count)
            samplings[g].add(w, z, target, likelihoods, factor)
        if stage >= len(STAGES) - 1:
            wanted = [g for g in wanted if samplings[g].lacks]
        if not wanted:
            break
    return tuple(sampling.posterior for sampling in samplings)


def _first_proposal(maxima: Sequence[Maximum], least: float, speed: MetresPerSecond) -> Proposal:
    """A mixture with a part at each maximum; all but the first lie on the grid of the lag."""
    curvatures = np.array([maximum.curvature for maximum in maxima])
    if len(maxima) > 1:
        # An unknown that a bound holds in some parts varies in these as well.
        held = np.where(np.diagonal(curvatures, axis1=1, axis2=2) > 0, 0.0, 1.0)
        usual = np.diagonal(curvatures, axis1=1, axis2=2).max(axis=0)
        curvatures += np.einsum("kp,pq->kpq", held * usual, np.eye(len(usual)))
        grid = [maximum.coordinates[-1] for maximum in maxima[1:]]
        curvatures[1:, -1, -1] += 1.0 / np.gradient(grid) ** 2
    parts, mass = list[Student](), []
    for maximum, curvature in zip(maxima, curvatures, strict=True):
        free = np.diag(curvature) > 0
        free[:3] = True
        square = np.ix_(free, free)
        values, vectors = np.linalg.eigh(curvature[square])
        scale = np.zeros_like(curvature)
        scale[square] = vectors / np.maximum(values, LEAST_PRECISION) @ vectors.T
        parts.append(Student(maximum.coordinates, scale))
        mass.append(maximum.criterion + np.log(np.diag(parts[-1].root[1])).sum())
    return Proposal(tuple(parts), floored(normalised(np.array(mass))), least, speed)


def _inside(criterion: Criterion, group: int, part: Maximum, speed: MetresPerSecond) -> Maximum:
    """A part at the end of the ridge, τ = 0, moved along it to where τ is `INSIDE` of the gap."""
    z = part.coordinates.copy()
    tau = np.exp(z[1] - z[0])
    gap = tau + z[S0] / speed
    if tau > INSIDE / 4 * gap:
        return part
    z[1], z[S0] = z[0] + np.log(INSIDE * gap), (1.0 - INSIDE) * gap * speed
    value, _, information = criterion.score(z[None], np.array([group]))
    free = np.diag(part.curvature) > 0
    free[:3] = True
    bent = np.where(np.logical_and.outer(free, free), information[0], 0.0)
    return replace(part, coordinates=z, curvature=bent, criterion=float(value[0]))


def _by_time_gap(maximum: Maximum, speed: MetresPerSecond) -> Maximum:
    """A maximum in the coordinates w of proposals."""
    if "s0" not in FOLLOWING[maximum.form].terms:
        return maximum
    (alpha, alpha_tau), w = np.exp(maximum.coordinates[:2]), maximum.coordinates.copy()
    w[1] = w[0] + np.log(max(alpha_tau / alpha + w[S0] / speed, LEAST_GAP))
    slope, ratio = np.eye(len(w)), float(np.exp(w[1]) / alpha_tau)
    slope[1, [0, 1, S0]] = 1.0 - ratio, ratio, -alpha / alpha_tau / speed
    bent = maximum.curvature
    if bent[1, 1]:  # else a bound holds ατ
        bent = slope.T @ bent @ slope
    return replace(maximum, coordinates=w, curvature=bent)


def _from_time_gap(form: Form, w: FloatArray, speed: MetresPerSecond) -> FloatArray:
    """(n, P) z of draws w (n, P); ln ατ lies below all bounds where s₀ is more than the gap."""
    if "s0" not in FOLLOWING[form].terms:
        return w
    z = w.copy()
    alpha_tau = np.exp(w[:, 1]) - np.exp(w[:, 0]) * w[:, S0] / speed
    z[:, 1] = np.log(np.maximum(alpha_tau, np.finfo(float).tiny))
    return z


def _first_parts(criterion: Criterion, maxima: Sequence[Maximum]) -> Sequence[Sequence[Maximum]]:
    """The maxima of the parts of each group's first proposal.

    A form with a curved posterior has beside the maximum one part for each of several values of its
    lag or delay.
    """
    is_free = criterion.lower[-1] < criterion.upper[-1]
    if not is_free or not FOLLOWING[criterion.form].is_late:
        return [[maximum] for maximum in maxima]
    rows = np.array([np.append(m.coordinates[:-1], lag) for lag in GRID for m in maxima])
    criterion.negligible = ROUGH
    parts = search(criterion, rows, np.arange(len(rows)) % len(maxima), is_last_held=True)
    return [[maximum, *parts[g :: len(maxima)]] for g, maximum in enumerate(maxima)]


def log_posterior(
    criterion: Criterion, z: FloatArray, groups: Groups
) -> tuple[FloatArray, FloatArray]:
    """(n,) log prior and log likelihood of draws (n, P); both -inf where nothing is plausible."""
    inside = ((z >= criterion.lower - 1e-12) & (z <= criterion.upper + 1e-12)).all(axis=1)
    plausible = z[inside]
    parts = np.full((2, len(z)), -np.inf)
    parts[0, inside] = criterion.log_prior(plausible) + log_prior_of_theta(
        criterion.form, plausible
    )
    parts[1, inside] = criterion.log_likelihood(plausible, groups[inside])
    parts[:, ~np.isfinite(parts).all(axis=0)] = -np.inf
    return parts[0], parts[1]
