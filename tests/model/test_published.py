"""Named parameter sets: those of the paper, and a recording's own."""

import pytest

from accpinn.errors import ParameterError
from accpinn.model.cthp import Parameters
from accpinn.model.published import (
    ASTAZERO,
    CASALE,
    CASALE_STARTS,
    PUBLISHED,
    VICOLUNGO,
    ParameterSet,
)
from tests.stability.references import TABLE


def test_published_sets_are_those_of_the_paper() -> None:
    printed = [one for one in TABLE if "average" not in one.name]  # means are of no vehicle
    shared = [one.vehicle for one in printed if "Table II," in one.name]
    own = [one.vehicle for one in printed if "Table II," not in one.name]
    found = [dict.fromkeys(group.parameters) for group in PUBLISHED]
    alike = [group for group in PUBLISHED if "Case I " in group.title]
    assert [one for group in found for one in group] == own + shared
    assert [len({*group.parameters}) for group in alike] == [1, 1]
    assert [len(group) for group in alike] == [len(ASTAZERO), len(VICOLUNGO)]
    assert CASALE_STARTS.parameters[0] == CASALE.parameters[0]
    assert len({group.title for group in PUBLISHED}) == len(PUBLISHED)


def test_followers_go_by_a_recordings_numbers_or_their_names() -> None:
    assert ASTAZERO.labels == ASTAZERO.spoken == ASTAZERO.names
    assert ASTAZERO.vehicles == (1, 2, 3, 4, 5)
    assert not ASTAZERO.numbered
    ours = ParameterSet("run", ("X", "Y"), ASTAZERO.parameters[:2], (3, 4, 5), ("4 X", "5 Y"))
    assert ours.numbered
    assert ours.spoken == ("vehicle 4 X", "vehicle 5 Y")


@pytest.mark.parametrize(
    ("names", "parameters", "words"),
    [
        (("a", "b"), Parameters([0.1], [0.1], [1.0]), "2 names and 1 sets"),
        ((), Parameters([], [], []), "at least one vehicle"),
    ],
)
def test_names_and_parameters_must_match(
    names: tuple[str, ...], parameters: Parameters, words: str
) -> None:
    with pytest.raises(ParameterError, match=words):
        ParameterSet("Mine", names, parameters)
