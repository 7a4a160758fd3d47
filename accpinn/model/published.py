"""Named followers with their parameters, and the sets that the paper prints.

Source: Apostolakis and Ampountolas, IEEE TVT 2024, Table III (Case II), Table II (Case I, one set
of parameters for all followers) and Table I (five trainings from different initial values).
"""

from dataclasses import dataclass

from accpinn.errors import ParameterError
from accpinn.model.cthp import Parameters
from accpinn.model.registry import PAPER


@dataclass(frozen=True)
class ParameterSet:
    """The parameters of M followers, in driving order, under their names."""

    title: str
    names: tuple[str, ...]
    """(M,) names without numbers, for places where other numbers stand beside them."""
    parameters: Parameters
    """(M,)"""
    vehicles: tuple[int, ...] = ()
    """(M+1,) numbers in the recording, leader first, which give the colours; by default 1, 2, .."""
    labels: tuple[str, ...] = ()
    """(M,) for legends and tables: number and name in the recording; by default the names."""
    by_hand: tuple[float, ...] = ()
    """(M,) the share of the time that a driver controls each, not ACC; empty where none does."""
    model: str = PAPER
    """Key of the model whose parameters they are."""

    def __post_init__(self) -> None:
        """Fill in the defaults; refuse an empty set and names that do not match."""
        if not len(self.parameters) or len(self.names) != len(self.parameters):
            raise ParameterError(
                f"{self.title}: {len(self.names)} names and {len(self.parameters)} sets of"
                " parameters; give at least one vehicle, and each of them a name and α, β, τ."
            )
        object.__setattr__(self, "vehicles", self.vehicles or (*range(1, len(self.names) + 2),))
        object.__setattr__(self, "labels", self.labels or self.names)

    def __len__(self) -> int:
        """The number of followers, M."""
        return len(self.parameters)

    @property
    def numbered(self) -> bool:
        """Whether the followers go by their numbers in a recording."""
        return self.labels != self.names

    @property
    def source(self) -> str:
        """The origin of the parameters, as messages name it."""
        return self.title

    def label(self, number: int) -> str:
        """The label of the vehicle with that number in the recording, or the number."""
        if number not in self.vehicles[1:]:
            return f"Vehicle {number}"
        return self.labels[self.vehicles.index(number) - 1]

    @property
    def spoken(self) -> tuple[str, ...]:
        """(M,) the labels within a sentence, where a number alone would count vehicles."""
        pairs = zip(self.labels, self.names, strict=True)
        return tuple(label if label == name else f"vehicle {label}" for label, name in pairs)


ASTAZERO = ParameterSet(
    "AstaZero (paper, Table III)",
    ("Audi A6", "BMW X5", "Mercedes A-Class", "Tesla Model 3"),
    Parameters(
        alpha=[0.0612, 0.1000, 0.0766, 0.0409],
        beta=[0.1200, 0.1470, 0.2220, 0.4450],
        tau=[1.19, 1.17, 1.16, 1.16],
    ),
)
VICOLUNGO = ParameterSet(
    "Ispra-Vicolungo (paper, Table III)",
    ("Ford S-Max", "Peugeot 5008", "Kia Niro"),
    Parameters(
        alpha=[0.0766, 0.1760, 0.0705], beta=[0.1660, 0.3921, 0.1930], tau=[1.01, 1.00, 1.13]
    ),
)
CASALE = ParameterSet(
    "Ispra-Casale #1 (paper, Table I)", ("Hyundai",), Parameters([0.0104], [0.0718], [1.52])
)
CASALE_STARTS = ParameterSet(
    "Ispra-Casale (paper, Table I)",
    ("#1", "#2", "#3", "#4", "#5"),
    Parameters(
        alpha=[0.0104, 0.0104, 0.0104, 0.0102, 0.0103],
        beta=[0.0718, 0.0712, 0.0723, 0.0709, 0.0724],
        tau=[1.52, 1.52, 1.52, 1.52, 1.52],
    ),
)
"""Five trainings of one follower, so this is no platoon to pick."""


def _alike(campaign: str, vehicles: ParameterSet, *shared: float) -> ParameterSet:
    """The same followers with one set of parameters for all, as in Case I."""
    parameters = Parameters.of([shared] * len(vehicles))
    return ParameterSet(f"{campaign}, Case I (paper, Table II)", vehicles.names, parameters)


ASTAZERO_ALIKE = _alike("AstaZero", ASTAZERO, 0.0627, 0.2630, 1.17)
VICOLUNGO_ALIKE = _alike("Ispra-Vicolungo", VICOLUNGO, 0.0581, 0.3010, 1.04)

PUBLISHED = (ASTAZERO, VICOLUNGO, CASALE, ASTAZERO_ALIKE, VICOLUNGO_ALIKE)
"""Every set that can be picked as an example."""
