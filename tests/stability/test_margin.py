"""Margins: closed forms, the report's verdicts on either side, what no time gap mends, draws."""

from math import inf, isinf, isnan, nan

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from accpinn import Parameters, stability_report
from accpinn.model.published import ASTAZERO
from accpinn.stability.criteria import exact_margin, l2_margin
from accpinn.stability.margin import State, l2_headways, linf_headways, margins
from accpinn.units import FloatArray
from tests.support.vehicles import AUDI, CALM, NO_REACTION, TESLA, row

NEAR = 1e-5
"""Relative distance from a boundary at which verdicts are asked for."""


def drawn(count: int, seed: int, lag: float = 0.0, delay: float = 0.0) -> Parameters:
    """Vehicles of all kinds, from calm ones to those that no time gap makes stable."""
    low = np.array([0.005, 0.0, 0.0, 0.0, 0.05 * (lag > 0), 0.05 * (delay > 0)])
    high = np.array([0.8, 1.5, 6.0, 0.0, lag, delay])
    return Parameters.of(np.random.default_rng(seed).uniform(low, high, (count, 6)))


def at_headway(vehicles: Parameters, tau: FloatArray) -> Parameters:
    rows = vehicles.complete.copy()
    rows[:, 2] = tau
    return Parameters.of(rows)


def test_the_margin_of_the_cthp_is_that_of_the_closed_forms() -> None:
    found = margins(ASTAZERO.parameters, 20.0)
    report = stability_report(ASTAZERO.parameters)
    for margin, vehicle, given_ in zip(
        found.vehicles, report.vehicles, ASTAZERO.parameters, strict=True
    ):
        assert margin.l2.distance.value == pytest.approx(given_.tau - vehicle.smallest_tau.l2)
        expected = given_.tau - vehicle.smallest_tau.linf_exact
        assert margin.linf.distance.value == pytest.approx(expected)
        assert margin.l2.state is State.TOO_SHORT
        assert isnan(margin.l2.distance.lower)


def test_the_intercept_counts_as_time_gap_at_the_speed() -> None:
    with_s0 = Parameters(AUDI.alpha, AUDI.beta, AUDI.tau, s0=5.0)
    (found,) = margins(with_s0, 20.0).vehicles
    (plain,) = margins(AUDI, 20.0).vehicles
    assert found.time_gap.value == pytest.approx(AUDI.tau + 0.25)
    assert found.l2.smallest.value == pytest.approx(plain.l2.smallest.value + 0.25)
    assert found.l2.distance.value == pytest.approx(plain.l2.distance.value)


@pytest.mark.parametrize(("lag", "delay"), [(0, 0), (2.0, 0), (0, 1.5), (0.8, 0.8)])
def test_verdicts_change_at_the_smallest_headway(lag: float, delay: float) -> None:
    vehicles = drawn(1000, 1, lag, delay)
    smallest, largest = l2_headways(vehicles)
    within = (vehicles.tau >= smallest) & (vehicles.tau <= largest)
    np.testing.assert_array_equal(within, l2_margin(vehicles) >= -1e-9)
    ends = np.isfinite(smallest) & (smallest > 1e-6)
    assert ends.sum() > 100
    assert bool(delay) == bool(np.isinf(smallest).any()), "a delay alone may leave none"
    some = vehicles[ends]
    for factor, is_stable in ((1 - NEAR, False), (1 + NEAR, True)):
        verdicts = l2_margin(at_headway(some, smallest[ends] * factor)) >= 0
        np.testing.assert_array_equal(verdicts, is_stable)


@settings(deadline=None, max_examples=40)
@given(
    st.floats(0.01, 0.5), st.floats(0.02, 1.0), st.floats(0.3, 3.0), st.floats(0.0, 1.0),
    st.floats(0.0, 1.2),
)  # fmt: skip
def test_the_sign_is_the_verdict_of_the_report(
    alpha: float, beta: float, tau: float, lag: float, delay: float
) -> None:
    lag, delay = (value if value > 0.02 else 0.0 for value in (lag, delay))
    vehicle = Parameters([alpha], [beta], [tau], 3.0, lag, delay)
    (found,), (said,) = margins(vehicle, 25.0).vehicles, stability_report(vehicle).vehicles
    if abs(found.l2.distance.value) > 1e-4:
        assert (found.l2.distance.value >= 0) == said.l2.stable
    if abs(found.linf.distance.value) > 0.02 and said.l2.stable:
        assert (found.linf.distance.value >= 0) == said.linf_exact.stable
    assert found.linf.smallest.value >= found.l2.smallest.value - 1e-9


def test_the_smallest_headway_for_peaks_is_that_of_a_search() -> None:
    vehicles = Parameters.of(
        np.concatenate([drawn(12, 3, delay=0.6).complete, drawn(12, 4, lag=0.6).complete])
    )
    l2 = l2_headways(vehicles)
    found = np.maximum(linf_headways(vehicles, l2), l2.smallest)
    for vehicle, tau, low, high in zip(vehicles, found, *l2, strict=True):
        if isinf(low):
            assert isinf(tau)
            continue
        tried = np.linspace(low, min(high, 25 * low), 400)
        stable = exact_margin(at_headway(Parameters.of([vehicle.everything] * 400), tried)) >= 0
        if stable.any():
            assert tau == pytest.approx(tried[stable.argmax()], abs=1.5 * (tried[1] - tried[0]))
        else:
            assert isinf(tau)


