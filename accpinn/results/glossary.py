"""What symbols and terms mean; tables and pages explain them by it."""

from dataclasses import dataclass

from accpinn.channels import ALPHA, BETA, FREQUENCY, GAP, LINF_GAIN, MAGNITUDE, SPEED, TAU, Quantity


@dataclass(frozen=True)
class Term:
    """A symbol or a term."""

    word: str
    meaning: str
    """Whole sentences."""
    unit: str = ""


def _of(quantity: Quantity, meaning: str) -> Term:
    return Term(quantity.symbol, f"{quantity.name}. {meaning}", quantity.unit)


GROUPS: dict[str, tuple[Term, ...]] = {
    "The model": (
        Term(
            "CTHP",
            "Constant time-headway policy: the acceleration is α(p - τv) + βΔv. The desired"
            " space-gap grows with the speed, by τ seconds of travel.",
        ),
        _of(ALPHA, "How strongly the vehicle reacts to the spacing error p - τv."),
        _of(BETA, "How strongly it reacts to the relative speed Δv."),
        _of(TAU, "The space-gap that it wants, divided by its speed."),
        _of(GAP, "Distance from its front to the rear of the vehicle ahead."),
        _of(SPEED, "Of the vehicle itself."),
        Term("Δv", "Relative speed: that of the vehicle ahead minus its own.", "m/s"),
        Term("Time gap", "Space-gap divided by speed, as it was driven.", "s"),
        Term(
            "Case",
            "In Case I one set of α, β, τ serves the whole platoon; in Case II each follower has"
            " its own.",
        ),
    ),
    "Learning": (
        Term(
            "PiNN",
            "Physics-inspired neural network: curves of speed and space-gap that are to pass"
            " through the data and to obey the model, whose parameters are learned with them.",
        ),
        Term("Ψ", "The loss that training minimises: the sum of Ψ_D, Ψ_F and Ψ_R."),
        Term("Ψ_D", "Squared distance of the network's curves from the data."),
        Term("Ψ_F", "Squared residuals of the model's equations along the network's curves."),
        Term("Ψ_R", "Squared error at the first instant."),
        Term(
            "Maximum likelihood",
            "The parameters under which the data are most probable, with disturbances that last"
            " for seconds and noise estimated along with them.",
        ),
        Term("Least squares", "The parameters that fit differences of the measured speeds best."),
    ),
    "Errors": (
        Term("MAE", "Mean absolute error."),
        Term(
            "Surrogate fit", "Error of the method's own curves, as in the paper's tables. It says"
            " how well they follow the data, not how good the parameters are.",
        ),
        Term(
            "Closed loop", "Error of a simulation with the learned parameters in which only the"
            " leader's speed is given. It shows what the parameters do.",
        ),
        Term(
            "Hold-out", "Closed loop on each third of the window, with the parameters learned from"
            " the other two.",
        ),
    ),
    "How sure": (
        Term(
            "Interval", "The values of a parameter that are consistent with the data, at 90 %, if"
            " the model holds.",
        ),
        Term(
            "Probability", "The share of parameter sets consistent with the data (posterior"
            " samples) for which something holds.",
        ),
        Term("Identified", "An interval spans less than a factor of five."),
        Term(
            "Condition number", "Of the model's terms on these data: where it is large, they move"
            " so alike that their coefficients cannot be told apart.",
        ),
        Term("AIC", "Akaike's information criterion: lower is better supported by the data."),
    ),
    "String stability": (
        Term(
            "L₂", "The energy of a disturbance does not grow from a vehicle to the next: |H| is at"
            " most 1 at every frequency.",
        ),
        Term(
            "L∞", "The peak of a disturbance does not grow: ‖h‖₁ is at most 1. The paper tests"
            " instead whether the poles are real, which is necessary but not sufficient.",
        ),
        _of(MAGNITUDE, "How much a vehicle amplifies a sinusoidal disturbance of the speed."),
        _of(LINF_GAIN, "The largest factor by which a peak can grow."),
        _of(FREQUENCY, "Of a sinusoidal disturbance; 0.25 rad/s is a wave of 25 s."),
        Term("ω_c", "The frequency below which a vehicle amplifies.", "rad/s"),
        Term("Strictly stable", "Nothing grows at any vehicle of the platoon."),
        Term("Weakly stable", "Nothing has grown at the last vehicle."),
    ),
}  # fmt: skip
"""By subject."""

_KNOWN = {term.word: term.meaning for terms in GROUPS.values() for term in terms}


def meaning_of(word: str) -> str:
    """What a symbol or a term means; empty for one that is not in the glossary."""
    return _KNOWN.get(word, "")
