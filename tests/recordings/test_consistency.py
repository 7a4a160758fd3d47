"""Consistency of gaps and speeds: each fault is found by its cause, and sound data pass."""

from collections.abc import Callable, Sequence
from functools import cache
from pathlib import Path
from time import process_time
from typing import Any, TypeVar

import msgspec
import numpy as np
import pytest

from accpinn.recordings import Recording
from accpinn.recordings.consistency import inconsistencies
from accpinn.recordings.cures import Exchange, ReadAs, ReadSpeedAs, Reverse, Shift, units_for
from accpinn.recordings.files import read
from accpinn.recordings.inconsistency import (
    ClocksDiffer,
    GapComputed,
    GapContradictsSpeeds,
    GapJumps,
    Inconsistency,
    SignReversed,
    SpeedsApart,
    UnitsDiffer,
)
from accpinn.recordings.increments import Pair, agreement
from accpinn.segment import SegmentFinding
from accpinn.segment.cut import cut
from accpinn.segment.quality import Grade, assess_quality, rate
from accpinn.segment.windows import car_following, complete_windows, plan
from tests.support.openacc_files import platoon, recording
from tests.support.pairs import DRIVES, RATES, SENSORS, Drive, drives, recorded
from tests.support.samples import FOLDER

KINDS = [kind for _ in range(9) for kind in DRIVES]
"""Three kinds of drives for each rate and each kind of sensors."""
SETTINGS = [(rate, sensor) for rate in RATES for sensor in SENSORS for _ in DRIVES]
MOVING = [k for k, kind in enumerate(KINDS) if kind != "steady"]
"""Pairs that move against each other as usual."""
EVERY = range(0, len(KINDS), 4)
"""Every fourth pair, with all kinds of drives and sensors among them."""
SOME = MOVING[::3] + MOVING[1::3]
F = TypeVar("F", bound=Inconsistency)


@cache
def driven() -> list[Drive]:
    return drives(KINDS, 310.0, np.random.default_rng(7))


def sensed(k: int, late: Sequence[float] = (0, 0, 0)) -> Pair:
    return recorded(driven()[k], *SETTINGS[k], np.random.default_rng(100 + k), late)


def altered(pair: Pair, **channels: Any) -> Pair:
    old = {name: getattr(pair, name) for name in ("time", "ahead", "behind", "gap")}
    return Pair(pair.vehicle, **{**old, **channels})


def scaled(pair: Pair, speed: float = 1.0, gap: float = 1.0, clock: float = 1.0) -> Pair:
    return Pair(1, clock * pair.time, speed * pair.ahead, speed * pair.behind, gap * pair.gap)


def only(kind: type[F], pair: Pair) -> F:
    """The one finding about a pair, of that kind."""
    (finding,) = inconsistencies(pair)
    assert isinstance(finding, kind)
    return finding


class Cast:
    """Two vehicles to make sentences of."""

    source = "run.csv"

    def label(self, number: int) -> str:
        return f"{number} A car with a long name (and a model)"


# No false alarm


@pytest.mark.parametrize("seed", range(3))
def test_nothing_is_found_in_sound_drives(seed: int) -> None:
    """Steady, motorway and urban drives at 2, 10 and 25 Hz, by three kinds of sensors."""
    rng = np.random.default_rng(1000 + seed)
    for drive, (hertz, sensor) in zip(drives(KINDS, 250.0, rng), SETTINGS, strict=True):
        pair = recorded(drive, hertz, sensor, rng)
        assert list(inconsistencies(pair)) == [], (hertz, sensor)


@pytest.mark.parametrize("hole", [0.5, 3.0, 20.0])
def test_missing_and_frozen_samples_are_no_fault(hole: float) -> None:
    for k in MOVING[::3]:
        pair = sensed(k)
        for name in ("gap", "ahead", "behind"):
            values = getattr(pair, name).copy()
            for start in (60.0, 140.0):
                values[(pair.time > start) & (pair.time < start + hole)] = np.nan
            assert list(inconsistencies(altered(pair, **{name: values}))) == []
        frozen = pair.gap.copy()
        inside = np.flatnonzero((pair.time >= 100.0) & (pair.time < 100.0 + min(hole, 3.0)))
        frozen[inside] = frozen[inside[0]]
        assert list(inconsistencies(altered(pair, gap=frozen))) == []


def test_an_exact_simulation_is_not_taken_for_a_running_sum() -> None:
    for drive in driven():
        pair = Pair(1, drive.time[::2], drive.ahead[::2], drive.behind[::2], drive.gap[::2])
        assert list(inconsistencies(pair)) == []
    assert recording().findings == ()


