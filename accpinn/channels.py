"""Symbols, units, digits and plausible ranges of all quantities; the vocabulary of the files."""

from collections.abc import Iterable
from dataclasses import dataclass
from math import inf
from typing import Any, TypeVar

T = TypeVar("T")


@dataclass(frozen=True)
class Quantity:
    """A recorded, learned or derived quantity, as files, axes, tables and sentences name it."""

    name: str
    symbol: str
    unit: str
    digits: int
    """Decimals that a value of it is worth in a table or a sentence."""
    lowest: float
    """The least plausible value, in the unit above."""
    highest: float
    """The greatest plausible value."""
    column: str = ""
    """Stem of the column name in an OpenACC file; empty where it is not recorded."""
    possible: float = inf
    """A recorded value that is larger, of either sign, is a fault of the file."""
    key: str = ""
    """A parameter's name in files and documents; empty for all else."""

    def of(self, number: int) -> str:
        """The column of vehicle ``number``: Speed1, IVS4, Driver2."""
        return f"{self.column}{number}"

    def text(self, value: float) -> str:
        """A value with its digits, without its unit: 1.520."""
        return f"{value:.{self.digits}f}"

    @property
    def axis(self) -> str:
        """The label of an axis: Time headway [s]."""
        return _with_unit(self.name, self.unit)

    @property
    def heading(self) -> str:
        """The heading of a column: τ [s]."""
        return _with_unit(self.symbol, self.unit)


def _with_unit(text: str, unit: str) -> str:
    return f"{text} [{unit}]" if unit else text


TIME = Quantity("Time", "t", "s", 1, 0.0, 1e6, "Time", 1e12)
SPEED = Quantity("Speed", "v", "m/s", 2, 0.0, 70.0, "Speed", 200.0)
GAP = Quantity("Space-gap", "p", "m", 2, 0.0, 500.0, "IVS", 10_000.0)
RELATIVE_SPEED = Quantity("Relative speed Δv", "Δv", "m/s", 2, -30.0, 30.0)
"""Speed of the vehicle ahead minus the follower's."""
TIME_GAP = Quantity("Time gap", "p/v", "s", 2, 0.0, 60.0)
DRIVER = Quantity("Driver mode", "", "", 0, 0.0, 1.0, "Driver")
RECORDED = {quantity.column: quantity for quantity in (TIME, SPEED, GAP, DRIVER)}
"""Recorded quantities by the stem of their columns."""

ALPHA = Quantity("Gain on spacing", "α", "1/s²", 4, 0.0, 10.0, key="alpha")
BETA = Quantity("Gain on relative speed", "β", "1/s", 4, 0.0, 10.0, key="beta")
TAU = Quantity("Time headway", "τ", "s", 3, 0.0, 5.0, key="tau")
"""The settings of cruise controls end near 3 s."""
PARAMETERS = (ALPHA, BETA, TAU)
"""Parameters in the order of the last axis of every array of them."""
PARAMETER_KEYS = tuple(parameter.key for parameter in PARAMETERS)
"""Names of the parameters in files and documents."""


def by_key(values: Iterable[T]) -> dict[str, T]:
    """Values of α, β and τ by their names in files and documents."""
    return dict(zip(PARAMETER_KEYS, values, strict=True))


COMPUTABLE = 1e50
"""Largest parameter; those below its inverse are taken as zero, so that products stay finite."""

FREQUENCY = Quantity("Frequency", "ω", "rad/s", 3, 0.0, 10.0)
MAGNITUDE = Quantity("Bode magnitude", "|H(jω)|", "dB", 2, -60.0, 60.0)
LINF_GAIN = Quantity("L∞ gain", "‖h‖₁", "", 3, 1.0, 10.0)
"""The gain is never below 1, as the impulse response has area 1 where α > 0."""

DISTURBANCE = Quantity("Disturbance", "r", "m/s²", 2, -5.0, 5.0)
"""Acceleration of a vehicle beyond that of the model's equation."""

METADATA = ("Date", "Vehicle_order", "Number_of_vehicles", "ACC", "Distance_setting")
"""First cells of the rows above the column names."""


MAX_VEHICLES = 99
"""Highest vehicle number in the name of a column."""


def fields(of: object, *names: str) -> dict[str, Any]:
    """The named attributes of an object as a dictionary, arrays as lists."""
    values = {name: getattr(of, name) for name in names}
    return {n: v.tolist() if hasattr(v, "tolist") else v for n, v in values.items()}
