"""All car-following models: their accelerations, parameters and priors.

A further model is an acceleration and an entry among `BASES`. A model's key names its terms:
"cthp-s0-delay".

The CTHP, with α [1/s²] and β [1/s] gains, τ [s] the time headway and s₀ [m] an intercept:

    f = α (p - s₀ - τv) + β (u - v)

The gap in equilibrium is s₀ + τv. s₀ need not be the gap that is kept at standstill, as recordings
on motorways determine s₀ + τv at their speeds and neither term alone. The exact solutions of the
CTHP are in `model.cthp`; tests compare those of every model with them.

The intelligent driver model (IDM), with a [m/s²] acceleration, b [m/s²] comfortable braking, T [s]
time headway, s₀ [m] gap at standstill and v₀ [m/s] desired speed:

    f = a [1 - (v/v₀)⁴ - (s*/p)²],   s* = s₀ + vT + v (v - u) / (2 √(ab))

Behind a car at motorway speeds v₀ and b are hardly determined, so their priors are informative.

The full velocity difference model (FVDM), with gains κ [1/s] and γ [1/s], and V₁ [m/s], c [1/m] and
p₀ [m] that shape the optimal speed V at a gap (the source's λ and d are a lag and a delay here):

    f = κ (V(p) - v) + γ (u - v),   V(p) = V₁ [tanh(c (p - p₀)) + tanh(c p₀)]

Sources: Apostolakis and Ampountolas, IEEE TVT 2024 (CTHP); Treiber, Hennecke and Helbing, Physical
Review E 62 (2000) 1805-1824, equations 3 and 4 (IDM); Jiang, Wu and Zhu, Physical Review E 64
(2001) 017101 (FVDM), V after Bando et al., Physical Review E 51 (1995) 1035.
"""

import re
from collections.abc import Sequence
from hashlib import sha256
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from accpinn.channels import PARAMETER_KEYS
from accpinn.errors import ConfigError, shown
from accpinn.model.cthp import Parameters, Trajectories
from accpinn.model.cthp import simulate as simulate_cthp
from accpinn.model.following import COMPLEX_STEP, ConstantTimeHeadway, FollowingModel, Parameter
from accpinn.model.unequal_gains import UNEQUAL_GAINS
from accpinn.units import FloatArray


def cthp(p: Any, v: Any, u: Any, theta: Sequence[Any], xp: Any) -> Any:
    """Acceleration in m/s² by α, β, τ: the paper's model, without s₀."""
    alpha, beta, tau = theta[:3]
    return alpha * (p - tau * v) + beta * (u - v)


def cthp_with_intercept(p: Any, v: Any, u: Any, theta: Sequence[Any], xp: Any) -> Any:
    """Acceleration in m/s² by α, β, τ, s₀."""
    return cthp(p - theta[3], v, u, theta, xp)


def idm(p: Any, v: Any, u: Any, theta: Sequence[Any], xp: Any) -> Any:
    """Acceleration in m/s² by a, b, T, s₀, v₀."""
    a, b, headway, s0, v0 = theta[:5]
    wanted = s0 + v * (headway + (v - u) / (2.0 * xp.sqrt(a * b)))
    pace, closeness = (v / v0) ** 2, wanted / p
    return a * (1.0 - pace * pace - closeness * closeness)


def fvdm(p: Any, v: Any, u: Any, theta: Sequence[Any], xp: Any) -> Any:
    """Acceleration in m/s² by κ, γ, V₁, c, p₀."""
    kappa, relative, scale, steepness, middle = theta[:5]
    optimal = scale * (xp.tanh(steepness * (p - middle)) + xp.tanh(steepness * middle))
    return kappa * (optimal - v) + relative * (u - v)


_ALPHA = Parameter("alpha", "α", "1/s²", 1e-4, 10.0, 0.08, 1.0)
_BETA = Parameter("beta", "β", "1/s", 1e-4, 10.0, 0.2, 1.0)

