"""The one vocabulary of channels: how OpenACC names them, their unit and what is plausible."""

from dataclasses import dataclass


@dataclass(frozen=True)
class Channel:
    """A measured or derived quantity, as files, axes and sentences name it."""

    column: str
    """Stem of the column name in an OpenACC file; empty for derived quantities."""
    name: str
    symbol: str
    unit: str
    lowest: float
    """The least plausible value, in the unit above."""
    highest: float
    """The greatest plausible value."""

    def of(self, number: int) -> str:
        """The column of vehicle ``number``: Speed1, IVS4, Driver2."""
        return f"{self.column}{number}"

    @property
    def axis(self) -> str:
        """The label of an axis."""
        return f"{self.name} [{self.unit}]" if self.unit else self.name


TIME = Channel("Time", "Time", "t", "s", 0.0, 1e6)
SPEED = Channel("Speed", "Speed", "v", "m/s", 0.0, 70.0)
GAP = Channel("IVS", "Space-gap", "p", "m", 0.0, 500.0)
DRIVER = Channel("Driver", "Driver mode", "", "", 0.0, 1.0)
RELATIVE_SPEED = Channel("", "Relative speed", "Δv", "m/s", -30.0, 30.0)
ACCELERATION = Channel("", "Acceleration", "a", "m/s²", -10.0, 6.0)
TIME_GAP = Channel("", "Time gap", "p/v", "s", 0.0, 10.0)

METADATA = ("Date", "Vehicle_order", "Number_of_vehicles", "ACC", "Distance_setting")
"""First cells of the rows above the column names."""

MODE_NAMES = ("Human", "ACC")
"""What a Driver column may say."""

MAX_VEHICLES = 99
"""Higher vehicle numbers in a column name are not taken for a vehicle."""
