"""What a user chose on the pages; a page switch or a reload loses none of it."""

from dataclasses import dataclass, field
from typing import Any, Literal

from accpinn.model.published import ASTAZERO
from accpinn.results.figures.recording import View
from accpinn.results.figures.stability import Plane
from accpinn.study.result import Result
from accpinn.units import RadiansPerSecond

Source = Literal["fit", "published", "snapshot", "hand"]
Disturbance = Literal["sinusoid", "step", "brake", "recorded"]
TypedRow = tuple[str, float | None, float | None, float | None]
"""Name, α, β, τ of a vehicle as typed in; None where a cell is empty."""


class Choices:
    """What was chosen for one purpose."""

    def set(self, **choices: Any) -> None:
        """Set one or several of them."""
        for name, value in choices.items():
            setattr(self, name, value)


@dataclass(eq=False)
class ParameterChoice(Choices):
    """Where α, β and τ come from."""

    source: Source = "fit"
    """As chosen last; see `Workspace.parameter_source`."""
    result: Result | None = None
    """The result when the source was chosen; a newer one is shown in place of the choice."""
    example: str = ASTAZERO.title
    snapshot: str = ""
    """Short name of the snapshot; empty: the newest."""
    rows: tuple[TypedRow, ...] = ()
    """By hand; a copy of what was shown before once that is chosen."""
    base: tuple[TypedRow, ...] = ()
    """The rows with which the table came to the page."""


@dataclass(eq=False)
class MapChoice(Choices):
    """Which plane of parameters is drawn."""

    plane: Plane = "beta"
    held: int = -1
    """Index of the vehicle whose third parameter is kept; -1 is the last."""
    uncertainty: bool = True
    """Show the uncertainty in charts."""
    simulated: int = -1
    """Index of the vehicle whose platoon is offered; -1 is the platoon in order."""
    measured: int = 0
    """Index of the follower whose measured gain is shown."""

    def reset(self) -> None:
        """Forget what was chosen among other vehicles."""
        self.held, self.simulated, self.measured = -1, -1, 0


@dataclass(eq=False)
class PlatoonChoice(Choices):
    """Which platoon is simulated, and its leader's disturbance."""

    order: Literal["learned", "repeated", "own"] = "learned"
    vehicle: int = 0
    """Index of the vehicle that is repeated."""
    followers: int | None = None
    """How often it is repeated; None: eight times, or as often as there are recorded followers."""
    own: str = ""
    """Own order, as typed in."""
    kind: Disturbance = "sinusoid"
    omega: RadiansPerSecond | None = None
    """None: the frequency that the chosen platoon amplifies most."""
    settings: dict[str, float] = field(default_factory=dict)
    """Per kind and name, what differs from the default."""
    whole: bool = False
    """Show the whole run in place of the part worth a closer look."""
    view: Literal["observer", "leader", "road"] = "observer"
    """Where the time-space diagram is seen from."""
    measured: bool = True
    """Show the recorded followers behind a recorded leader."""
    in_db: bool = False
    """Amplitudes in dB."""

    def reset(self) -> None:
        """Forget what was chosen among other vehicles."""
        self.vehicle, self.omega, self.own = 0, None, ""


@dataclass(eq=False)
class DataChoice(Choices):
    """What page Data draws of the recording."""

    view: View = "motion"
    highlight: int = 0
    """Number of the one follower that is not faint; 0 for all chosen."""
    validation: str = ""
    """SHA-256 of the recording from which a window for validation is chosen."""


@dataclass(eq=False)
class DatabaseChoice(Choices):
    """Which rows of which study page Database shows."""

    study: str = ""
    """Its name; empty for the one that was written to last."""
    filters: dict[str, tuple[str, ...]] = field(default_factory=dict)
    """By column, the values that are shown; all where there is none."""
    method: str = ""
    """Whose estimates; empty for maximum likelihood, or else the first."""
    by: str = "make"
    """What groups have in common."""
    in_units_of_tau: bool = False
    """Draw the plane of ατ² and βτ in place of α and β."""
    row: int | None = None
    """The place of the row that is chosen, among those shown."""
    form: dict[str, Any] = field(default_factory=dict)
    """What differs from the defaults of a new batch."""
