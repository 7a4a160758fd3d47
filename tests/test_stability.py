"""String stability: closed forms against independent numerics, the paper, and each other."""

import time
from math import inf, isinf, isnan, nan, pi

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from scipy.linalg import expm

from accpinn.errors import ParameterError
from accpinn.model.cthp import Parameters
from accpinn.stability.criteria import MARGINAL, Laws
from accpinn.stability.frequency import response, slowest_rate, transfer_function
from accpinn.stability.impulse import impulse_response, step_metrics
from accpinn.stability.maps import (
    boundaries_over_alpha,
    boundaries_over_beta,
    gains_over_alpha,
    gains_over_beta,
)
from accpinn.stability.report import VehicleStability, stability_report
from accpinn.stability.vehicle import Behaviour
from accpinn.stability.verdicts import factor
from tests.references_stability import TABLE, Reference, impulse, integral_of_magnitude, row

TESLA = Parameters(0.0409, 0.4450, 1.16)
AUDI = Parameters(0.0612, 0.1200, 1.19)
CALM = Parameters(0.08, 0.60, 3.0)
"""Stable by every criterion."""

laws = st.builds(
    Parameters, alpha=st.floats(1e-4, 4.0), beta=st.floats(0.0, 4.0), tau=st.floats(0.01, 6.0)
)
extreme = st.one_of(st.just(0.0), st.floats(-12, 12).map(lambda power: 10.0**power))
extreme_laws = st.builds(Parameters, alpha=extreme, beta=extreme, tau=extreme)


platoons = st.lists(laws.filter(lambda law: damping(law) > 0.05), min_size=2, max_size=5)


def of(law: Parameters) -> VehicleStability:
    return stability_report([law]).vehicles[0]


def damping(law: Parameters) -> float:
    return (law.alpha * law.tau + law.beta) / (2 * law.alpha**0.5)


class TestReferences:
    @pytest.mark.parametrize("reference", TABLE, ids=lambda reference: reference.name)
    def test_closed_forms_agree(self, reference: Reference) -> None:
        found = of(reference.law)
        assert found.peak.gain == pytest.approx(reference.gain, abs=1e-6)
        assert found.peak.db == pytest.approx(reference.db, abs=1e-6)
        assert found.peak.omega == pytest.approx(reference.omega, abs=1e-6)
        assert found.crossover == pytest.approx(reference.crossover, abs=1e-6)
        assert found.linf_gain == pytest.approx(reference.linf_gain, abs=1e-6)

    @pytest.mark.parametrize("reference", TABLE, ids=lambda reference: reference.name)
    def test_the_table_is_what_its_methods_give(self, reference: Reference) -> None:
        stored = (
            reference.gain,
            reference.db,
            reference.omega,
            reference.crossover,
            reference.linf_gain,
        )
        assert row(reference.law) == pytest.approx(stored, abs=6e-7)

    @pytest.mark.parametrize("reference", TABLE, ids=lambda reference: reference.name)
    def test_the_papers_columns_are_reproduced(self, reference: Reference) -> None:
        found = of(reference.law)
        assert found.l2.stable == reference.paper_l2
        assert found.linf_paper.stable == reference.paper_linf

    def test_the_exact_gain_calls_none_of_them_stable(self) -> None:
        assert not any(of(reference.law).linf_exact.stable for reference in TABLE)

    @pytest.mark.parametrize("law", [(0.0627, 0.2630, 1.17), (0.0581, 0.3010, 1.04)])
    def test_table_two_says_no_twice(self, law: tuple[float, float, float]) -> None:
        found = of(Parameters(*law))
        assert (found.l2.stable, found.linf_paper.stable) == (False, False)

    def test_the_tesla_is_where_the_two_criteria_differ(self) -> None:
        found = of(TESLA)
        assert found.linf_paper.stable
        assert not found.linf_exact.stable
        assert found.linf_exact.value == pytest.approx(1.095, abs=5e-4)
        assert found.linf_exact.reason == (
            "The paper's criterion asks for real poles only, which is necessary but not"
            " sufficient: here the impulse response changes sign, so a peak of the leader's speed"
            " deviation can come out up to 1.095 times as large."
        )

    def test_the_criteria_are_the_papers_expressions(self) -> None:
        alpha, beta, tau = 0.0409, 0.4450, 1.16
        found = of(TESLA)
        kappa = alpha**2 * tau**2 + 2 * alpha * beta * tau - 2 * alpha
        assert found.l2.value == pytest.approx(kappa, rel=1e-12)
        assert found.linf_paper.value == pytest.approx((alpha * tau + beta) ** 2 - 4 * alpha)


