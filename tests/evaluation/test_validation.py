"""Validation on another window: errors against known ones, and what speaks against them."""

from dataclasses import replace

import pytest

from accpinn.errors import SegmentError
from accpinn.evaluation.evaluation import OtherVehicles, ValidationOverlaps, validate
from accpinn.methods import least_squares
from accpinn.model.cthp import Parameters
from accpinn.recordings.openacc import read
from accpinn.results.tables.estimates import validation_table
from accpinn.segment.cut import cut
from tests.support.driving import LAW, MIXED, driven
from tests.support.samples import FOLDER, PLATOON


def test_the_truth_has_no_error_on_either_window_and_another_law_has_some() -> None:
    one = driven(MIXED)
    other = replace(driven(MIXED, duration=90.0), source="other")
    truth = replace(least_squares.fit(one), parameters=Parameters.of(MIXED))
    found = validate(truth, one, other)
    assert found.learned.gap_mae.max() < 0.01
    assert found.validated.gap_mae.max() < 0.01
    assert found.findings == found.events == ()
    wrong = replace(truth, parameters=Parameters.of([LAW] * 3))
    errors = validate(wrong, one, other).validated
    assert errors.gap_mae[0] < 0.01, "the first obeys that law"
    assert errors.gap_mae[1] > 1.0
    row = validation_table(one.info, other.info, found).rows[0]
    assert row[0] == "2 Car 2"
    assert row[-2] == pytest.approx(float(found.validated.gap_mae[0]))


def test_overlap_and_other_vehicles_are_findings_and_another_number_is_refused() -> None:
    recording = read(FOLDER / f"{PLATOON}.csv")
    segment = cut(recording, 0.0, 200.0, (1, 2, 3))
    fit = least_squares.fit(segment)
    assert validate(fit, segment, cut(recording, 200.0, 200.0, (1, 2, 3))).findings == ()
    overlapping = validate(fit, segment, cut(recording, 150.0, 100.0, (1, 2, 3)))
    assert overlapping.findings == (ValidationOverlaps(50.0),)
    others = validate(fit, segment, cut(recording, 200.0, 100.0, (3, 4, 5)))
    (found,) = others.findings
    assert isinstance(found, OtherVehicles)
    assert found.learned == segment.labels[1:]
    alike = [
        replace(s, names=("Car",) * 3) for s in (segment, cut(recording, 0.0, 90.0, (2, 3, 4)))
    ]
    assert OtherVehicles(alike[0].labels[1:], alike[1].labels[1:]) in validate(fit, *alike).findings
    with pytest.raises(SegmentError, match="choose as many"):
        validate(fit, segment, cut(recording, 200.0, 100.0, (1, 2)))
