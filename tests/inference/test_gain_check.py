"""An estimate held against the measured gain and against the drive itself."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from accpinn.inference.gain_check import LEAST, GainCheck, gain_checks
from accpinn.inference.intervals import Uncertainty, from_draws
from accpinn.inference.trust import Trust, trust
from accpinn.model.cthp import Parameters
from accpinn.model.published import ParameterSet
from accpinn.results.messages.stability import headline
from accpinn.results.tables import Marked
from accpinn.results.tables.stability import verdict_table
from accpinn.segment import Segment
from accpinn.study.vehicles import AssessedVehicles
from bench.disturbed import Disturbance, disturbed

LOUD, CALM = Parameters([0.07], 0.1, 1.1), Parameters([0.05], 0.6, 2.5)
"""A car that amplifies by 4 dB, and one that amplifies nothing."""


@cache
def driven(car: str) -> tuple[Segment, ...]:
    """Two windows of ten minutes of a car that obeys the CTHP, slightly disturbed."""
    parameters = {"loud": LOUD, "calm": CALM}[car]
    return tuple(
        disturbed(parameters, seed, Disturbance(deviation=0.05), duration=600.0) for seed in (3, 4)
    )


def given(parameters: Parameters) -> Uncertainty:
    """The uncertainty of parameters whose draws lie within a per cent of them."""
    spread = 1.0 + 0.01 * np.random.default_rng(0).standard_normal((100, 1, 6))
    return from_draws(parameters, Parameters.of(parameters.complete * spread), 0.9)


def check(car: str, parameters: Parameters) -> tuple[GainCheck, Uncertainty]:
    uncertainty = given(parameters)
    (gain_check,) = gain_checks(driven(car), uncertainty)
    return gain_check, uncertainty


def test_a_car_that_obeys_its_estimate_is_not_contradicted() -> None:
    for car, parameters in (("loud", LOUD), ("calm", CALM)):
        gain_check, _ = check(car, parameters)
        assert gain_check.contradiction == ""
        assert gain_check.frequencies >= 8
        assert gain_check.rms < 0.8
        assert abs(gain_check.peak - gain_check.model_peak) < 0.8


@pytest.mark.parametrize(
    ("car", "parameters", "kind", "part"),
    [
        ("loud", CALM, "amplifies", "L₂ string stable by the model; the measured gain contradicts"),
        ("calm", LOUD, "damps", "amplifies disturbances by the model; the measured gain contra"),
        ("loud", Parameters([0.2], 0.1, 0.9), "apart", "their bands lie apart at"),
    ],
)
def test_a_verdict_that_the_recording_denies_is_the_models_alone(
    car: str, parameters: Parameters, kind: str, part: str
) -> None:
    gain_check, uncertainty = check(car, parameters)
    assert gain_check.contradiction == kind
    chosen = ParameterSet("made", ("Audi",), parameters)
    assert part in gain_check.sentence(chosen)
    plain, checked = (AssessedVehicles(chosen, uncertainty, by) for by in ((), (gain_check,)))
    assert headline(checked) != headline(plain)
    table = verdict_table(checked)
    (mark,) = (cell for cell in table.rows[0] if isinstance(cell, Marked))
    assert mark.why == gain_check.sentence(chosen)


def test_too_few_coherent_frequencies_say_nothing() -> None:
    calm = driven("calm")[0]
    short = replace(calm, time=calm.time[:400], speeds=calm.speeds[:400], gaps=calm.gaps[:400])
    (gain_check,) = gain_checks([short], given(LOUD))
    assert gain_check.frequencies < LEAST
    assert not gain_check.contradiction
    assert "could not be held against" in gain_check.sentence(ParameterSet("made", ("Audi",), LOUD))


def test_windows_are_averaged_as_one_measurement() -> None:
    first, averaged = (gain_checks(driven("loud")[:n], given(LOUD))[0] for n in (1, 2))
    assert averaged.rms < 0.5 * first.rms


TRUE = Parameters(0.1, 0.3, 1.2)


@pytest.fixture(scope="module")
def windows() -> list[Segment]:
    return [disturbed(TRUE[None], seed, Disturbance(0.05), duration=120.0) for seed in range(4)]


def trusted(windows: list[Segment], parameters: Parameters, taus: tuple[float, ...]) -> Trust:
    by_window = Parameters(np.full(4, 0.1), np.full(4, 0.3), np.array(taus))
    return trust(windows, 2, [0], "cthp", parameters, by_window, 20.0)


def test_the_truth_reproduces_the_drive_and_another_car_or_one_that_collides_does_not(
    windows: list[Segment],
) -> None:
    other = trusted(windows, Parameters(0.02, 0.02, 2.5), (1.2,) * 4)
    assert (other.same, other.is_reproduced) == (0, False)
    crash = trusted(windows, Parameters(0.3, 0.0, 0.05), (0.05,) * 4)
    assert (crash.collides, crash.is_reproduced) == (True, False)
    assert crash.in_words != other.in_words
    finding = trusted(windows, TRUE, (1.2, 1.21, 1.3, 1.19))
    assert (finding.windows, finding.same) == (4, 3)
    assert finding.is_reproduced
    assert finding.rmse < 1.5
    assert finding.deviation == pytest.approx(
        np.sqrt(np.mean([window.gaps.var() for window in windows])), rel=1e-6
    )


def test_a_method_without_own_estimates_of_windows_is_held_against_the_drive_alone(
    windows: list[Segment],
) -> None:
    finding = trust(windows, 2, [0], "cthp", TRUE, None, 20.0)
    assert (finding.windows, finding.same) == (4, None)
    assert finding.is_reproduced
    assert not finding.is_contradicted
    assert finding.in_words.startswith("Based on 4 windows. ")
    other = trust(windows, 2, [0], "cthp", Parameters(0.02, 0.02, 2.5), None, 20.0)
    assert other.is_contradicted


def test_what_is_excluded_does_not_count_and_does_not_move_the_rest(
    windows: list[Segment],
) -> None:
    """For 30 s the vehicle is 40 m further behind, as when it catches up."""
    far = (windows[0].time > 40.0) & (windows[0].time < 70.0)
    moved = [
        replace(window, gaps=window.gaps + 40.0 * far[:, None], mask=~far[:, None])
        for window in windows
    ]
    masked, whole = trusted(moved, TRUE, (1.2,) * 4), trusted(windows, TRUE, (1.2,) * 4)
    assert masked.is_reproduced
    assert masked.rmse < 1.5
    assert masked.deviation < 1.5 * whole.deviation
    everything = trusted([replace(window, mask=None) for window in moved], TRUE, (1.2,) * 4)
    assert everything.rmse > 4 * masked.rmse