def test_what_no_time_gap_mends_is_a_state() -> None:
    slow, long = Parameters(0.1, 0.4, 1.2, delay=2.0), Parameters(1.74, 1.35, 6.5, delay=0.12)
    bare, late = Parameters(0.0, 0.3, nan), Parameters(0.0, 2.0, nan, delay=1.0)
    vehicles = row(slow, long, bare, late, CALM)
    found = margins(vehicles, 20.0).vehicles
    states = [vehicle.l2.state for vehicle in found]
    expected = [State.NEVER, State.TOO_LONG, State.NO_EFFECT, State.NEVER, State.STABLE]
    assert states == expected
    distances = [vehicle.l2.distance.value for vehicle in found]
    assert distances[:4] == [-inf, -inf, inf, -inf]
    assert isinf(found[0].l2.smallest.value)
    for vehicle, margin in zip(vehicles, found, strict=True):
        said = stability_report(vehicle[None]).vehicles[0]
        assert (margin.l2.distance.value >= 0) == said.l2.stable
    (unknown,) = margins(Parameters([nan], [nan], [nan]), 20.0).vehicles
    assert unknown.l2.state is unknown.linf.state is State.UNKNOWN


def test_gains_below_zero_have_no_time_gap_without_growing_peaks() -> None:
    (found,) = margins(Parameters([0.1], [-0.1], [1.0]), 20.0).vehicles
    assert found.linf.state is State.NEVER
    smallest = found.l2.smallest.value
    kappa = 0.1**2 * smallest**2 - 2 * 0.1 * 0.1 * smallest - 2 * 0.1
    assert kappa == pytest.approx(0.0, abs=1e-9)


@pytest.mark.parametrize("delay", [0.0, 0.4])
def test_intervals_are_those_of_the_draws(delay: float) -> None:
    rng = np.random.default_rng(2)
    centre = np.array([[*vehicle.values, 4.0, 0.0, delay] for vehicle in (AUDI, TESLA)])
    draws = Parameters.of(centre * np.exp(rng.normal(0, 0.1, (400, 2, 6))))
    found = margins(Parameters.of(centre), 20.0, draws, 0.9)
    assert found.level == 0.9
    for k, vehicle in enumerate(found.vehicles):
        car = draws[:, k]
        l2 = l2_headways(car)
        for norm, smallest in (("l2", l2.smallest), ("linf", linf_headways(car, l2))):
            of_draws = car.tau - smallest
            ends = np.quantile(of_draws, (0.05, 0.95))
            said = getattr(vehicle, norm).distance
            assert said.lower < said.value < said.upper
            width = said.upper - said.lower
            np.testing.assert_allclose((said.lower, said.upper), ends, atol=0.2 * width)
    assert found.platoon.lower < found.platoon.value < found.platoon.upper
    undetermined = draws.everything.copy()
    undetermined[:, 1] = nan
    partly = margins(Parameters.of(centre), 20.0, Parameters.of(undetermined))
    assert isnan(partly.vehicles[1].l2.distance.lower)
    assert not isnan(partly.vehicles[0].l2.distance.lower)


@pytest.mark.parametrize("delay", [0.0, 0.4])
def test_the_platoon_is_weakly_stable_from_its_margin_on(delay: float) -> None:
    rows = [[*vehicle.values, 0.0, 0.0, delay] for vehicle in (AUDI, CALM, TESLA)]
    platoon = margins(Parameters.of(rows), 20.0).platoon
    assert -5 < platoon.value < 5
    for excess, is_stable in ((-0.002, False), (0.002, True)):
        moved = np.array(rows)
        moved[:, 2] -= platoon.value - excess
        report = stability_report(Parameters.of(moved))
        assert report.platoon.l2_weak.stable is is_stable
    assert margins(AUDI, 20.0).platoon is None
    assert margins(row(NO_REACTION, NO_REACTION), 20.0).platoon.value == inf
    assert margins(row(NO_REACTION, AUDI), 20.0).platoon.value == inf


@pytest.mark.parametrize("tau", [1.2, 1.5, 2.5, 3.3, 3.6, 4.0])
def test_the_margin_of_two_equal_cars_is_that_of_each(tau: float) -> None:
    car = Parameters([0.3], [0.6], [tau], delay=0.6)
    (alone,) = margins(car, 20.0).vehicles
    together = margins(row(car, car), 20.0).platoon
    assert together.value == pytest.approx(alone.l2.distance.value, abs=2e-3)
    assert (alone.l2.state is State.TOO_LONG) == (tau > 3.4)


def test_a_platoon_has_a_margin_of_zero_or_more_exactly_where_it_is_weakly_stable() -> None:
    cars = drawn(100, 6, delay=0.8)
    found = []
    for pair in range(0, 100, 2):
        platoon = cars[pair : pair + 2]
        found.append(margins(platoon, 20.0).platoon.value)
        assert (found[-1] >= 0) == stability_report(platoon).platoon.l2_weak.stable, pair
    found = np.array(found)
    assert min((found == -inf).sum(), (found >= 0).sum(), np.isfinite(found[found < 0]).sum()) > 3


def test_margins_are_a_frame_and_lines() -> None:
    found = margins(ASTAZERO.parameters, 25.0, names=ASTAZERO.names, numbers=(2, 3, 4, 5))
    frame = found.to_frame()
    assert frame.vehicle.tolist() == [2, 3, 4, 5]
    assert (frame.margin_l2 < 0).all()
    assert frame.margin_l2_low.isna().all()
    assert set(frame.state_linf) == {"too_short"}
    assert len(str(found).splitlines()) == 1 + 4 + 2
