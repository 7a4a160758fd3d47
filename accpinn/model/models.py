"""The models: the CTHP, and terms that may stand beside it.

    command       c = α (p - s₀ - τ v) + β (u - v)         p space-gap, v own speed, u speed ahead
    acceleration  dv/dt = c                                without a lag or a delay
                  λ d²v/dt² + dv/dt = c                    first-order lag λ [s] of the actuator
                  dv/dt = c a time d ago                   delay d [s]

s₀ [m] is an intercept: the gap in equilibrium is s₀ + τv. It need not be the gap that is kept at
standstill, as recordings on motorways determine s₀ + τv at their speeds and neither term alone. A
model's key names its terms: "cthp-s0-delay".

Where states are needed, a delay is its Padé approximant of second order,

    e^(-ds) ≈ (1 - ds/2 + d²s²/12) / (1 + ds/2 + d²s²/12)

whose phase is right within 1 % up to ωd = 2.
"""

from typing import Literal, get_args

from accpinn.errors import ConfigError

Model = Literal["cthp", "cthp-s0", "cthp-lag", "cthp-delay", "cthp-s0-lag", "cthp-s0-delay"]
MODELS: tuple[Model, ...] = get_args(Model)
Term = Literal["s0", "lag", "delay"]
TERMS: tuple[Term, ...] = get_args(Term)
"""The terms in the order of `Parameters.complete`, behind α, β, τ."""
Held = tuple[tuple[str, float], ...]
"""Names of terms that keep their values, with these."""
PAPER: Model = "cthp"
"""The paper's model."""
BEST: Model = "cthp-s0-delay"
"""The model of answers: none predicts the gap in other windows better in the mean over the cars of
the recordings at hand, and none is closer to the measured gain (docs/validation.md)."""


def terms_of(model: str) -> tuple[Term, ...]:
    """The terms that a model adds to the CTHP, in the order of `TERMS`."""
    named = model.split("-")[1:]
    return tuple(term for term in TERMS if term in named)


def model_of(key: str) -> Model:
    """The model of that key.

    Raises:
        ConfigError: for an unknown key.
    """
    for model in MODELS:
        if model == key:
            return model
    raise ConfigError(f"model: {key[:40]} is not known; choose {', '.join(MODELS)}.")