class TestProperties:
    @given(laws)
    def test_no_sinusoid_beats_the_exact_gain(self, law: Parameters) -> None:
        found = of(law)
        assert found.peak.gain <= found.linf_gain * (1 + 1e-12)

    @given(st.one_of(laws, extreme_laws))
    def test_exactly_linf_stable_means_l2_stable_and_real_poles(self, law: Parameters) -> None:
        found = of(law)
        if found.linf_exact.stable and found.behaviour is not Behaviour.NO_REACTION:
            assert found.l2.stable
            assert found.linf_paper.stable or found.linf_paper.marginal

    @given(st.one_of(laws, extreme_laws))
    def test_the_l2_criterion_has_the_sign_of_the_peak(self, law: Parameters) -> None:
        found = of(law)
        assert (found.l2_criterion < 0) == (found.peak.db > 0)
        if found.crossover is None:
            assert found.l2_criterion >= 0
            assert found.peak.omega == 0
        else:
            assert 0 < found.peak.omega < found.crossover

    @given(laws)
    def test_the_exact_gain_is_one_exactly_where_stable(self, law: Parameters) -> None:
        found = of(law)
        if found.linf_exact.stable and not found.linf_exact.marginal:
            assert found.linf_gain == 1
            assert found.overshoot == 0
        else:
            assert found.linf_gain >= 1

    @given(laws)
    def test_the_paper_s_criterion_asks_for_real_poles(self, law: Parameters) -> None:
        found = of(law)
        assume(not found.linf_paper.marginal)
        assert found.linf_paper.stable == (found.poles[0].imag == 0) == (damping(law) > 1)

    @given(laws)
    def test_poles_solve_the_characteristic_equation(self, law: Parameters) -> None:
        slow, fast = of(law).poles
        assert slow + fast == pytest.approx(-law.alpha * law.tau - law.beta, rel=1e-9)
        assert slow * fast == pytest.approx(law.alpha, rel=1e-9)
        assert slow.real >= fast.real

    @given(laws)
    def test_the_response_is_one_at_the_crossover_and_largest_at_the_peak(
        self, law: Parameters
    ) -> None:
        found = of(law)
        assume(found.crossover is not None)
        assert found.crossover is not None
        omega = np.array([found.peak.omega, found.crossover, 0.0])
        magnitude = np.abs(response([law], omega))[0]
        np.testing.assert_allclose(magnitude, [found.peak.gain, 1, 1], rtol=1e-7)
        around = found.peak.omega * np.array([0.5, 0.9, 0.99, 1.01, 1.1, 2.0])
        assert (np.abs(response([law], around)) <= found.peak.gain * (1 + 1e-12)).all()

    @given(laws, st.floats(0.01, 0.5))
    def test_each_smallest_headway_is_the_boundary(self, law: Parameters, off: float) -> None:
        smallest = of(law).smallest_tau
        assert smallest is not None
        for name in ("l2", "linf_paper", "linf_exact"):
            headway = getattr(smallest, name)
            if headway > 0:
                above = of(Parameters(law.alpha, law.beta, headway * (1 + off)))
                below = of(Parameters(law.alpha, law.beta, headway * (1 - off)))
                assert getattr(above, name).stable
                assert not getattr(below, name).stable

    @given(laws)
    def test_a_vehicle_set_to_its_smallest_headway_is_marginal(self, law: Parameters) -> None:
        smallest = of(law).smallest_tau
        assert smallest is not None
        for name in ("l2", "linf_exact"):
            at = getattr(of(Parameters(law.alpha, law.beta, getattr(smallest, name))), name)
            assert at.stable
            assert at.marginal
            assert at.reason.startswith("On the boundary")

    @given(st.one_of(laws, extreme_laws))
    def test_every_reason_is_one_sentence_without_odd_numbers(self, law: Parameters) -> None:
        result = stability_report([law, AUDI])
        vehicle, platoon = result.vehicles[0], result.platoon
        for verdict in (
            vehicle.l2,
            vehicle.linf_paper,
            vehicle.linf_exact,
            platoon.l2_strict,
            platoon.l2_weak,
            platoon.linf_strict,
            platoon.linf_weak,
        ):
            assert verdict.reason.endswith(".")
            assert ". " not in verdict.reason
            assert "nan" not in verdict.reason
            assert "inf " not in verdict.reason
            assert "None" not in verdict.reason


