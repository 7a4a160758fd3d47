"""The frequency laboratory: one frequency in the response and in the platoon, however chosen."""

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from accpinn import Parameters, stability_report
from accpinn.inference.gain_check import GainCheck
from accpinn.inference.intervals import from_draws
from accpinn.model.published import ASTAZERO, ParameterSet
from accpinn.results.figures.laboratory import MARK, MOST_GROWTH
from accpinn.results.figures.stability import WHOLE
from accpinn.results.messages.stability import most_amplifying
from accpinn.results.vehicles import KnownVehicles
from pages.ui.components.parameter_picker import ROWS
from pages.ui.laboratory import FOLLOWERS, PAPER_FREQUENCIES, nearest, take_click
from pages.ui.session import sessions
from tests.support.apptest import Page, fitted, numbers, open_page, with_example
from tests.support.vehicles import CALM, UNDAMPED, row

pytestmark = pytest.mark.usefixtures("fresh_server")

PEAKS = [vehicle.peak for vehicle in stability_report(ASTAZERO.parameters).vehicles]
SLIDER, PLATOON = "laboratory_frequency", "laboratory_platoon"


def response(vehicles: Parameters, omega: float) -> NDArray[np.complex128]:
    """(V,) H(jω) as the paper writes it."""
    s, alpha, beta, tau = 1j * omega, vehicles.alpha, vehicles.beta, vehicles.tau
    return np.asarray((beta * s + alpha) / (s**2 + (alpha * tau + beta) * s + alpha))


def traces(figure: dict[str, Any]) -> dict[str, dict[str, Any]]:
    return {trace["name"]: trace for trace in figure["data"] if trace.get("name")}


def shown_frequency(page: Page) -> float:
    """The frequency in rad/s that the response has marked and the leader drives."""
    curves, waves, *_ = page.figures()
    (omega,) = {*numbers(traces(curves)[MARK]["x"]).tolist()}
    leader = traces(waves)["Leader"]
    time = numbers(leader["x"]).astype(float)
    np.testing.assert_allclose(numbers(leader["y"]), np.sin(omega * time), atol=1e-4)
    assert any(shape.get("x0") == omega == shape.get("x1") for shape in curves["layout"]["shapes"])
    assert page.widget(SLIDER).value == omega
    return float(omega)


def follows(page: Page, vehicles: Parameters, names: list[str]) -> None:
    """Check that the waves are the steady motion of these vehicles, in this order."""
    omega, waves = shown_frequency(page), traces(page.figures()[1])
    assert {*waves} == {"Leader", *names}
    chain = np.cumprod(response(vehicles, omega))
    for at, name in zip(chain, names, strict=True):
        time, speed = (numbers(waves[name][axis]).astype(float) for axis in "xy")
        exact = abs(at) * np.sin(omega * time + np.angle(at))
        np.testing.assert_allclose(speed, exact, atol=1e-4 * max(1, abs(at)))