CTHP = ConstantTimeHeadway(
    "cthp",
    "CTHP",
    (_ALPHA, _BETA, Parameter("tau", "τ", "s", 0.05, 10.0, 1.4, 0.3)),
    cthp,
    formula="α (p − τ v) + β Δv",
)
CTHP_S0 = ConstantTimeHeadway(
    "cthp-s0",
    "CTHP with intercept s₀",
    (
        _ALPHA,
        _BETA,
        Parameter("tau", "τ", "s", 0.05, 10.0, 1.0, 0.5),
        Parameter("s0", "s₀", "m", -50.0, 100.0, 5.0, 6.0),
    ),
    cthp_with_intercept,
    terms=("s0",),
    formula="α (p − s₀ − τ v) + β Δv",
)
IDM = FollowingModel(
    "idm",
    "IDM",
    (
        Parameter("a", "a", "m/s²", 0.02, 20.0, 1.0, 0.8),
        Parameter("b", "b", "m/s²", 0.05, 400.0, 2.0, 1.0),
        Parameter("T", "T", "s", 0.05, 10.0, 1.1, 0.4),
        Parameter("s0", "s₀", "m", 0.1, 50.0, 4.0, 0.7),
        Parameter("v0", "v₀", "m/s", 5.0, 100.0, 38.0, 0.2),
    ),
    idm,
    formula="a [1 − (v/v₀)⁴ − (s*/p)²] with s* = s₀ + v T − v Δv / (2 √(a b))",
)
FVDM = FollowingModel(
    "fvdm",
    "FVDM",
    (
        Parameter("kappa", "κ", "1/s", 1e-3, 10.0, 0.1, 1.0),
        Parameter("relative", "γ", "1/s", 1e-4, 10.0, 0.2, 1.0),
        Parameter("scale", "V₁", "m/s", 2.0, 100.0, 20.0, 0.4),
        Parameter("steepness", "c", "1/m", 0.005, 0.5, 0.05, 0.5),
        Parameter("middle", "p₀", "m", 0.5, 200.0, 20.0, 0.4),
    ),
    fvdm,
    formula="κ [V₁ (tanh(c (p − p₀)) + tanh(c p₀)) − v] + γ Δv",
)

BASES = (
    CTHP,
    CTHP_S0,
    UNEQUAL_GAINS,
    IDM,
    FVDM,
)


def _variants(base: FollowingModel) -> dict[str, FollowingModel]:
    """A model, also behind a lag or a delay, by their keys."""
    return {model.key: model for model in (base, base.behind_a("lag"), base.behind_a("delay"))}


FOLLOWING: dict[str, FollowingModel] = {
    key: model for base in BASES for key, model in _variants(base).items()
}
"""Every model by its key, each also behind a lag or a delay; `register_model` adds to it."""
SHIPPED = frozenset(FOLLOWING)
"""Keys of the models that are part of the package."""
PAPER = CTHP.key
"""The paper's model."""
BEST = "cthp-s0-delay"
"""The recommended model: of those with an exact likelihood none predicts the gap better in windows
left out, and none is clearly closer to the measured gain (docs/validation.md)."""
Fixed = tuple[tuple[str, float], ...]
"""Names of parameters that keep their values, with these."""
TITLES: dict[str, str] = {key: model.title for key, model in FOLLOWING.items()}
"""Their names for people."""
JUDGED = (PAPER, BEST, UNEQUAL_GAINS.key, IDM.key, FVDM.key)
"""Models that are judged unless others are named: the paper's, the answer's, and the usual ones."""


def following_model(key: str) -> FollowingModel:
    """The model of that key.

    Raises:
        ConfigError: for an unknown key.
    """
    if not isinstance(key, str) or key not in FOLLOWING:
        keys, name = ", ".join(FOLLOWING), shown(key).strip("'")
        raise ConfigError(f"model: {name} is not known; choose from {keys}.")
    return FOLLOWING[key]


_KEY = re.compile(r"[a-z][a-z0-9]*(-[a-z0-9]+)*")
_PROBES = 16
"""Motions at which the acceleration of a registered model is evaluated."""