class TestExactGain:
    @given(st.floats(0.08, 3.0), st.floats(0.0, 1.0), st.floats(0.01, 1.0))
    @settings(deadline=None, max_examples=25)
    def test_agrees_with_quadrature(self, zeta: float, share: float, alpha: float) -> None:
        # The share of β in ατ + β = 2ζ√α.
        total = 2 * zeta * alpha**0.5
        law = Parameters(alpha, share * total, (1 - share) * total / alpha)
        assert of(law).linf_gain == pytest.approx(integral_of_magnitude(law), abs=1e-8)

    @pytest.mark.parametrize("off", [0.0, 1e-15, 1e-12, 1e-9, 1e-7, 1e-5, 1e-3])
    @pytest.mark.parametrize("side", [-1, 1])
    @pytest.mark.parametrize("share", [0.55, 0.7, 0.95, 1.0])
    def test_loses_nothing_near_a_double_pole(self, off: float, side: int, share: float) -> None:
        # With a double pole, t₁ = k/(k-1) and M = (k-1) exp(-t₁) for k = β/√α > 1.
        alpha, total = 0.25, 1.0 + side * off
        law = Parameters(alpha, share * total, (1 - share) * total / alpha)
        if off <= 1e-9:
            k = 2 * share
            expected = 1 + 2 * (k - 1) * np.exp(-k / (k - 1))
            assert of(law).linf_gain == pytest.approx(expected, abs=max(1e-14, 30 * off))
        else:
            assert of(law).linf_gain == pytest.approx(integral_of_magnitude(law), abs=1e-10)

    def test_without_beta_is_that_of_the_textbook(self) -> None:
        # A second-order lag overshoots by exp(-πζ/√(1-ζ²)), the same factor from swing to swing.
        law = Parameters(0.04, 0.0, 2.0)
        swing = np.exp(-pi * 0.2 / np.sqrt(1 - 0.04))
        assert of(law).overshoot == pytest.approx(swing, rel=1e-12)
        assert of(law).linf_gain == pytest.approx(1 + 2 * swing / (1 - swing), rel=1e-12)

    @given(laws)
    def test_is_the_same_in_other_units_of_time(self, law: Parameters) -> None:
        scaled = Parameters(law.alpha * 1e8, law.beta * 1e4, law.tau * 1e-4)
        assert of(scaled).linf_gain == pytest.approx(of(law).linf_gain, rel=1e-6)

    @given(laws, st.lists(st.floats(0, 30), min_size=1, max_size=5))
    def test_the_impulse_response_is_that_of_the_state_space(
        self, law: Parameters, instants: list[float]
    ) -> None:
        found = impulse_response(law, np.array(instants))
        expected = [impulse(law, instant) for instant in instants]
        np.testing.assert_allclose(found, expected, rtol=1e-7, atol=1e-9)

    def test_overshoot_is_where_the_step_response_turns(self) -> None:
        system = np.array([[0.0, 1.0], [-TESLA.alpha, -TESLA.alpha * TESLA.tau - TESLA.beta]])
        outputs = np.array([TESLA.alpha, TESLA.beta])
        start = np.linalg.solve(system, np.array([0.0, 1.0]))
        steps = [outputs @ (expm(system * t) @ start - start) for t in np.arange(0, 60, 0.05)]
        assert of(TESLA).overshoot == pytest.approx(max(steps) - 1, abs=1e-6)