def test_little_data_and_vehicles_at_rest_are_not_judged() -> None:
    pair = sensed(1)
    some = Pair(1, *(values[:20] for values in (pair.time, pair.ahead, pair.behind, pair.gap)))
    still = altered(pair, behind=pair.ahead + 0.05, gap=0 * pair.gap + 5.0)
    nothing = altered(pair, gap=np.full_like(pair.gap, np.nan))
    for quiet in (some, still, nothing):
        assert agreement(quiet) is None
        assert list(inconsistencies(quiet)) == []


@pytest.mark.parametrize("path", sorted(FOLDER.glob("*.csv")), ids=lambda p: p.stem)
def test_sample_recordings_have_no_inconsistencies(path: Path) -> None:
    assert not [f for f in read(path).findings if isinstance(f, Inconsistency)]


# Power


def share(places: Sequence[int], holds: Callable[[int], bool]) -> float:
    return float(np.mean([holds(k) for k in places]))


def test_units_are_named() -> None:
    """The units in which columns were really written are among the cures."""

    def named(k: int, cure: ReadAs, **factors: float) -> bool:
        findings = list(inconsistencies(scaled(sensed(k), **factors)))
        return bool(findings) and isinstance(findings[0], UnitsDiffer) and cure in findings[0].cures

    cases = [
        (ReadAs(speed="km/h"), {"speed": 3.6}),
        (ReadAs(speed="mph"), {"speed": 1 / 0.44704}),
        (ReadAs(gap="ft"), {"gap": 1 / 0.3048}),
        (ReadAs(speed="mph", gap="ft"), {"speed": 1 / 0.44704, "gap": 1 / 0.3048}),
    ]
    for cure, factors in cases:
        assert share(EVERY, lambda k: named(k, cure, **factors)) > 0.95, cure  # noqa: B023
    assert share(MOVING, lambda k: named(k, ReadAs(time="ms"), clock=1000.0)) > 0.5

    def misread(k: int) -> bool:
        findings = list(inconsistencies(scaled(sensed(k), speed=0.44704 * 3.6)))
        return any(
            isinstance(f, UnitsDiffer) and ("speed", "mph", "km/h") in f.misread for f in findings
        )

    assert share(EVERY, misread) > 0.9


def test_units_depend_on_how_the_columns_were_read() -> None:
    assert ReadAs(speed="km/h") in units_for(1 / 3.6)
    assert units_for(1.0) == (ReadAs(),)
    as_mph = ReadAs(speed="mph")
    assert units_for(0.6214, taken=as_mph)[0] == ReadAs(speed="km/h")
    assert all(units.changes(as_mph) for units in units_for(0.6214, taken=as_mph))
    assert units_for(60.0) == (ReadAs(time="min"),)


def test_sound_data_have_a_slope_of_one() -> None:
    """Noise of the speeds does not attenuate the slope: a scale of 0.7 is recovered."""
    for k in MOVING:
        finding = only(UnitsDiffer, scaled(sensed(k), gap=0.7))
        assert finding.slope == pytest.approx(0.7, abs=max(0.03, 3 * finding.error))


def test_exchanged_speeds_and_a_reversed_gap() -> None:
    def cured(k: int, cure: Exchange | Reverse) -> bool:
        pair = sensed(k)
        exchanged = altered(pair, ahead=pair.behind, behind=pair.ahead)
        wrong = exchanged if isinstance(cure, Exchange) else scaled(pair, gap=-1.0)
        findings = list(inconsistencies(wrong))
        return (
            len(findings) == 1
            and isinstance(findings[0], SignReversed)
            and findings[0].cures == (cure,)
        )

    for cure in (Exchange(1), Reverse(1)):
        assert share(EVERY, lambda k: cured(k, cure)) > 0.95  # noqa: B023


@pytest.mark.parametrize(("lag", "least"), [(0.5, 0.5), (-1.0, 0.75), (3.0, 0.85)])
def test_clocks_that_differ(lag: float, least: float) -> None:
    """The channel is named, or among those that would do."""
    stem = {0: ("Speed", 1), 1: ("Speed", 2), 2: ("IVS", 1)}

    def is_named(k: int, late: int) -> bool:
        lags = [0.0, 0.0, 0.0]
        lags[late] = lag
        clocks = [f for f in inconsistencies(sensed(k, lags)) if isinstance(f, ClocksDiffer)]
        return any(
            (shift.channel, shift.vehicle) == stem[late]
            and abs(shift.seconds + lag) < max(0.2, 0.1 * abs(lag))
            for finding in clocks
            for shift in finding.cures
            if isinstance(shift, Shift)
        )

    shares = [share(SOME, lambda k: is_named(k, late)) for late in range(3)]  # noqa: B023
    assert np.mean(shares) > least
    assert min(shares) > 0.3


