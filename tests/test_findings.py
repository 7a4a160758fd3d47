"""Every finding has a sentence that names its vehicle and leaves no brace of the template."""

import pytest
from msgspec.structs import asdict

from accpinn import platoon as simulation
from accpinn.evaluation import closed_loop, evaluation, whiteness
from accpinn.findings import Finding, joined, probability
from accpinn.inference import (
    answer,
    identifiability,
    intervals,
    model_adequacy,
    prediction,
)
from accpinn.methods import fit, maximum_likelihood
from accpinn.recordings import openacc
from accpinn.recordings import recording as recordings
from accpinn.recordings.recording import Window
from accpinn.segment import quality
from accpinn.segment import segment as segments
from accpinn.study import comparison, judge

BLOCKS = (Window(1.0, 2.5), Window(4.0, 4.0))
WIDE = intervals.ParameterInterval("α", 0.01, 0.2, 0.1, 0.05)
OPEN = intervals.ParameterInterval("τ", 0.5, None)
SAID = [
    (openacc.MetadataMissing("ACC"), ["ACC"]),
    (openacc.MetadataUnreadable("Date", "31, {2"), ["Date", "31, {2"]),
    (openacc.NamesWithoutData((2, 3)), ["2 Audi", "3 BMW"]),
    (openacc.VehiclesWithoutName((2, 3)), ["2 Audi", "3 BMW"]),
    (openacc.VehicleCountMismatch(6, 11, 7), ["6", "11", "7"]),
    (openacc.GapsUnused((1, 3)), ["IVS1", "IVS3"]),
    (openacc.LineEndMissing(), []),
    (openacc.ModesUnknown(2, 5, "Robot"), ["Driver2", "5", "Robot"]),
    (recordings.SamplesMissing("Speed", 2, 0.574, BLOCKS, 0), ["Speed2", "57 %", "1–2.5 s"]),
    (recordings.SamplesMissing("IVS", 2, 0.003, BLOCKS, 4), ["IVS2", "0.3 %", "4 shorter blocks"]),
    (recordings.GapContradictsSpeeds(2, 0.04), ["IVS2", "2 and 3", "0.04"]),
    (recordings.ValuesOutOfRange("IVS", 2, 3, -2.5), ["IVS2", "negative", "-2.5 m"]),
    (recordings.ValuesOutOfRange("Speed", 2, 3, 90.0), ["Speed2", "70 m/s", "3", "90"]),
    (recordings.ValuesFrozen("IVS", 3, BLOCKS[0]), ["space-gap", "1.5 s", "1–2.5 s"]),
    (recordings.LittleLeaderMotion(2, 0.021), ["0.02 m/s"]),
    (recordings.MappingRemembered(), []),
    (fit.Undetermined(2, "IDM", ("b", "v₀")), ["2 Audi", "b and v₀", "IDM"]),
    (judge.Describes(2, "IDM", "CTHP", 5, 1.5, 20.0, 4.0, True), ["2 Audi", "IDM", "CTHP", "20 %"]),
    (answer.Trust(2, 5, 4, 25.0, 1.9, 6.1, False), ["2 Audi", "4 of 5", "1.9 m", "6.1 m"]),
    (segments.WindowMoved(5.04, 5.0), ["5 s", "5.04 s"]),
    (segments.WindowShortened(300.0, Window(20.0, 39.9)), ["39.9 s", "19.9 s", "300 s"]),
    (segments.Resampled(0.1), ["0.1 s"]),
    (segments.Bridged("Speed2", 16, BLOCKS), ["16 samples", "Speed2", "1–2.5 s"]),
    (segments.Bridged("IVS1", 1, BLOCKS[1:]), ["1 sample of", "IVS1", "4 s"]),
    (segments.BlocksMissing(("Speed2", "IVS1"), 0.004, 5 * BLOCKS), ["Speed2 and IVS1", "0.4 %"]),
    (segments.DrivenByHand((3,), (0.5,)), ["3 BMW", "50 %"]),
    (segments.RegimesExcluded(("manual", "standstill"), (2, 3), (0.38, 0.0)),
     ["manual and standstill", "2 Audi: 38 %", "3 BMW: 0 %"]),
    (segments.NothingToExclude(("manual", "standstill")), ["manual or standstill"]),
    (quality.NearEquilibrium((2, 3), (0.05, 0.01), (450.0, float("inf"))), ["0.05 m/s", "450"]),
    (quality.LittleCarFollowing((2, 3), (0.34, 0.1)), ["2 Audi (34 %)", "3 BMW (10 %)"]),
    (quality.GapsNegative((2,), (3,)), ["2 Audi", "3"]),
    (fit.BoundActive(2, ("α", "ατ"), (0.1, 0.2, 0.3)), ["α and ατ", "2.000", "0.3000"]),
    (fit.BoundActiveAtTimes(2, "β", 0.35), ["β", "35 %"]),
    (fit.LongHeadway(2, 0.0012, 41.25), ["41.2 s", "0.0012 1/s²"]),
    (fit.WeaklyDetermined(None), ["All followers"]),
    (fit.FilterUncertain(2, "β", 0.1, 0.2), ["β = 0.1000", "0.2000"]),
    (fit.FilterDiverged(), ["run.csv"]),
    (fit.SimulatedSeparately(), []),
    (fit.SimulatedInStretches(10.0), ["10 s"]),
    (fit.HiddenLayersGain(1.0, 0.5), ["1.000", "0.5000", "-50.0 %"]),
    (fit.IterationsExhausted(3000), ["3,000"]),
    (fit.HoldoutLoss(12, 0.1, 0.2), ["12", "0.1000", "0.2000"]),
    (fit.Continued(1200), ["1,200"]),
    (fit.PaperEstimate("fast"), ["preset fast", "biased"]),
    (fit.ResidualEstimate("fast"), ["preset fast", "biased", "another model"]),
    (fit.CacheProblem("It is broken."), ["It is broken."]),
    (maximum_likelihood.DisturbanceSize(0, 0.25, 4.0, 1.0), ["All followers", "0.25 m/s²"]),
    (closed_loop.SimulatedCollision(2, 12.34, -0.01), ["12.3 s", "to 0.0 m"]),
    (closed_loop.SimulatedReversing(2, 5.0, 1.5), ["5.0 s", "1.5 m/s"]),
    (closed_loop.SimulatedDivergence(2, 5.0), ["5.0 s", "±1000 m"]),
    (evaluation.ValidationOverlaps(50.0), ["50 s"]),
    (evaluation.OtherVehicles(("2 Audi", "3 BMW"), ("2 Audi", "3 Tesla")), ["3 Tesla", "3 BMW"]),
    (whiteness.ShortResidual(2), []),
    (whiteness.WhiteResidual(2, 0.3), ["0.30 m/s²"]),
    (whiteness.WhiteResidual(2, 0.01), ["0.01 m/s²"]),
    (whiteness.CorrelatedResidual(2, 0.3, 8.0, 3000, 40.0), ["0.30 m/s²", "8 s", "3,000", "40"]),
    (answer.HeterogeneousWindows(2, 5, 0.012), ["5 windows", "p = 0.012"]),
    (intervals.NotDetermined(0), ["All followers"]),
    (intervals.OutsideInterval(2, (WIDE, OPEN), "disturbances"),
     ["α = 0.1000", "0.0100 to 0.2000", "0.0500", "τ = undetermined", "0.500 or more"]),
    (identifiability.WeakIdentification(2, (WIDE,), 0.05, 0.07, 400.0),
     ["α (0.0100 to 0.2000)", "0.05 m/s", "0.07 m/s", "400"]),
    (identifiability.WeakIdentification(0, (), 0.05), ["All followers", "0.05 m/s"]),
    (identifiability.NarrowerIntervals((2, 3), 300.0, 1523.0, is_excited=False),
     ["2 Audi and 3 BMW", "1,523 s", "300 s"]),
    (identifiability.NarrowerIntervals((2,), 300.0, None, is_excited=True), ["longer recording"]),
    (model_adequacy.BetterForm(vehicle=2, form="cthp-lag", aic=-20.0, holdout=1.0),
     ["-20", "+1.0"]),
    (model_adequacy.Inadequate(0, True, True, False, False), ["over time and larger"]),
    (comparison.TrainingSpread(5, 40.0, True, 2), ["5", "40 %", "2 of them"]),
    (comparison.TrainingSpread(4, 0.1, False, 0), ["4", "0.1 %"]),
    (comparison.SpreadUndetermined(0, "τ", 1, 3), ["All followers", "τ", "1 of 3"]),
    (prediction.BandCoverage(2, 0.9, 0.9, 0.61), ["90 %", "61 %"]),
    (prediction.BandCoverage(2, 0.5, 0.9, 0.0), ["50 %"]),
    (simulation.Collision(2, 33.94), ["33.9 s"]),
    (simulation.Reversal(3, 5.0), ["5.0 s"]),
    (simulation.NeverSettles(2), []),
    (simulation.TooShort(25.13, 67.0), ["25.1 s", "67 s"]),
    (simulation.TransientLeft(3, 767.0), ["0.1 %", "767 s"]),
]  # fmt: skip
BY_COLUMN = (
    recordings.GapContradictsSpeeds, openacc.ModesUnknown, recordings.SamplesMissing,
    recordings.ValuesOutOfRange,
)  # fmt: skip
"""Findings that name a column of the file in place of the vehicle."""
LABELS = {2: "2 Audi", 3: "3 BMW"}


