"""Glossary of the symbols and terms of tables and pages."""

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
        _of(ALPHA, "Strength of the reaction to the spacing error p - τv."),
        _of(BETA, "Strength of the reaction to the relative speed Δv."),
        _of(TAU, "The desired space-gap divided by the speed."),
        _of(GAP, "Distance from the vehicle's front to the rear of the vehicle ahead."),
        _of(SPEED, "Speed of the vehicle itself."),
        Term("Δv", "Relative speed: speed of the vehicle ahead minus the vehicle's own.", "m/s"),
        Term("Time gap", "Space-gap divided by speed, measured or in equilibrium.", "s"),
        Term(
            "s₀", "Intercept: in equilibrium the space-gap is s₀ + τv. It need not be the gap at"
            " standstill.", "m",
        ),
        Term("λ", "Time constant of the actuator, a first-order lag.", "s"),
        Term("d", "Delay between what a vehicle measures and its acceleration.", "s"),
        Term(
            "Answer", "One complete parameter set a vehicle, the same whatever the method, with the"
            " interval of its typical value and that of a further window.",
        ),
        Term(
            "Case",
            "In Case I one set of α, β, τ serves the whole platoon; in Case II each follower has"
            " its own.",
        ),
    ),
    "Learning": (
        Term(
            "PiNN",
            "Physics-inspired neural network: curves of speed and space-gap that pass"
            " through the data and obey the model, whose parameters are learned with them.",
        ),
        Term("Ψ", "The loss that training minimises: the sum of Ψ_D, Ψ_F and Ψ_R."),
        Term("Ψ_D", "Squared distance of the network's curves from the data."),
        Term("Ψ_F", "Squared residuals of the model's equations along the network's curves."),
        Term("Ψ_R", "Squared error at the first instant."),
        Term(
            "Maximum likelihood",
            "The parameters under which the data are most probable; disturbances that last for"
            " seconds and noise are estimated together with them.",
        ),
        Term("Least squares", "The parameters that fit the accelerations best."),
    ),
    "Errors": (
        Term("MAE", "Mean absolute error."),
        Term(
            "Surrogate fit", "Error of the method's own curves, as in the paper's tables. It"
            " measures how well they follow the data, not how good the parameters are.",
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
    "Uncertainty": (
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
            "Condition number", "A large condition number means that the model's terms are nearly"
            " proportional on these data, so their coefficients cannot be distinguished.",
        ),
        Term(
            "AIC", "Akaike's information criterion: the data support a model with a lower AIC"
            " better.",
        ),
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
        _of(MAGNITUDE, "Amplification of a sinusoidal disturbance of the speed by a vehicle."),
        _of(LINF_GAIN, "The largest factor by which a peak can grow."),
        _of(FREQUENCY, "Frequency of a sinusoidal disturbance; 0.25 rad/s is a wave of 25 s."),
        Term("ω_c", "The frequency below which a vehicle amplifies.", "rad/s"),
        Term("Strictly stable", "No vehicle of the platoon amplifies anything."),
        Term("Weakly stable", "Nothing grows from the leader to the last vehicle."),
    ),
}  # fmt: skip
"""Terms by subject."""

MEANINGS = {term.word: term.meaning for terms in GROUPS.values() for term in terms}