def test_the_late_clock_is_named_where_the_data_determine_it() -> None:
    urban = KINDS.index("urban")
    finding = only(ClocksDiffer, sensed(urban, (1.0, 0, 0)))
    assert finding.is_determined
    assert finding.cures == (Shift("Speed", 1, pytest.approx(-1.0, abs=0.1)),)
    assert finding.seconds == pytest.approx(1.0, abs=0.1)
    assert finding.error < 0.1


def jumping(pair: Pair, at: float, size: float, lasting: float) -> Pair:
    share_of = np.clip((pair.time - at) / max(lasting, 1e-3), 0, 1)
    return altered(pair, gap=pair.gap + size * share_of)


def test_jumps_are_found_with_time_and_size() -> None:
    rng = np.random.default_rng(5)
    for k in EVERY:
        at, lasting = rng.uniform(50, 250), rng.uniform(0, 1)
        size = rng.uniform(10, 25) * rng.choice([-1, 1])
        finding = only(GapJumps, jumping(sensed(k), at, size, lasting))
        assert finding.times == (pytest.approx(at + lasting / 2, abs=1.1),)
        assert finding.sizes == (pytest.approx(size, abs=2.5),)


def test_a_jump_across_a_hole_of_the_gap() -> None:
    pair = jumping(sensed(1), 100.0, -15.0, 0.0)
    gap = np.where((pair.time > 99.0) & (pair.time < 102.0), np.nan, pair.gap)
    finding = only(GapJumps, altered(pair, gap=gap))
    assert finding.sizes == (pytest.approx(-15.0, abs=2.5),)
    assert finding.times == (pytest.approx(102.0, abs=0.15),)


def test_a_running_sum_of_recorded_speeds() -> None:
    for k in MOVING:
        pair = sensed(k)
        if SETTINGS[k][0] >= 10.0 and SETTINGS[k][1] == "radar":
            difference = pair.ahead - pair.behind
            summed = np.r_[0.0, np.cumsum(difference[1:] * np.diff(pair.time))]
            finding = only(GapComputed, altered(pair, gap=30 + summed))
            assert not finding.is_contradiction


def test_one_speed_in_another_unit_than_the_other() -> None:
    for k in EVERY:
        pair = sensed(k)
        ahead = only(SpeedsApart, altered(pair, ahead=3.6 * pair.ahead))
        assert ahead.cures[0] == ReadSpeedAs(1, "km/h")
        behind = only(SpeedsApart, altered(pair, behind=pair.behind / 0.44704))
        assert behind.cures[0] == ReadSpeedAs(2, "mph")
        foreign = only(SpeedsApart, altered(pair, behind=pair.behind / 3.6 / 0.44704))
        assert ReadSpeedAs(2, "mph") in foreign.units(("km/h", "km/h"))
        assert only(SpeedsApart, altered(pair, ahead=pair.ahead + 3.0)).offset > 2.5


def test_one_column_for_two_speeds_or_a_position_for_the_gap() -> None:
    for k in MOVING:
        pair = sensed(k)
        assert any(inconsistencies(altered(pair, ahead=pair.behind)))
        assert any(inconsistencies(altered(pair, gap=np.cumsum(pair.ahead) / 10.0)))


def test_a_gap_that_has_nothing_to_do_with_the_speeds() -> None:
    pair, rng = sensed(1), np.random.default_rng(2)
    wandering = 30 + np.cumsum(rng.normal(0, 0.1, len(pair.gap)))
    assert only(GapContradictsSpeeds, altered(pair, gap=wandering)).cures == ()


# Sums, sentences, snapshots


def coarse_sum() -> Pair:
    """Whole km/h every 0.2 s, and their difference summed, as onboard diagnosis gives them."""
    drive = driven()[KINDS.index("urban")]
    time = drive.time[::4][:300]
    ahead, behind = (np.round(3.6 * values[::4][:300]) for values in (drive.ahead, drive.behind))
    gap = 60 + np.cumsum((ahead - behind) / 3.6 * 0.2)
    return Pair(1, time, ahead * 0.44704, behind * 0.44704, gap)


def test_whole_kmh_read_as_mph_with_a_gap_that_was_summed() -> None:
    units, computed = inconsistencies(coarse_sum())
    assert isinstance(units, UnitsDiffer)
    assert units.slope == pytest.approx(0.621, abs=0.02)
    assert units.misread[0] == ("speed", "mph", "km/h")
    assert isinstance(computed, GapComputed)