class About:
    """Two named vehicles."""

    source = "run.csv"

    def label(self, number: int) -> str:
        return LABELS[number]


@pytest.mark.parametrize(("finding", "facts"), SAID)
def test_a_sentence_has_its_vehicle_and_figures(finding: Finding, facts: list[str]) -> None:
    sentence = finding.sentence(About())
    assert sentence.endswith(".")
    assert not {"{", "}"} & {*sentence.replace("31, {2", "")}
    assert "nan" not in sentence
    assert "None" not in sentence
    values = asdict(finding)
    number = values.get("vehicle", values.get("follower"))
    is_named = not isinstance(finding, BY_COLUMN)
    facts = [*facts, LABELS[number]] if number and is_named else facts
    assert [fact for fact in facts if fact not in sentence] == []


def test_every_finding_is_here() -> None:
    kinds = {kind for kind in Finding.__subclasses__() if kind.__module__.startswith("accpinn.")}
    told = {kind for kind in kinds if hasattr(kind, "text")}
    assert {type(finding) for finding, _ in SAID} == told


def test_lists_and_probabilities() -> None:
    assert [joined(["α", "β", "τ"][:count]) for count in range(4)] == ["", "α", "α and β",
                                                                      "α, β and τ"]  # fmt: skip
    assert [probability(share) for share in (0.0, 0.005, 0.5, 1.0)] == [
        "under 1 %", "under 1 %", "50 %", "over 99 %"
    ]  # fmt: skip