class TestDegenerate:
    def test_what_is_almost_zero_is_zero(self) -> None:
        found = of(Parameters(1e-60, 0.3, 1.2))
        assert found.behaviour is Behaviour.NO_SPACING
        assert found.parameters.tau == 1.2

    def test_without_spacing(self) -> None:
        found = of(Parameters(0.0, 0.3, nan))
        assert found.behaviour is Behaviour.NO_SPACING
        assert found.linf_gain == 1
        assert found.peak.gain == 1
        assert found.l2.stable
        assert found.l2.marginal
        assert found.linf_exact.stable
        assert found.smallest_tau is None
        assert found.damping_ratio is None
        assert "without keeping a gap" in found.l2.reason
        # H = β / (s + β)
        h = response([Parameters(0.0, 0.3, nan)], np.array([0.0, 0.3]))
        np.testing.assert_allclose(h, [[1, 1 / (1 + 1j)]])
        assert slowest_rate(Parameters(0.0, 0.3, nan)) == 0.3

    def test_without_reaction(self) -> None:
        found = of(Parameters(0.0, 0.0, nan))
        assert found.behaviour is Behaviour.NO_REACTION
        assert (found.linf_gain, found.peak.gain, found.peak.db) == (0, 0, -inf)
        assert "does not react" in found.linf_exact.reason
        assert not response([Parameters(0.0, 0.0, nan)], np.array([0.0, 1.0])).any()

    def test_without_damping(self) -> None:
        law = Parameters(0.25, 0.0, 0.0)
        found = of(law)
        assert found.behaviour is Behaviour.UNDAMPED
        assert isinf(found.linf_gain)
        assert isinf(found.peak.gain)
        assert found.peak.omega == 0.5
        assert not found.l2.stable
        assert not found.linf_exact.stable
        assert isinf(np.abs(response([law], np.array([0.5])))[0, 0])

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

    @pytest.mark.parametrize(
        ("law", "words"),
        [
            ((nan, 0.1, 1.0), "α is missing"),
            ((0.1, nan, 1.0), "β is missing"),
            ((0.1, 0.1, nan), "τ is missing"),
            ((-0.1, 0.1, 1.0), "α = -0.1 is negative"),
            ((0.1, -0.2, 1.0), "β = -0.2 is negative"),
            ((0.1, 0.1, -1.0), "τ = -1 is negative"),
            ((inf, 0.1, 1.0), "α = inf is beyond any vehicle"),
            ((0.1, 1e51, 1.0), "β = 1e+51 is beyond any vehicle"),
        ],
    )
    def test_impossible_values_are_refused_in_one_sentence(
        self, law: tuple[float, float, float], words: str
    ) -> None:
        with pytest.raises(ParameterError) as caught:
            stability_report([AUDI, Parameters(*law)])
        sentence = str(caught.value)
        assert sentence.startswith(f"Parameter set 2: {words}")
        assert sentence.endswith(".")
        assert "\n" not in sentence

    def test_nothing_is_refused_too(self) -> None:
        with pytest.raises(ParameterError, match="no vehicle"):
            stability_report([])

    @given(st.lists(extreme_laws, min_size=1, max_size=4))
    @settings(deadline=None)
    def test_huge_tiny_and_zero_values_get_an_answer(self, platoon: list[Parameters]) -> None:
        for found in stability_report(platoon).vehicles:
            assert not isnan(found.linf_gain)
            assert not isnan(found.peak.gain)
            assert found.linf_gain >= found.peak.gain * (1 - 1e-9)


