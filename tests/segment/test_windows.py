"""The suggested window: invariants on made recordings, and what it chooses on real ones."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from accpinn.model.cthp import Parameters, simulate
from accpinn.recordings import Mode, Recording, Window
from accpinn.segment.cut import cut
from accpinn.segment.quality import label_regimes
from accpinn.segment.windows import GRID, Information, Suggestion, complete_windows, suggest_window
from tests.support.openacc_files import platoon, recording

STEP = 0.5
"""Between samples in s; a coarse one keeps the tests short."""


def driven(leader: np.ndarray, headway: float = 1.5) -> Recording:
    """A follower behind a leader with that speed (N,)."""
    time = STEP * np.arange(len(leader))
    start = leader[:1]
    motion = simulate(Parameters([0.1], [0.3], [headway]), time, leader, start, headway * start)
    frame = platoon(vehicles=2, samples=len(leader))
    frame["Time"] = time
    frame["Speed1"], frame["Speed2"] = motion.speeds.T
    frame["IVS1"] = motion.gaps[:, 0]
    return recording(frame, "AB")


def lively(samples: int, first: int, last: int) -> np.ndarray:
    """Even speed but for a swing between two samples."""
    leader = np.full(samples, 20.0)
    swing = np.arange(last - first)
    leader[first:last] += 2 * np.sin(0.15 * swing) + np.sin(0.37 * swing)
    return leader


def information(recording: Recording, vehicles: tuple[int, ...] = (1, 2)) -> Information:
    whole = cut(recording, 0.0, recording.duration, vehicles, allow_missing=True)
    return Information.of(whole, label_regimes(whole, recording))


def suggested(recording: Recording, duration: float = 60.0) -> Suggestion | None:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("accpinn.segment.windows.DURATION", duration)
        return suggest_window(recording, (1, 2), information(recording))


@settings(max_examples=15)
@given(first=st.integers(0, 400), seed=st.integers(0, 99), hole=st.integers(0, 560))
def test_the_suggested_window_is_complete_of_usual_length_and_where_vehicles_move(
    first: int, seed: int, hole: int
) -> None:
    leader = lively(600, first, first + 160)
    leader += 0.02 * np.random.default_rng(seed).standard_normal(600)
    plain = driven(leader)
    best = suggested(plain).window
    assert best.duration == 60.0
    assert best.start % GRID == 0
    info = information(plain)
    windows = [Window(float(start), start + 60.0) for start in range(0, 240, 5)]
    assert all(info.efficiency(window, best) <= 1 + 1e-9 for window in windows)
    assert best.start < STEP * (first + 160)
    assert best.end > STEP * first, "they touch"

    gap = plain.gap.copy()
    gap[hole : hole + 10] = np.nan
    holed = replace(plain, gap=gap)
    chosen = suggested(holed)
    stretches = complete_windows(holed, (1, 2))
    assert any(s.start <= chosen.window.start <= chosen.window.end <= s.end for s in stretches)


def test_the_efficiency_is_that_of_the_windows_own_regressors() -> None:
    """Against the definition; doubling a periodic window doubles what it tells."""
    recording = driven(20 + 2 * np.sin(2 * np.pi / 60 * STEP * np.arange(1200)))
    info = information(recording)
    window = Window(300.0, 360.0)
    segment = cut(recording, window.start, window.duration, (1, 2))
    p, v, dv = segment.gaps[:, 0], segment.speeds[:, 1], segment.speeds[:, 0] - segment.speeds[:, 1]
    x = np.column_stack([p, -v, dv])
    assert info.log_det(window) == pytest.approx(np.linalg.slogdet(x.T @ x)[1], rel=1e-6)
    assert info.efficiency(window, Window(300.0, 420.0)) == pytest.approx(0.5, abs=0.01)


def test_driving_by_hand_and_catching_up_are_avoided_however_lively_they_are() -> None:
    leader = lively(800, 0, 250) + lively(800, 500, 650) - 20.0
    recording = driven(leader)
    assert suggested(recording).window.end <= 130.0, "the livelier stretch"
    mode = np.full_like(recording.mode, Mode.ACC)
    mode[:300, 1] = Mode.HUMAN
    by_hand = suggested(replace(recording, mode=mode))
    assert by_hand.window.start >= 150.0
    assert by_hand.manual == 0.0
    gap = recording.gap.copy()
    gap[:300] += 40.0
    catching = suggested(replace(recording, gap=gap))
    assert catching.window.start >= 147.5
    assert catching.manual is None, "this file has no driver modes"


def test_without_a_long_stretch_the_longest_is_suggested_or_none() -> None:
    recording = driven(lively(300, 50, 250))
    short = suggested(recording, 300.0)
    assert short.shortened
    assert short.window == Window(0.0, 149.5)
    assert suggested(recording, 100.0).window.duration == 100.0
    assert suggested(replace(recording, gap=np.full_like(recording.gap, 150.0))) is None
    holes = recording.gap.copy()
    holes[::12] = holes[1::12] = holes[2::12] = holes[3::12] = np.nan
    assert suggested(replace(recording, gap=holes)) is None


def test_suggested_windows_of_real_recordings(astazero: Recording, casale: Recording) -> None:
    """The paper's AstaZero window is as good as the best; its Casale window catches up."""
    vehicles = (1, 2, 3, 4, 5)
    info = information(astazero, vehicles)
    best = suggest_window(astazero, vehicles, info)
    assert best.window == Window(330.0, 630.0)
    assert best.car_following == 1.0
    efficiency = info.efficiency(Window(320.0, 620.0), best.window)
    assert efficiency == pytest.approx(0.999, abs=0.001)
    best = suggested(casale, 300.0)
    assert best.window == Window(915.0, 1215.0)
    assert best.car_following == pytest.approx(0.96, abs=0.005)
    assert best.manual == 0.0
