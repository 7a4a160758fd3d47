"""Named sets of learned parameters, and those that the paper prints.

Source: Apostolakis and Ampountolas, IEEE TVT 2024, Table III (Case II) and Table I, experiment 1.
"""

from collections.abc import Sequence
from dataclasses import dataclass

from accpinn.errors import ParameterError
from accpinn.model.cthp import Parameters


@dataclass(frozen=True)
class ParameterSet:
    """The laws of some followers, in driving order, under their names."""

    title: str
    labels: tuple[str, ...]
    parameters: Parameters
    numbers: tuple[int, ...]
    """Each follower's number in its recording, which gives it its colour."""
    leader: int = 1
    """The leader's number."""

    def __len__(self) -> int:
        """How many followers."""
        return len(self.parameters)

    @property
    def numbered(self) -> bool:
        """Whether the followers go by their numbers in a recording."""
        return any(label != name for label, name in zip(self.labels, self.names, strict=True))

    @property
    def names(self) -> tuple[str, ...]:
        """The labels without the numbers, for where other numbers stand beside them."""
        return tuple(
            label.removeprefix(f"{number} ")
            for number, label in zip(self.numbers, self.labels, strict=True)
        )

    @property
    def spoken(self) -> tuple[str, ...]:
        """The labels as a sentence names them: a number alone would count vehicles."""
        return tuple(
            label if label == name else f"vehicle {label}"
            for label, name in zip(self.labels, self.names, strict=True)
        )


def parameter_set(title: str, labels: Sequence[str], parameters: Parameters) -> ParameterSet:
    """Followers numbered 2, 3, .. behind a leader.

    Raises:
        ParameterError: when there is none, or names and parameters do not match.
    """
    if not len(parameters) or len(labels) != len(parameters):
        raise ParameterError(
            f"{title}: {len(labels)} names and {len(parameters)} sets of parameters; give at least"
            " one vehicle, and each of them a name and α, β, τ."
        )
    numbers = tuple(range(2, len(parameters) + 2))
    return ParameterSet(title, tuple(labels), parameters, numbers)


ASTAZERO = parameter_set(
    "AstaZero (paper, Table III)",
    ("Audi A6", "BMW X5", "Mercedes A-Class", "Tesla Model 3"),
    Parameters.of(
        [
            [0.0612, 0.1200, 1.19],
            [0.1000, 0.1470, 1.17],
            [0.0766, 0.2220, 1.16],
            [0.0409, 0.4450, 1.16],
        ]
    ),
)
VICOLUNGO = parameter_set(
    "Ispra-Vicolungo (paper, Table III)",
    ("Ford S-Max", "Peugeot 5008", "Kia Niro"),
    Parameters.of(
        [
            [0.0766, 0.1660, 1.01],
            [0.1760, 0.3921, 1.00],
            [0.0705, 0.1930, 1.13],
        ]
    ),
)
CASALE = parameter_set(
    "Ispra-Casale #1 (paper, Table I)", ("Hyundai",), Parameters([0.0104], [0.0718], [1.52])
)

PUBLISHED = (ASTAZERO, VICOLUNGO, CASALE)
"""Every set that can be picked as an example."""