class TestHeadToTail:
    def test_of_equal_vehicles_is_the_power(self) -> None:
        single, platoon = of(AUDI), stability_report([AUDI] * 8).platoon
        for k, peak in enumerate(platoon.peaks, 1):
            assert peak.gain == pytest.approx(single.peak.gain**k, rel=1e-10)
            assert peak.omega == pytest.approx(single.peak.omega, rel=1e-6)

    def test_is_the_largest_product_on_a_fine_grid(self) -> None:
        mixed = [reference.law for reference in TABLE]
        omega = np.geomspace(1e-3, 3.0, 100_001)
        largest = np.abs(np.cumprod(response(mixed, omega), axis=0)).max(axis=1)
        found = [peak.gain for peak in stability_report(mixed).platoon.peaks]
        np.testing.assert_allclose(found, largest, rtol=1e-7)
        assert (np.array(found) >= largest * (1 - 1e-12)).all()

    @given(platoons, st.randoms(use_true_random=False))
    @settings(deadline=None, max_examples=25)
    def test_the_last_does_not_care_about_the_order(
        self, platoon: list[Parameters], random
    ) -> None:
        one = stability_report(platoon).platoon
        random.shuffle(platoon)
        other = stability_report(platoon).platoon
        assert one.peaks[-1].gain == pytest.approx(other.peaks[-1].gain, rel=1e-9)
        tolerance = 1e-7 + 3 * (one.linf.error[-1] + other.linf.error[-1])
        assert one.linf.gain[-1] == pytest.approx(other.linf.gain[-1], abs=tolerance)

    @given(platoons)
    @settings(deadline=None, max_examples=25)
    def test_the_exact_gain_lies_between_peak_and_product(self, platoon: list[Parameters]) -> None:
        result = stability_report(platoon)
        product = np.cumprod([vehicle.linf_gain for vehicle in result.vehicles])
        peaks = np.array([peak.gain for peak in result.platoon.peaks])
        slack = 1e-7 + 3 * result.platoon.linf.error
        assert (result.platoon.linf.gain >= peaks - slack).all()
        assert (result.platoon.linf.gain <= product + slack).all()

    def test_the_exact_gain_agrees_with_a_fine_convolution(self) -> None:
        step = 0.005
        instants = np.arange(60_000) * step
        # The midpoint rule for each h, then the integral of the magnitude of their convolution.
        one, other = (impulse_response(law, instants + step / 2) for law in (AUDI, TESLA))
        length = 2 * len(instants)
        both = np.fft.irfft(np.fft.rfft(one, length) * np.fft.rfft(other, length))[: len(one)]
        found = stability_report([AUDI, TESLA]).platoon.linf
        assert found.gain[1] == pytest.approx(np.abs(both).sum() * step**2, abs=2e-5)
        assert found.error[1] < 1e-6
        assert found.error[0] == 0

    def test_others_can_make_up_for_one(self) -> None:
        damped = Parameters(0.08, 0.02, 9.0)
        platoon = stability_report([TESLA, damped, damped]).platoon
        assert not platoon.l2_strict.stable
        assert platoon.l2_strict.reason.startswith("Follower 1 lets a disturbance come out larger")
        assert platoon.l2_weak.stable
        assert "others damp" in platoon.l2_weak.reason
        assert platoon.peaks[0].gain > 1
        assert platoon.peaks[2].gain == 1

    def test_stable_vehicles_make_a_stable_platoon(self) -> None:
        platoon = stability_report([CALM] * 5).platoon
        verdicts = (platoon.l2_strict, platoon.l2_weak, platoon.linf_strict, platoon.linf_weak)
        assert all(verdict.stable and not verdict.marginal for verdict in verdicts)
        np.testing.assert_allclose(platoon.linf.gain, 1, atol=1e-9)

    def test_behind_one_that_does_not_react_nothing_moves(self) -> None:
        platoon = stability_report([AUDI, Parameters(0.0, 0.0, nan), AUDI]).platoon
        assert [peak.gain for peak in platoon.peaks[1:]] == [0, 0]
        np.testing.assert_array_equal(platoon.linf.gain[1:], 0)
        assert platoon.peaks[0].gain > 1

    def test_behind_an_undamped_one_nothing_is_bounded(self) -> None:
        platoon = stability_report([AUDI, Parameters(0.25, 0.0, 0.0), CALM]).platoon
        assert [peak.gain for peak in platoon.peaks[1:]] == [inf, inf]
        assert platoon.peaks[2].omega == 0.5
        assert "without limit" in platoon.l2_weak.reason

    def test_an_oscillation_that_outlasts_the_samples_is_said(self) -> None:
        platoon = stability_report([Parameters(1.0, 0.001, 0.001), AUDI]).platoon
        assert isnan(platoon.linf.gain[1])
        assert platoon.linf.gain[0] > 600

    def test_time_scales_too_far_apart_are_said(self) -> None:
        platoon = stability_report(
            [Parameters(1e-12, 1.0, 0.1), Parameters(1e8, 1.0, 1e-5)]
        ).platoon
        assert isnan(platoon.linf.gain[1])
        assert "time scales" in platoon.linf_weak.reason
        assert platoon.linf_weak.marginal