def register_model(model: FollowingModel) -> None:
    """Add a car-following model, which this process then knows by its key everywhere.

    It is also known behind a lag and behind a delay, by its key with "-lag" and "-delay". A model
    that was registered before is replaced, so that a notebook's cell can be run again.

    Args:
        model: an acceleration with named parameters, see `FollowingModel`.

    Raises:
        ConfigError: for a key that the package uses, or a model that cannot be estimated.

    Examples:
        >>> import accpinn
        >>> def acceleration(p, v, u, theta, xp):  # keeps the gap d + T v
        ...     return theta[0] * (p - theta[1] - theta[2] * v) + theta[3] * (u - v)
        >>> parameters = [
        ...     accpinn.Parameter("k", "k", "1/s²", 1e-3, 5.0, 0.1, 1.0),
        ...     accpinn.Parameter("d", "d", "m", 0.1, 50.0, 4.0, 0.7),
        ...     accpinn.Parameter("T", "T", "s", 0.1, 5.0, 1.2, 0.4),
        ...     accpinn.Parameter("c", "c", "1/s", 1e-3, 5.0, 0.2, 1.0),
        ... ]
        >>> model = accpinn.FollowingModel("linear", "Linear", tuple(parameters), acceleration)
        >>> accpinn.register_model(model)
        >>> accpinn.fit(accpinn.sample("motorway"), vehicles="1-2", model="linear").estimate.model
        'linear'
    """
    names = [parameter.name for parameter in model.parameters]
    taken = {*PARAMETER_KEYS} & {*names}
    for is_good, fault in (
        (_KEY.fullmatch(model.key), f"its key {model.key[:40]!r} is not lower case and hyphens"),
        (not SHIPPED & {*_variants(model)}, f"the key {model.key[:40]} is the package's own"),
        (names and len({*names}) == len(names), "it has no parameters, or two of one name"),
        (not taken, f"{', '.join(sorted(taken))} would be the linearisation's, too"),
        (not model.terms and not model.is_linear, "terms and the CTHP's solutions are not its own"),
        (
            all(p.lower < p.typical < p.upper and p.spread > 0 for p in model.parameters),
            "a typical value lies outside its bounds, or has no spread",
        ),
    ):
        if not is_good:
            raise ConfigError(f"model: {fault}; give a key, parameters and an acceleration anew.")
    try:
        _fingerprint(model)
    except Exception as fault:  # whatever somebody's function raises
        raise ConfigError(
            f"model: its acceleration fails at ordinary motions ({str(fault)[:120]}); let it take"
            " p, v, u, theta and xp, by operators and functions that complex numbers have."
        ) from None
    FOLLOWING.update(_variants(model))
    TITLES.update({key: variant.title for key, variant in _variants(model).items()})


def fingerprint(key: str) -> str:
    """The fingerprint of a registered model; empty for the package's own.

    Two models of the same key have different ones. It is a digest of the parameters with their
    priors, and of the acceleration at some motions.
    """
    return _fingerprint(FOLLOWING[key]) if key in FOLLOWING.keys() - SHIPPED else ""


def _fingerprint(model: FollowingModel) -> str:
    """See `fingerprint`; exceptions of the acceleration are passed on."""
    chance = np.random.default_rng(1)
    z = np.clip(chance.normal(size=(len(model.parameters), _PROBES)), -1.0, 1.0)
    theta = np.array([p.value(row) for p, row in zip(model.parameters, z, strict=True)])
    p, v, u = chance.uniform([[5.0], [2.0], [2.0]], [[60.0], [30.0], [30.0]], (3, _PROBES))
    moved = np.asarray(model.acceleration(p + COMPLEX_STEP * 1j, v, u, theta, np))
    if moved.shape != (_PROBES,) or not np.isfinite(moved).all():
        raise ValueError("it does not give one finite number for each motion")
    numbers = [f"{value:.9g}" for value in (*moved.real, *(moved.imag / COMPLEX_STEP))]
    return sha256(repr((model.parameters, numbers)).encode()).hexdigest()


def value_of(model: str, parameters: Parameters, name: str) -> FloatArray:
    """(..) one parameter of a model's sets (..), by its name; also α, β, τ of a linearisation."""
    if name in PARAMETER_KEYS or parameters.is_linear:
        return np.asarray(getattr(parameters, name))
    return parameters.nonlinear[..., FOLLOWING[model].names.index(name)]


def has_terms_of(model: str, parameters: Parameters) -> bool:
    """Whether a model has all terms that parameters have, so that each has the same meaning."""
    return FOLLOWING[model].has_terms_of(parameters)


def time_gap(model: str, parameters: Parameters, speed: ArrayLike) -> FloatArray:
    """(..) the time gap in equilibrium at a speed (..) in m/s above zero; nan without one."""
    if parameters.is_linear:
        return parameters.time_gap(speed)
    theta = np.moveaxis(parameters.nonlinear, -1, 0)
    speed = np.asarray(speed, float)
    return np.asarray(FOLLOWING[model].equilibrium_gaps(theta, speed) / speed)


def gains_and_gap(model: str, parameters: Parameters, speed: ArrayLike) -> FloatArray:
    """(.., 3) α, β and the time gap at a speed; arguments as for `time_gap`."""
    gap = time_gap(model, parameters, speed)
    return np.stack([parameters.alpha, parameters.beta, gap], axis=-1)


def simulate(
    model: str,
    parameters: Parameters,
    time: FloatArray,
    leader_speed: FloatArray,
    initial_speeds: FloatArray,
    initial_gaps: FloatArray,
) -> Trajectories:
    """The closed loop of any model; a CTHP's is exact. See `cthp.simulate` for the arguments."""
    if parameters.is_linear:
        return simulate_cthp(parameters, time, leader_speed, initial_speeds, initial_gaps)
    return FOLLOWING[model].simulate(
        parameters.nonlinear.T, time, leader_speed, initial_speeds, initial_gaps
    )
