"""Hold-out blocks, whose measurements do not reach their parameters; validation elsewhere."""

from dataclasses import replace
from functools import partial

import numpy as np
import pytest

from accpinn.errors import SegmentError
from accpinn.evaluation import (
    OtherVehicles,
    ValidationOverlaps,
    cross_validate,
    evaluate,
    from_following,
    of_blocks,
    validation_findings,
    without,
)
from accpinn.evaluation.closed_loop import ClosedLoop, TrackingErrors
from accpinn.methods import Segments, least_squares
from accpinn.methods.estimate import Estimate
from accpinn.methods.registry import METHODS
from accpinn.model.spec import ModelSpec
from accpinn.recordings import Recording, Window
from accpinn.recordings.openacc import read
from accpinn.segment.cut import cut
from tests.support.driving import LAW, MIXED, driven
from tests.support.methods import RIVALS
from tests.support.samples import FOLDER, PLATOON


def test_each_block_is_simulated_with_parameters_from_the_others() -> None:
    """Truth but for the last third: only parameters fitted elsewhere can be right there."""
    fitted_to: list[Segments] = []

    def estimate(segments: Segments) -> Estimate:
        fitted_to.append(segments)
        return least_squares.METHOD.fit(segments)

    segment = cut(read(FOLDER / "synthetic_paper_study_noise_free.csv"), 0.0, 90.0)
    blocks = cross_validate([segment], estimate)
    near = partial(pytest.approx, abs=0.2)
    assert [block.window.start for block in blocks] == near([0.0, 30.0, 60.0])
    assert [piece.start for (piece,) in fitted_to] == near([30.0, 0.0, 0.0])
    assert [piece.window.duration for (piece,) in fitted_to] == near([60.0, 90.0, 60.0])
    for block in blocks:
        assert block.errors.gap_mae[0] < 0.02
        assert block.findings == ()
    later = replace(segment, gaps=np.where(segment.time[:, None] > 62, 5.0, segment.gaps))
    spoilt = cross_validate([later], least_squares.METHOD.fit)[2].errors
    assert spoilt.gap_mae[0] > 1.0


@pytest.mark.parametrize("count", [2, 5])
def test_of_several_windows_each_is_simulated_with_parameters_from_others(count: int) -> None:
    """The last one has another law, of which only itself knows."""
    laws = [(LAW, MIXED[1])] * (count - 1) + [(MIXED[2], MIXED[0])]
    windows = [
        replace(driven(pair, duration=40.0 + k), start=100.0 * k) for k, pair in enumerate(laws)
    ]
    fitted: list[list[float]] = []

    def estimate(segments: Segments) -> Estimate:
        fitted.append([segment.start for segment in segments])
        return least_squares.METHOD.fit(segments)

    parts = cross_validate(windows, estimate)
    left_out = {2: [[0.0], [100.0]], 5: [[0.0, 300.0], [100.0, 400.0], [200.0]]}[count]
    starts = [window.start for window in windows]
    assert fitted == [[start for start in starts if start not in out] for out in left_out]
    assert [part.window.start for part in parts] == [start for out in left_out for start in out]
    durations = [window.window.duration for window in windows]
    assert sorted(part.window.duration for part in parts) == durations
    errors = {part.window.start: part.errors.gap_mae.max() for part in parts}
    assert errors[starts[-1]] > 1.0
    excluded = next(out for out in left_out if starts[-1] in out)
    assert all(errors[start] < 0.02 for start in excluded if start != starts[-1])
    mean = np.average(
        [part.errors.gap_mae for part in parts],
        axis=0,
        weights=[part.window.duration for part in parts],
    )
    np.testing.assert_allclose(of_blocks(parts).gap_mae, mean)


def test_too_few_windows_for_a_method_are_no_error() -> None:
    """Each window alone is too short for the likelihood, both together are not."""
    windows = driven(duration=15.0), driven(duration=30.0)
    parts = cross_validate(windows, METHODS["pinn"].fit)
    assert [part.errors is None for part in parts] == [False, True]