def test_slider_and_chips_drive_both_charts() -> None:
    page = open_page("Stability", with_example())
    assert shown_frequency(page) == pytest.approx(PEAKS[0].omega, rel=1e-3), "Audi amplifies most"
    for at, omega in enumerate(PAPER_FREQUENCIES):
        assert shown_frequency(page.press(f"laboratory_chip_{at}")) == omega
    assert shown_frequency(page.press("laboratory_chip_2")) == pytest.approx(
        PEAKS[0].omega, rel=1e-3
    )
    offered = page.widget(SLIDER).options
    chosen = float(offered[len(offered) // 3].split()[0])
    assert shown_frequency(page.choose(SLIDER, chosen)) == chosen
    ends = [float(offered[k].split()[0]) for k in (0, -1)]
    assert (ends[0], ends[1]) == (0.02, 1.0)
    assert np.diff(np.log([float(text.split()[0]) for text in offered])).max() < 0.015


def test_one_car_is_repeated_or_all_drive_in_order() -> None:
    page, cars = open_page("Stability", with_example()), ASTAZERO.parameters
    names = [f"Follower {place}: Audi A6" for place in range(1, FOLLOWERS + 1)]
    follows(page, cars[[0] * FOLLOWERS], names)
    page.choose(PLATOON, 3)
    assert shown_frequency(page) == pytest.approx(PEAKS[3].omega, rel=1e-3), "its own peak"
    follows(
        page, cars[[3] * FOLLOWERS], [name.replace("Audi A6", "Tesla Model 3") for name in names]
    )
    page.choose(SLIDER, 0.3)
    assert shown_frequency(page.choose(PLATOON, 1)) == 0.3, "a frequency that was chosen is kept"
    follows(page.choose(PLATOON, WHOLE), cars, [*ASTAZERO.labels])


def test_values_at_the_mark_are_those_of_the_response() -> None:
    page = open_page("Stability", with_example()).press("laboratory_chip_0")
    single = response(ASTAZERO.parameters, 0.25)
    mark = traces(page.figures()[0])[MARK]
    levels = 20 * np.log10(np.abs(single))
    np.testing.assert_allclose(numbers(mark["y"]), [*levels, levels.sum()], atol=1e-9)
    assert mark["customdata"] == [0, 1, 2, 3, WHOLE]
    page.choose("laboratory_part", "phase")
    angles = np.degrees(np.angle(single))  # none is beyond -180° at this frequency
    curves = traces(page.figures()[0])
    np.testing.assert_allclose(numbers(curves[MARK]["y"]), [*angles, angles.sum()], atol=1e-6)
    whole = curves["Leader to last follower"]
    steps = np.diff(numbers(whole["y"]))
    assert np.abs(steps).max() < 30, "the phase has no jumps"
    assert numbers(whole["y"])[-1] == pytest.approx(
        np.degrees(np.angle(response(ASTAZERO.parameters, 1.0))).sum(), abs=1e-3
    )


def test_a_click_chooses_a_frequency_and_a_vehicle() -> None:
    page = open_page("Stability", with_example())
    session, offered = page.workspace(), (0.1, 0.3, 1.0)
    take_click(session, {"selection": {"points": []}}, offered)
    assert not {SLIDER, PLATOON} & {*session.choices}
    for data, vehicle in ((2, 2), ([3], 3), (-1, WHOLE), (None, WHOLE)):  # None: a measured gain
        point = {"x": 0.29, "y": 1.0, "customdata": data}
        take_click(session, {"selection": {"points": [point]}}, offered)
        assert (session.choices[SLIDER], session.choices[PLATOON]) == (0.3, vehicle)
    assert shown_frequency(page.run()) == 0.3
    follows(page, ASTAZERO.parameters, [*ASTAZERO.labels])
    assert nearest(1e-9, offered) == 0.1


def test_waves_keep_their_scale_over_frequencies() -> None:
    page = open_page("Stability", with_example()).choose(PLATOON, 2)
    tops = {
        page.press(f"laboratory_chip_{at}").figures()[1]["layout"]["yaxis"]["range"][1]
        for at in (0, 1, 2)
    }
    assert len(tops) == 1
    page.choose(PLATOON, 0)
    low, high = (
        page.press(f"laboratory_chip_{at}").figures()[1]["layout"]["yaxis"]["range"][1]
        for at in (1, 2)
    )
    assert PEAKS[0].gain ** FOLLOWERS > MOST_GROWTH
    assert low < PEAKS[0].gain ** FOLLOWERS < high, "what grows more has the scale that it needs"


def test_a_car_that_never_settles_has_no_waves() -> None:
    session = sessions.workspaces().new()
    session.chosen_source = "hand"
    undamped, calm = (float(UNDAMPED.alpha), 0.0, 0.0), (CALM.alpha, CALM.beta, CALM.tau)
    session.choices[ROWS] = (("odd", *undamped), ("calm", *map(float, calm)))
    page = open_page("Stability", session).choose(PLATOON, WHOLE)
    assert {*traces(page.figures()[1])} == {"Leader"}
    assert any("odd never settles" in one["text"] for one in
               page.figures()[1]["layout"]["annotations"])  # fmt: skip
    assert {*traces(page.choose(PLATOON, 1).figures()[1])} > {"Leader"}


def test_bands_and_the_sentence_come_from_the_posterior() -> None:
    session = fitted()
    page = open_page("Stability", session).choose("laboratory_part", "phase")
    label = session.segment.labels
    assert sum(name.startswith("band ") for name in traces(page.figures()[0])) == len(label) - 1
    page.choose("stability_uncertainty", False)
    assert not any(name.startswith("band ") for name in traces(page.figures()[0]))


@pytest.mark.parametrize(
    ("vehicles", "parts"),
    [
        (ASTAZERO, ("All four", "Audi A6", "51 %")),
        (ParameterSet("Mine", ("wild", "calm"), row(Parameters(0.08, 0.12, 1.5), CALM)),
         ("Wild amplifies most", "38 %")),
        (ParameterSet("Mine", ("quiet", "calm"), row(CALM, CALM)), ("Both", "damp")),
        (ParameterSet("Mine", ("odd",), row(UNDAMPED)), ("Odd", "without limit")),
    ],
)  # fmt: skip
def test_one_short_sentence_names_who_amplifies_most(
    vehicles: ParameterSet, parts: tuple[str, ...]
) -> None:
    sentence = most_amplifying(KnownVehicles(vehicles))
    assert all(part in sentence for part in parts), sentence
    assert len(sentence.split()) <= 20


def test_the_sentence_is_the_models_where_the_measured_gain_contradicts_it() -> None:
    audi, tesla = (GainCheck(number, 20, contradiction="damps") for number in (2, 5))
    assert most_amplifying(KnownVehicles(ASTAZERO, checks=(tesla,))).startswith("All four")
    assert most_amplifying(KnownVehicles(ASTAZERO, checks=(audi, tesla))).startswith("By the model")


def test_a_vehicle_that_may_amplify_is_not_said_to() -> None:
    pair = ParameterSet("Mine", ("wild", "calm"), row(Parameters(0.08, 0.12, 1.5), CALM))
    draws = np.tile(pair.parameters.values, (100, 1, 1))
    draws[:40, 0, 2] = 4.0  # stable in 40 % of them
    known = from_draws(pair.parameters, Parameters.of(draws), 0.9)
    assert most_amplifying(KnownVehicles(pair, known)).startswith("Wild may amplify")
