"""What the pages Stability and Platoon remember: whose laws, and which disturbance."""

from dataclasses import dataclass, field
from typing import Any, Literal

from accpinn.model.published import ASTAZERO
from accpinn.units import RadiansPerSecond

Source = Literal["fit", "published", "snapshot", "hand"]
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
    """What the table of rows began with when it came to the page."""


@dataclass(eq=False)
class MapChoice:
    """Which plane of parameters is drawn."""

    plane: Literal["beta", "alpha"] = "beta"
    held: int = -1
    """Index of the vehicle whose third parameter is kept; -1 is the last."""
    uncertainty: bool = True
    """Show what the data leave open."""


@dataclass(eq=False)
class PlatoonChoice:
    """Which platoon drives, and what its leader does."""

    order: Literal["learned", "repeated", "own"] = "learned"
    vehicle: int = 0
    """Index of the law that is repeated."""
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

    def change(self, **choices: Any) -> None:
        """Note what a widget was set to; without a frequency it is the platoon's peak again."""
        for name, value in choices.items():
            if value is not None or name == "omega":
                setattr(self, name, value)

    def forget(self) -> None:
        """Other vehicles are spoken of: what was chosen among the former ones means nothing."""
        self.vehicle, self.omega, self.own = 0, None, ""
