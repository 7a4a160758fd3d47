"""Findings of estimation methods, each with the sentence that users read."""

from accpinn.findings import Finding, Labelled, Words
from accpinn.model.cthp import Parameters


class BoundActive(Finding, frozen=True):
    """The rational driving constraints hold components of θ at zero."""

    text = (
        "{vehicle}: the rational driving constraints hold {names} at zero; without them the"
        " estimate is α = {free.alpha:.4f}, β = {free.beta:.4f}, τ = {free.tau:.3f}, which suggests"
        " a delay or a model that does not fit."
    )

    vehicle: int
    names: tuple[str, ...]
    """The components: some of α, ατ and β."""
    unconstrained: tuple[float, float, float]
    """The estimate of θ without the constraints."""

    def _words(self, about: Labelled) -> Words:
        return {"free": Parameters.from_theta(self.unconstrained)}


class BoundActiveAtTimes(Finding, frozen=True):
    """A bound was active for a part of the time over which an online estimate is averaged."""

    text = (
        "{vehicle}: {name} was at its bound, zero, for {share:.0%} of the time over which the"
        " parameters are averaged."
    )

    vehicle: int
    name: str
    """The component: α, ατ or β."""
    share: float
    """Share of the time, 0 to 1."""


class WeaklyDetermined(Finding, frozen=True):
    """The recording does not determine α, β and τ; other sets reproduce it equally well."""

    text = (
        "{vehicle}: the recording does not determine α, β and τ; these parameters are one"
        " possibility of many."
    )

    vehicle: int | None
    """None for the one set that all followers share."""


class Undetermined(Finding, frozen=True):
    """Parameters of a model about which the data say hardly more than the prior."""

    text = (
        "{vehicle}: these data say hardly more about {symbols} of the {model} than is known of cars"
        " beforehand."
    )

    vehicle: int
    model: str
    """Its title."""
    symbols: tuple[str, ...]


class Implausible(Finding, frozen=True):
    """Parameters of a model far outside what is known of cars, where only their direction shows."""

    text = (
        "{vehicle}: {symbols} of the {model} {verb} far outside what is known of cars, so these"
        " data determine the direction and not the value."
    )

    vehicle: int
    model: str
    """Its title."""
    symbols: tuple[str, ...]

    def _words(self, about: Labelled) -> Words:
        return {"verb": "lies" if len(self.symbols) == 1 else "lie"}


class FilterUncertain(Finding, frozen=True):
    """A filter's gain that is not significantly different from zero at the end."""

    text = (
        "{vehicle}: {name} = {value:.4f} has a standard deviation of {deviation:.4f} in the filter,"
        " so it is not significantly different from zero."
    )

    vehicle: int
    name: str
    """α or β."""
    value: float
    deviation: float
    """The filter's standard deviation."""


class FilterDiverged(Finding, frozen=True):
    """The measurements jump by more than vehicles can, and a covariance lost its meaning."""

    text = (
        "{source}: the filter diverged, as speeds and space-gaps jump by more than vehicles can;"
        " choose another window."
    )


class SimulatedSeparately(Finding, frozen=True):
    """Each follower was simulated behind its measured predecessor."""

    text = (
        "Each follower is fitted behind its measured predecessor; in a simulation of the platoon"
        " behind its leader alone, the errors of the vehicles ahead add up."
    )


class HiddenLayersGain(Finding, frozen=True):
    """The reduction of Ψ by training the hidden layers."""

    text = "Training hidden layers changed Ψ from {before:#.4g} to {after:#.4g} ({change:+z.1%})."

    before: float
    after: float

    def _words(self, about: Labelled) -> Words:
        return {"change": self.after / self.before - 1}


class HoldoutLoss(Finding, frozen=True):
    """The loss at random instants that were kept out of training."""

    text = (
        "At {instants} random instants that were kept out of training the loss has Ψ_D ="
        " {data:#.4g} (distance from the data) and Ψ_F = {physics:#.4g} (misfit of the model)."
        " Instants beside them were learned from, so in another window both are larger."
    )

    instants: int
    data: float
    """Ψ_D."""
    physics: float
    """Ψ_F."""


class Continued(Finding, frozen=True):
    """The training resumed from a checkpoint."""

    text = "Continued from iteration {iteration:,} of an earlier training."

    iteration: int


class CacheProblem(Finding, frozen=True):
    """A file of the cache that could not be used, read or written."""

    text = "{problem}"

    problem: str
    """A sentence of the store, which names the file and the cure."""


MethodFinding = (
    BoundActive
    | BoundActiveAtTimes
    | WeaklyDetermined
    | Undetermined
    | Implausible
    | FilterUncertain
    | FilterDiverged
    | SimulatedSeparately
    | HiddenLayersGain
    | HoldoutLoss
    | Continued
    | CacheProblem
)
