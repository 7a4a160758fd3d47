"""Sentences about recordings and segments: each has the vehicle, the numbers and their units."""

from typing import get_args

import pytest

from accpinn.findings import Finding
from accpinn.recordings import recording as recordings
from accpinn.recordings.recording import RecordingFinding, Window
from accpinn.results.messages import message, messages
from accpinn.segment import quality
from accpinn.segment import segment as segments
from accpinn.segment.quality import QualityFinding
from accpinn.segment.segment import SegmentFinding

BLOCKS = (Window(1.0, 2.5), Window(4.0, 4.0))
FACTS = [
    (recordings.MetadataMissing("ACC"), ["ACC"]),
    (recordings.MetadataUnreadable("Date", "31, 2"), ["Date", "31, 2"]),
    (recordings.NamesWithoutData((2, 3)), ["2 Audi, 3 BMW"]),
    (recordings.VehiclesWithoutName((4, 5)), ["4, 5"]),
    (recordings.VehicleCountMismatch(6, 11, 7), ["6", "11", "7"]),
    (recordings.GapsUnused((1, 3)), ["IVS1, IVS3"]),
    (recordings.LineEndMissing(), ["last row"]),
    (recordings.ModesUnknown(2, 5, "Robot"), ["Driver2", "5", "Robot"]),
    (recordings.SamplesMissing("Speed", 2, 0.574, BLOCKS, 0), ["2 Audi", "57 %", "1–2.5 s, 4 s."]),
    (recordings.SamplesMissing("IVS", 2, 0.003, BLOCKS, 1), ["IVS2", "0.3 %", "1 shorter block."]),
    (recordings.SamplesMissing("IVS", 2, 0.5, BLOCKS, 4), ["both speeds", "4 shorter blocks."]),
    (recordings.GapContradictsSpeeds(2, 0.04), ["IVS2", "2 and 3", "0.04"]),
    (recordings.ValuesOutOfRange("IVS", 1, 3, -2.5), ["IVS1 is negative", "3", "-2.5 m"]),
    (recordings.ValuesOutOfRange("Speed", 1, 3, 90.0), ["Speed1", "70 m/s", "3", "90"]),
    (recordings.ValuesFrozen("IVS", 3, BLOCKS[0]), ["space-gap", "3 BMW", "1.5 s", "1–2.5 s"]),
    (recordings.LittleLeaderMotion(2, 0.021), ["2 Audi", "0.02 m/s"]),
    (recordings.MappingRemembered(), ["mapping", "earlier file"]),
    (segments.WindowMoved(5.04, 5.0), ["5 s", "5.04 s"]),
    (segments.WindowShortened(300.0, Window(20.0, 39.9)), ["39.9 s", "19.9 s", "300 s"]),
    (segments.Resampled(0.1), ["0.1 s"]),
    (segments.Bridged("Speed2", 16, BLOCKS), ["16 samples", "Speed2", "1–2.5 s, 4 s"]),
    (segments.Bridged("IVS1", 1, BLOCKS[1:]), ["1 sample of", "IVS1", "4 s"]),
    (segments.BlocksMissing(("Speed2",), 0.57, BLOCKS), ["Speed2 is", "57 %", "1–2.5 s, 4 s; the"]),
    (segments.BlocksMissing(("Speed2", "IVS1"), 0.004, 5 * BLOCKS),
     ["Speed2 and IVS1 are", "0.4 %", "1–2.5 s and in 7 shorter"]),
    (segments.DrivenByHand((3,), (0.5,)), ["not ACC parameters", "3 BMW (50 % of the time)"]),
    (segments.RegimesExcluded(("manual", "standstill"), (2, 3), (0.38, 0.0)),
     ["manual and standstill", "2 Audi: 38 %, 3 BMW: 0 %"]),
    (segments.NothingToExclude(("manual", "standstill")), ["manual or standstill"]),
    (quality.NearEquilibrium((2, 3), (0.05, 0.01), (450.0, float("inf"))),
     ["2 Audi (", "0.05 m/s", "450), 3 BMW", "inf)"]),
    (quality.LittleCarFollowing((2, 3), (0.34, 0.1)), ["50 %", "2 Audi (34 %), 3 BMW (10 %)"]),
    (quality.GapsNegative((2,), (3,)), ["2 Audi", "3"]),
]  # fmt: skip


class About:
    """Two named vehicles."""

    source = "run.csv"

    def label(self, number: int) -> str:
        return {2: "2 Audi", 3: "3 BMW"}[number]


@pytest.mark.parametrize(("finding", "facts"), FACTS)
def test_a_sentence_has_its_vehicles_and_figures(finding: Finding, facts: list[str]) -> None:
    [sentence] = messages([finding], About())
    assert sentence.endswith(".")
    assert [fact for fact in facts if fact not in sentence] == []


def test_every_finding_is_here_and_has_a_sentence() -> None:
    kinds = {*get_args(RecordingFinding), *get_args(SegmentFinding), *get_args(QualityFinding)}
    assert {type(finding) for finding, _ in FACTS} == kinds
    with pytest.raises(NotImplementedError, match="Finding"):
        message(Finding(), About())
