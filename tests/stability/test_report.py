"""Stability reports: the paper's tables, verdicts that agree with each other, and edge cases."""

from math import inf, isnan, nan

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from accpinn import Parameters, stability_report
from accpinn.model.registry import FOLLOWING
from accpinn.stability import Behaviour, VehicleStability, Verdict, peak_gains, stability_at
from accpinn.stability.criteria import MARGINAL
from tests.stability.references import TABLE, Reference, integral_of_magnitude
from tests.support.vehicles import (
    CALM,
    NO_GAP_CONTROL,
    NO_REACTION,
    TESLA,
    UNDAMPED,
    damping,
    extreme,
    ordinary,
    row,
)


def of(vehicle: Parameters) -> VehicleStability:
    return stability_report(vehicle).vehicles[0]


@pytest.mark.parametrize("reference", TABLE, ids=lambda reference: str(reference.name))
def test_the_exact_gain_and_the_papers_verdicts_are_reproduced(reference: Reference) -> None:
    found = of(reference.vehicle)
    assert found.peak.db == pytest.approx(20 * np.log10(found.peak.gain), abs=1e-9)
    assert found.linf_gain == pytest.approx(integral_of_magnitude(reference.vehicle), abs=1e-6)
    # The paper's columns; its L∞ criterion is not the exact one.
    assert (found.l2.stable, found.linf_paper.stable) == (reference.l2, reference.linf)
    assert not found.linf_exact.stable


class TestVerdictsAgree:
    @settings(max_examples=50)
    @given(st.one_of(ordinary, extreme))
    def test_criteria_gains_and_peaks_with_each_other(self, vehicle: Parameters) -> None:
        found = of(vehicle)
        assert not isnan(found.peak.gain)
        assert found.linf_gain >= found.peak.gain * (1 - 1e-9)
        assert (found.l2.value < 0) == (found.peak.db > 0) == (found.crossover is not None)
        if found.linf_exact.stable and found.behaviour is not Behaviour.NO_REACTION:
            assert found.l2.stable
            assert found.linf_paper.stable or found.linf_paper.marginal
            clear = not found.linf_exact.marginal
            assert (found.linf_gain, found.overshoot) == (1, 0) or not clear

    @settings(max_examples=30)
    @given(ordinary)
    def test_the_papers_criterion_asks_for_real_poles(self, vehicle: Parameters) -> None:
        found = of(vehicle)
        assume(not found.linf_paper.marginal)
        real = found.behaviour is Behaviour.REAL_POLES
        assert found.linf_paper.stable == real == (found.poles[0].imag == 0)
        assert real == (damping(vehicle) > 1)
        assert found.damping_ratio == pytest.approx(damping(vehicle))


def test_at_a_speed_it_is_that_of_the_linearisation() -> None:
    """The CTHP's is the same at all; another model has none above its desired speed."""
    speeds, cthp, idm = [10.0, 20.0, 30.0, 60.0], FOLLOWING["cthp-s0-delay"], FOLLOWING["idm"]
    gains = peak_gains(cthp, cthp.typical, speeds)
    (given,) = stability_report(cthp.linearised(cthp.typical, 20.0)[None]).vehicles
    assert gains == pytest.approx(given.peak.db)
    found = [stability_at(idm, idm.typical, speed) for speed in speeds]
    gains = peak_gains(idm, idm.typical, speeds)
    assert (found[3], isnan(gains[3])) == (None, True)
    assert gains[:3] == pytest.approx([one.peak.db for one in found[:3]])
    assert np.ptp(gains[:3]) > 0.1


def test_vehicles_of_different_kinds_are_assessed_as_each_by_itself() -> None:
    late, slow = Parameters(0.1, 0.3, 1.3, delay=0.4), Parameters(0.06, 0.2, 1.5, lag=0.5)
    platoon = row(TESLA, late, NO_GAP_CONTROL, CALM, slow)
    for together, vehicle in zip(stability_report(platoon).vehicles, platoon, strict=True):
        alone = of(vehicle)
        assert (together.parameters, together.behaviour) == (vehicle, alone.behaviour)
        assert (together.smallest_tau is None) == (alone.smallest_tau is None)
        for verdicts in zip(verdicts_of(together), verdicts_of(alone), strict=True):
            assert len({(v.criterion, v.stable, v.marginal) for v in verdicts}) == 1
        np.testing.assert_allclose(numbers_of(together), numbers_of(alone), rtol=1e-12)


def verdicts_of(vehicle: VehicleStability) -> tuple[Verdict, ...]:
    return vehicle.l2, vehicle.linf_paper, vehicle.linf_exact


def numbers_of(vehicle: VehicleStability) -> list[complex]:
    """All numbers of a vehicle; nan for those that it has not."""
    optional = vehicle.crossover, vehicle.damping_ratio
    return [
        *(verdict.value for verdict in verdicts_of(vehicle)),
        *(nan if number is None else number for number in optional),
        *(vehicle.overshoot, vehicle.onset, vehicle.peak.gain, vehicle.peak.omega),
        *vehicle.poles,
    ]


class TestDegenerate:
    @pytest.mark.parametrize(
        ("vehicle", "behaviour", "gain", "stable", "marginal"),
        [
            (NO_GAP_CONTROL, Behaviour.NO_GAP_CONTROL, 1, True, True),
            (NO_REACTION, Behaviour.NO_REACTION, 0, True, True),
            (UNDAMPED, Behaviour.UNDAMPED, inf, False, False),
        ],
    )
    def test_limits_of_the_gains(
        self, vehicle: Parameters, behaviour: Behaviour, gain: float, stable: bool, marginal: bool
    ) -> None:
        found = of(vehicle)
        assert found.behaviour is behaviour
        assert (found.linf_gain, found.peak.gain) == (gain, gain)
        assert (found.l2.stable, found.l2.marginal) == (stable, marginal)
        assert (found.linf_exact.stable, found.linf_exact.marginal) == (stable, False)
        assert (found.smallest_tau is None) == (found.damping_ratio is None) == stable
        assert of(Parameters(1e-60, 0.3, 1.2)).parameters == Parameters(1e-60, 0.3, 1.2)

    def test_a_gain_barely_above_one_is_marginal(self) -> None:
        # Complex poles with damping ratio 0.999: a swing of exp(-70).
        total = 2 * 0.999 * 0.5
        found = of(Parameters(0.25, 0.1, (total - 0.1) / 0.25))
        assert not found.linf_exact.stable
        assert found.linf_exact.marginal
        assert 1 <= found.linf_exact.value <= 1 + MARGINAL


class TestPlatoon:
    def test_other_vehicles_can_make_up_for_one(self) -> None:
        damped = Parameters(0.08, 0.02, 9.0)
        platoon = stability_report(row(TESLA, damped, damped)).platoon
        assert not platoon.l2_strict.stable
        assert platoon.l2_strict.value == platoon.peaks[0].gain > 1
        assert platoon.l2_weak.stable
        assert platoon.l2_weak.value == platoon.peaks[2].gain == 1

    def test_stable_vehicles_make_a_stable_platoon(self) -> None:
        platoon = stability_report(row(*[CALM] * 5)).platoon
        verdicts = (platoon.l2_strict, platoon.l2_weak, platoon.linf_strict, platoon.linf_weak)
        assert all(verdict.stable and not verdict.marginal for verdict in verdicts)
        np.testing.assert_allclose(platoon.linf.gain, 1, atol=1e-9)
