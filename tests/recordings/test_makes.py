"""Names of vehicles in one spelling."""

import pytest

from accpinn.recordings.catalogue import is_known, make_and_model


@pytest.mark.parametrize(
    ("name", "expected"),
    [
        ("Audi(A8)", ("Audi", "A8")),
        ("AUDI_E_TRON", ("Audi", "e-tron")),
        ("Peugeot (5008 GT Line)", ("Peugeot", "5008 GT Line")),
        ("Mercedes(AClass)", ("Mercedes-Benz", "A-Class")),
        ("VW(GolfE)", ("Volkswagen", "e-Golf")),
        ("Rexton", ("SsangYong", "Rexton")),
        ("vw (Tiguan)", ("Volkswagen", "Tiguan")),
        ("TESLA_ROADSTER_2", ("Tesla", "ROADSTER_2")),
        ("Lada(Niva)", ("Lada", "Niva")),
        (" Unimog ", ("Unimog", "")),
        ("ID 27", ("ID 27", "")),
        ("", ("", "")),
    ],
)
def test_one_spelling(name: str, expected: tuple[str, str]) -> None:
    assert make_and_model(name) == expected
    assert is_known("tesla (model3)")
    assert not is_known("Lada(Niva)")
