"""Stability reports: the paper's tables, verdicts that agree with each other, and edge cases."""

import time
from math import inf, isinf, isnan

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from accpinn.model.cthp import Parameters
from accpinn.stability.criteria import MARGINAL
from accpinn.stability.report import Behaviour, VehicleStability, stability_report
from tests.stability.references import TABLE, Reference, row_of
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

every_reference = pytest.mark.parametrize(
    "reference", TABLE, ids=lambda reference: str(reference.name)
)


def of(vehicle: Parameters) -> VehicleStability:
    return stability_report(vehicle).vehicles[0]


class TestReferences:
    @every_reference
    def test_closed_forms_agree(self, reference: Reference) -> None:
        found = of(reference.vehicle)
        assert found.peak.gain == pytest.approx(reference.gain, abs=1e-6)
        assert found.peak.db == pytest.approx(reference.db, abs=1e-6)
        assert found.peak.omega == pytest.approx(reference.omega, abs=1e-6)
        assert found.crossover == pytest.approx(reference.crossover, abs=1e-6)
        assert found.linf_gain == pytest.approx(reference.linf_gain, abs=1e-6)

    @every_reference
    def test_the_table_is_what_its_methods_give(self, reference: Reference) -> None:
        stored = (
            reference.gain,
            reference.db,
            reference.omega,
            reference.crossover,
            reference.linf_gain,
        )
        assert row_of(reference.vehicle) == pytest.approx(stored, abs=6e-7)

    @every_reference
    def test_the_papers_columns_are_reproduced(self, reference: Reference) -> None:
        found = of(reference.vehicle)
        assert found.l2.stable == reference.paper_l2
        assert found.linf_paper.stable == reference.paper_linf
        assert not found.linf_exact.stable

    @pytest.mark.parametrize("vehicle", [(0.0627, 0.2630, 1.17), (0.0581, 0.3010, 1.04)])
    def test_table_two_says_no_twice(self, vehicle: tuple[float, float, float]) -> None:
        found = of(Parameters(*vehicle))
        assert (found.l2.stable, found.linf_paper.stable) == (False, False)


class TestVerdictsAgree:
    @given(ordinary)
    def test_no_sinusoid_beats_the_exact_gain(self, vehicle: Parameters) -> None:
        found = of(vehicle)
        assert found.peak.gain <= found.linf_gain * (1 + 1e-12)

    @given(st.one_of(ordinary, extreme))
    def test_exactly_linf_stable_means_l2_stable_and_real_poles(self, vehicle: Parameters) -> None:
        found = of(vehicle)
        if found.linf_exact.stable and found.behaviour is not Behaviour.NO_REACTION:
            assert found.l2.stable
            assert found.linf_paper.stable or found.linf_paper.marginal

    @given(st.one_of(ordinary, extreme))
    def test_the_l2_criterion_has_the_sign_of_the_peak(self, vehicle: Parameters) -> None:
        found = of(vehicle)
        assert (found.l2.value < 0) == (found.peak.db > 0) == (found.crossover is not None)

    @given(ordinary)
    def test_the_exact_gain_is_one_exactly_where_stable(self, vehicle: Parameters) -> None:
        found = of(vehicle)
        if found.linf_exact.stable and not found.linf_exact.marginal:
            assert (found.linf_gain, found.overshoot) == (1, 0)
        else:
            assert found.linf_gain >= 1

    @given(ordinary)
    def test_the_papers_criterion_asks_for_real_poles(self, vehicle: Parameters) -> None:
        found = of(vehicle)
        assume(not found.linf_paper.marginal)
        real = found.behaviour is Behaviour.REAL_POLES
        assert found.linf_paper.stable == real == (found.poles[0].imag == 0)
        assert real == (damping(vehicle) > 1)
        assert found.damping_ratio == pytest.approx(damping(vehicle))

    @given(ordinary)
    def test_a_vehicle_at_its_smallest_headway_is_marginal(self, vehicle: Parameters) -> None:
        smallest = of(vehicle).smallest_tau
        assert smallest is not None
        for name in ("l2", "linf_exact"):
            at = of(Parameters(vehicle.alpha, vehicle.beta, getattr(smallest, name)))
            assert getattr(at, name).stable
            assert getattr(at, name).marginal


class TestDegenerate:
    def test_parameters_are_reported_as_given(self) -> None:
        found = of(Parameters(1e-60, 0.3, 1.2))
        assert found.behaviour is Behaviour.NO_GAP_CONTROL
        assert found.parameters == Parameters(1e-60, 0.3, 1.2)

    def test_without_gap_control(self) -> None:
        found = of(NO_GAP_CONTROL)
        assert found.behaviour is Behaviour.NO_GAP_CONTROL
        assert (found.linf_gain, found.peak.gain) == (1, 1)
        assert (found.l2.stable, found.l2.marginal) == (True, True)
        assert (found.linf_exact.stable, found.linf_exact.marginal) == (True, False)
        assert found.smallest_tau is None
        assert found.damping_ratio is None

    def test_without_reaction(self) -> None:
        found = of(NO_REACTION)
        assert found.behaviour is Behaviour.NO_REACTION
        assert (found.linf_gain, found.peak.gain, found.peak.db) == (0, 0, -inf)

    def test_without_damping(self) -> None:
        found = of(UNDAMPED)
        assert found.behaviour is Behaviour.UNDAMPED
        assert isinf(found.linf_gain)
        assert isinf(found.peak.gain)
        assert found.peak.omega == 0.5
        assert not found.l2.stable
        assert not found.linf_exact.stable

    def test_without_headway_every_vehicle_is_unstable(self) -> None:
        found = of(Parameters(0.1, 0.4, 0.0))
        assert not found.l2.stable
        assert found.linf_gain > found.peak.gain > 1

    def test_a_gain_barely_above_one_is_marginal(self) -> None:
        # Complex poles with damping ratio 0.999: a swing of exp(-70).
        total = 2 * 0.999 * 0.5
        found = of(Parameters(0.25, 0.1, (total - 0.1) / 0.25))
        assert not found.linf_exact.stable
        assert found.linf_exact.marginal
        assert 1 <= found.linf_exact.value <= 1 + MARGINAL

    @given(st.lists(extreme, min_size=1, max_size=4))
    def test_huge_tiny_and_zero_values_get_an_answer(self, platoon: list[Parameters]) -> None:
        for found in stability_report(row(*platoon)).vehicles:
            assert not isnan(found.peak.gain)
            assert found.linf_gain >= found.peak.gain * (1 - 1e-9)


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

    def test_what_cannot_be_computed_is_marginal(self) -> None:
        vehicles = row(Parameters(1e-12, 1.0, 0.1), Parameters(1e8, 1.0, 1e-5))
        weak = stability_report(vehicles).platoon.linf_weak
        assert (weak.stable, weak.marginal) == (False, True)
        assert isnan(weak.value)


def test_ten_vehicles_are_reported_within_fifty_milliseconds() -> None:
    ten = row(*(reference.vehicle for reference in TABLE))
    seconds = []
    for _ in range(6):
        start = time.process_time()
        stability_report(ten)
        seconds.append(time.process_time() - start)
    assert min(seconds) < 0.05