class TestResponse:
    def test_agrees_with_python_control(self) -> None:
        omega = np.geomspace(1e-3, 10, 50)
        ours = response([AUDI, TESLA], omega)
        assert ours.shape == (2, 50)
        for law, row_ in zip((AUDI, TESLA), ours, strict=True):
            np.testing.assert_allclose(row_, transfer_function(law)(1j * omega), rtol=1e-12)

    def test_an_export_is_a_transfer_function_with_unit_gain_at_rest(self) -> None:
        import control

        exported = transfer_function(TESLA)
        assert isinstance(exported, control.TransferFunction)
        assert exported.dcgain() == pytest.approx(1)
        np.testing.assert_allclose(
            sorted(exported.poles().real), sorted(pole.real for pole in of(TESLA).poles)
        )
        assert exported.zeros()[0].real == pytest.approx(of(TESLA).zero)


class TestMaps:
    def test_boundaries_are_the_smallest_headways(self) -> None:
        beta, alpha = np.linspace(0, 1, 7), np.linspace(0.01, 0.3, 5)
        over_beta = boundaries_over_beta(0.07, beta)
        over_alpha = boundaries_over_alpha(0.2, alpha)
        for k, value in enumerate(beta):
            smallest = of(Parameters(0.07, float(value), 1.0)).smallest_tau
            assert smallest is not None
            assert over_beta.l2[k] == smallest.l2
            assert over_beta.linf_paper[k] == smallest.linf_paper
            assert over_beta.linf_exact[k] == smallest.linf_exact
        for k, value in enumerate(alpha):
            smallest = of(Parameters(float(value), 0.2, 1.0)).smallest_tau
            assert smallest is not None
            assert over_alpha.l2[k] == smallest.l2
            assert over_alpha.linf_exact[k] == smallest.linf_exact

    def test_the_exact_boundary_lies_above_both_others(self) -> None:
        found = boundaries_over_beta(0.07, np.linspace(0, 2, 201))
        assert (found.linf_exact >= found.l2).all()
        assert (found.linf_exact >= found.linf_paper).all()
        assert (found.linf_exact > found.linf_paper + 0.1).any()

    def test_gains_are_those_of_the_vehicles(self) -> None:
        tau = np.array([0.5, 1.5, 4.0])
        alpha, beta = np.array([0.05, 0.1]), np.array([0.0, 0.3, 0.6, 0.9])
        over_beta, over_alpha = gains_over_beta(0.07, beta, tau), gains_over_alpha(0.2, alpha, tau)
        assert over_beta.peak_db.shape == (3, 4)
        assert over_alpha.linf_gain.shape == (3, 2)
        one = of(Parameters(0.07, 0.3, 1.5))
        assert over_beta.peak_db[1, 1] == pytest.approx(one.peak.db, rel=1e-12)
        assert over_beta.linf_gain[1, 1] == pytest.approx(one.linf_gain, rel=1e-12)
        other = of(Parameters(0.1, 0.2, 4.0))
        assert over_alpha.linf_gain[2, 1] == pytest.approx(other.linf_gain, rel=1e-12)

    def test_start_at_zero_and_refuse_less(self) -> None:
        found = boundaries_over_alpha(0.5, np.array([0.0, 0.1]))
        assert found.l2[0] == pytest.approx(1 / 0.5)
        assert found.linf_exact[0] == pytest.approx(1 / 0.5)
        with pytest.raises(ParameterError):
            boundaries_over_alpha(0.5, np.array([-0.1, 0.1]))


def test_laws_broadcast() -> None:
    grid = Laws(np.array(0.07), np.linspace(0, 1, 4), np.linspace(0, 3, 5)[:, None])
    assert step_metrics(grid).gain.shape == (5, 4)


def test_ten_vehicles_are_reported_within_fifty_milliseconds() -> None:
    ten = [reference.law for reference in TABLE]
    stability_report(ten)
    seconds = []
    for _ in range(5):
        start = time.perf_counter()
        stability_report(ten)
        seconds.append(time.perf_counter() - start)
    assert min(seconds) < 0.05


@pytest.mark.parametrize(("gain", "said"), [(1.4, "1.40"), (12.0, "12.0"), (123.4, "123")])
def test_a_factor_keeps_its_digits(gain: float, said: str) -> None:
    assert factor(gain) == said