def test_the_middle_third_leaves_no_trace_in_its_bridge() -> None:
    segment = driven(MIXED[:2], noise=0.05)
    spoilt = np.where(np.abs(segment.time[:, None] - 30.0) < 9.9, 77.0, segment.gaps)
    counted = np.ones(segment.gaps.shape, dtype=bool)
    counted[200:400] = False
    without_middle = without(segment, 200, 400)
    assert (
        without_middle.info.digest == without(replace(segment, gaps=spoilt), 200, 400).info.digest
    )
    np.testing.assert_array_equal(without_middle.gaps[counted], segment.gaps[counted])
    estimate, masked = (
        RIVALS["splines"](part, "II").parameters.values
        for part in (without_middle, replace(segment, mask=counted))
    )
    np.testing.assert_allclose(estimate, masked, rtol=0.02)
    # The bridge is continuous and obeys dp/dt = Δv.
    without_middle = without(driven(MIXED), 200, 400)
    relative = without_middle.speeds[:, :-1] - without_middle.speeds[:, 1:]
    trapezoid = (relative[1:] + relative[:-1]) * segment.sample_time / 2
    np.testing.assert_allclose(np.diff(without_middle.gaps, axis=0), trapezoid, atol=2e-3)
    assert np.abs(np.diff(without_middle.speeds, axis=0)).max() < 0.5


def test_too_little_for_a_method_is_no_error() -> None:
    blocks = cross_validate([driven(duration=12.0)], RIVALS["simulation"])
    assert blocks[1].errors is None, "no stretch of 5 s is left beside the middle"
    assert of_blocks(blocks) is None


def test_blocks_are_pooled_by_duration() -> None:
    low, high = (TrackingErrors(*(np.full(n, x) for n in (2, 1))) for x in (1.0, 3.0))
    first = ClosedLoop(Window(0.0, 10.0), low)
    pooled_errors = of_blocks((first, ClosedLoop(Window(20.0, 50.0), high)))
    assert pooled_errors.gap_mae[0] == pytest.approx(2.5)
    assert of_blocks((first, ClosedLoop(Window(20.0, 50.0), None))) is None


def test_a_stretch_begins_where_every_follower_is_in_car_following() -> None:
    segment = cut(read(FOLDER / "synthetic_paper_study.csv"), 20.0, 60.0)
    speeds, gaps = segment.speeds.copy(), segment.gaps.copy()
    speeds[:100], gaps[:100] = 0.0, 1.0  # a queue
    gaps[100:120] = 4.0 * speeds[100:120, 1:]
    piece = from_following(replace(segment, speeds=speeds, gaps=gaps))
    assert piece.start == pytest.approx(segment.start + segment.time[120])
    np.testing.assert_array_equal(piece.gaps, gaps[120:])
    assert from_following(segment).samples == segment.samples
    never = replace(segment, gaps=4.0 * segment.speeds[:, 1:])
    assert from_following(never) is never


def test_the_idm_starts_outside_its_window_from_no_queue(astazero: Recording) -> None:
    segment = cut(astazero, 320.0, 100.0, (1, 2))
    fit = METHODS["simulation"].fit(segment, spec=ModelSpec("idm"))
    evaluation = evaluate(segment, fit, recording=astazero)
    assert not [event for event in evaluation.out_of_window_findings if event.time < 320.0]
    assert evaluation.out_of_window_seconds > 800.0


def test_overlap_and_other_vehicles_are_findings_and_another_number_is_refused() -> None:
    recording = read(FOLDER / f"{PLATOON}.csv")
    segment = cut(recording, 0.0, 200.0, (1, 2, 3))
    fit = least_squares.METHOD.fit(segment)
    assert validation_findings([segment], cut(recording, 200.0, 200.0, (1, 2, 3))) == ()
    overlapping = cut(recording, 150.0, 100.0, (1, 2, 3))
    assert validation_findings([segment], overlapping) == (ValidationOverlaps(50.0),)
    elsewhere = replace(overlapping, source="another run")
    assert validation_findings([segment], elsewhere) == ()
    halves = [cut(recording, start, 100.0, (1, 2, 3)) for start in (0.0, 250.0)]
    overlapping = cut(recording, 50.0, 250.0, (1, 2, 3))
    assert validation_findings(halves, overlapping) == (ValidationOverlaps(100.0),)
    together = evaluate(halves, fit).closed_loop
    alone = [evaluate(half, fit).closed_loop.gap_mae for half in halves]
    np.testing.assert_allclose(together.gap_mae, np.mean(alone, axis=0))
    (finding,) = validation_findings([segment], cut(recording, 200.0, 100.0, (3, 4, 5)))
    assert isinstance(finding, OtherVehicles)
    assert finding.learned == segment.labels[1:]
    alike = [
        replace(s, names=("Car",) * 3) for s in (segment, cut(recording, 0.0, 90.0, (2, 3, 4)))
    ]
    learned, other = alike
    findings = validation_findings([learned], other)
    assert OtherVehicles(learned.labels[1:], other.labels[1:]) in findings
    with pytest.raises(SegmentError, match="choose as many"):
        validation_findings([segment], cut(recording, 200.0, 100.0, (1, 2)))
