"""The user's choices on the pages Stability and Platoon: parameters, map and disturbance."""

from dataclasses import dataclass, field
from typing import Any, Literal

from accpinn.model.published import ASTAZERO
from accpinn.units import RadiansPerSecond

Source = Literal["fit", "published", "snapshot", "hand"]
Plane = Literal["beta", "alpha"]
Disturbance = Literal["sinusoid", "step", "brake", "recorded"]
MOST_FOLLOWERS = 20
TypedRow = tuple[str, float | None, float | None, float | None]
"""Name, α, β, τ of a vehicle as typed in; None where a cell is empty."""


@dataclass(eq=False)
class ParameterChoice:
    """Where α, β and τ come from."""

    source: Source | None = None
    """None: from the fit as soon as there is one, until then a published example."""
    example: str = ASTAZERO.title
    snapshot: str = ""
    """Short name of the snapshot; empty: the newest."""
    rows: tuple[TypedRow, ...] = ()
    """By hand; a copy of what was shown before once that is chosen."""
    base: tuple[TypedRow, ...] = ()
    """The rows with which the table came to the page."""


@dataclass(eq=False)
class MapChoice:
    """Which plane of parameters is drawn."""

    plane: Plane = "beta"
    held: int = -1
    """Index of the vehicle whose third parameter is kept; -1 is the last."""
    uncertainty: bool = True
    """Show the uncertainty."""


@dataclass(eq=False)
class PlatoonChoice:
    """Which platoon is simulated, and its leader's disturbance."""

    order: Literal["learned", "repeated", "own"] = "learned"
    vehicle: int = 0
    """Index of the vehicle that is repeated."""
    followers: int = 8
    own: str = ""
    """Own order, as typed in."""
    kind: Disturbance = "sinusoid"
    omega: RadiansPerSecond | None = None
    """None: the frequency that the chosen platoon amplifies most."""
    settings: dict[str, float] = field(default_factory=dict)
    """Per kind and name, what differs from the default."""
    panels: bool = False
    """Show the paper's four panels instead."""
    in_db: bool = False
    """Amplitudes in dB."""

    def set(self, **choices: Any) -> None:
        """Set one or several of the choices."""
        for name, value in choices.items():
            setattr(self, name, value)

    def reset(self) -> None:
        """Forget what was chosen among other vehicles."""
        self.vehicle, self.omega, self.own = 0, None, ""