def test_sentences_are_short() -> None:
    pair = sensed(MOVING[0])
    many = GapJumps(1, tuple(np.arange(40.0) + 1000), (-12.3,) * 40)
    clocks = ClocksDiffer(
        1, (Shift("Speed", 1, -1.25), Shift("Speed", 2, 1.25), Shift("IVS", 1, -1.25)), 0.123
    )
    findings = [
        *inconsistencies(scaled(pair, 3.6, -1.0)),
        *inconsistencies(coarse_sum()),
        many,
        clocks,
        SpeedsApart(1, -40.0, (0.62, 1.609)),
    ]
    assert len(findings) == 7
    for finding in findings:
        assert len(finding.sentence(Cast())) <= 300


def test_findings_of_a_segment_survive_a_snapshot() -> None:
    findings = [
        SignReversed(1, -0.9, True),
        UnitsDiffer(1, 0.3, 0.01),
        SpeedsApart(1, 40.0, (0.28, 3.6)),
        ClocksDiffer(1, (Shift("IVS", 1, -0.8),), 0.02),
        GapJumps(1, (10.0,), (-12.0,)),
        GapComputed(1, 0.99),
    ]
    coded = msgspec.json.encode(findings)
    assert msgspec.json.decode(coded, type=list[SegmentFinding]) == findings


# Windows


def with_jump(at: float = 20.0, size: float = -12.0) -> Recording:
    frame = platoon(3, 600)
    frame.loc[round(10 * at) :, "IVS2"] += size
    return recording(frame)


def test_windows_end_at_a_jump_of_a_chosen_follower() -> None:
    run = with_jump()
    (jumps,) = run.jumps
    assert (jumps.vehicle, jumps.times, jumps.sizes) == (2, (20.0,), pytest.approx([-12.0], abs=1))
    before, after = complete_windows(run, (1, 2, 3))
    assert (before.start, after.end) == (0.0, run.duration)
    assert before.end < 20.0 <= after.start
    assert after.start - before.end < 2.5
    (whole,) = complete_windows(run, (1, 2))
    assert whole.duration == run.duration, "the other follower's gap does not jump"
    for place in plan(run, 300.0):
        if 3 in place.vehicles:
            assert place.window.end < 20.0 or place.window.start >= 20.0


def test_a_window_across_a_jump_carries_the_finding() -> None:
    run = with_jump(40.0)

    def jumps(start: float, duration: float, vehicles: tuple[int, ...]) -> list[object]:
        segment = cut(run, start, duration, vehicles)
        return [finding for finding in segment.findings if isinstance(finding, GapJumps)]

    assert jumps(10.0, 45.0, (2, 3)) == list(run.jumps)
    assert jumps(0.0, 35.0, (2, 3)) == jumps(41.0, 15.0, (2, 3)) == jumps(10.0, 45.0, (1, 2)) == []
    segment = cut(run, 10.0, 45.0, (2, 3))
    ratings = {r.question: r for r in rate(segment, run, assess_quality(segment))}
    assert ratings["consistent"].grade is Grade.POOR
    assert car_following(recording(platoon(3, 700)), (2, 3))[0].duration > 60.0


def test_a_computed_gap_is_reported_but_may_be_used() -> None:
    frame, rng = platoon(2, 900), np.random.default_rng(3)
    frame[["Speed1", "Speed2"]] += rng.normal(0, 0.05, (900, 2))
    difference = (frame["Speed1"] - frame["Speed2"]).to_numpy()
    frame["IVS1"] = 30 + 0.1 * np.cumsum(difference)
    run = recording(frame, "AB")
    segment = cut(run, 0.0, 60.0, (1, 2))
    assert any(isinstance(finding, GapComputed) for finding in segment.findings)
    ratings = {r.question: r for r in rate(segment, run, assess_quality(segment))}
    assert ratings["consistent"].grade is Grade.FAIR
    assert plan(run, 300.0)


def test_checks_are_quick() -> None:
    """20 minutes of five cars at 10 Hz take 50 ms; four times that on a busy machine."""
    rng = np.random.default_rng(4)
    pairs = [recorded(drive, 10.0, "radar", rng) for drive in drives(["motorway"] * 4, 1210.0, rng)]
    taken = []
    for _ in range(2):
        fresh = [altered(pair) for pair in pairs]
        started = process_time()
        for pair in fresh:
            assert list(inconsistencies(pair)) == []
        taken.append(process_time() - started)
    assert min(taken) < 0.2
