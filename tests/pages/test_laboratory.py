"""The frequency laboratory: one frequency in the response and in the platoon, however chosen."""

import json
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from accpinn import Parameters, stability_report
from accpinn.inference.gain_check import GainCheck
from accpinn.inference.intervals import from_draws
from accpinn.model.published import ASTAZERO, ParameterSet
from accpinn.results.figures.laboratory import CONDITION, MOST_GROWTH, response_curves
from accpinn.results.figures.stability import WHOLE, WHOLE_NAME
from accpinn.results.messages.stability import most_amplifying
from accpinn.study.vehicles import AssessedVehicles
from pages.ui.components.parameter_picker import ROWS
from pages.ui.laboratory import FOLLOWERS, PAPER_FREQUENCIES, nearest, take_click, take_frequency
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


def drawn(page: Page) -> dict[str, Any]:
    """What the browser draws the waves from."""
    (found,) = (
        component.proto.json
        for component in page.get("bidi_component")
        if component.proto.component_name == "accpinn_laboratory"
    )
    return dict(json.loads(found))


def shown_frequency(page: Page) -> float:
    """The frequency in rad/s that the slider stands at."""
    data = drawn(page)
    return float(data["omega"][data["index"]])


def leave_at(page: Page, omega: float) -> Page:
    """Leave the slider at the offered frequency next to that one."""
    take_frequency(page.workspace(), {"omega": nearest(omega, drawn(page)["omega"])})
    return page.sound()


def gains(data: dict[str, Any]) -> NDArray[np.complex128]:
    """(M, K) the gain of each follower in its order, nan where it never settles."""
    parts = np.array(data["gains"], float)
    return np.asarray((parts[:, 0] + 1j * parts[:, 1])[data["order"]])


def follows(page: Page, vehicles: Parameters, names: list[str]) -> None:
    """Check that the waves are those of these vehicles, in this order, at all frequencies."""
    data = drawn(page)
    assert data["names"] == ["Leader", *names]
    assert len(data["colours"]) == len(data["widths"]) == len(data["names"])
    exact = [response(vehicles, omega) for omega in data["omega"]]
    np.testing.assert_allclose(gains(data).T, exact, atol=1e-6)


def test_frequencies_on_offer_and_chips() -> None:
    page = open_page("Stability", with_example())
    assert shown_frequency(page) == pytest.approx(PEAKS[0].omega, rel=1e-3), "Audi amplifies most"
    data = drawn(page)
    offered, chips = data["omega"], {chip["name"]: chip["index"] for chip in data["chips"]}
    assert [offered[chips[f"{omega:g}"]] for omega in PAPER_FREQUENCIES] == [*PAPER_FREQUENCIES]
    assert offered[chips["Peak"]] == pytest.approx(PEAKS[0].omega, rel=1e-3)
    assert (offered[0], offered[-1]) == (0.02, 1.0)
    assert np.diff(np.log(offered)).max() < 0.015
    assert shown_frequency(leave_at(page, 0.3)) == 0.3
    take_frequency(page.workspace(), {"omega": None})
    assert shown_frequency(page.run()) == 0.3, "a trigger that has passed chooses nothing"


def test_one_car_is_repeated_or_all_drive_in_order() -> None:
    page, cars = open_page("Stability", with_example()), ASTAZERO.parameters
    names = [f"Follower {place}: Audi A6" for place in range(1, FOLLOWERS + 1)]
    follows(page, cars[[0] * FOLLOWERS], names)
    page.choose(PLATOON, 3)
    assert shown_frequency(page) == pytest.approx(PEAKS[3].omega, rel=1e-3), "its own peak"
    follows(
        page, cars[[3] * FOLLOWERS], [name.replace("Audi A6", "Tesla Model 3") for name in names]
    )
    leave_at(page, 0.3)
    assert shown_frequency(page.choose(PLATOON, 1)) == 0.3, "a frequency that was chosen is kept"
    follows(page.choose(PLATOON, WHOLE), cars, [*ASTAZERO.labels])


def test_values_at_the_mark_are_those_of_the_response() -> None:
    page = open_page("Stability", with_example())
    data, curves = drawn(page), traces(page.figures()[0])
    single = np.array([response(ASTAZERO.parameters, omega) for omega in data["omega"]])
    levels = 20 * np.log10(np.abs(single))
    assert [curve["name"] for curve in data["curves"]] == [*ASTAZERO.labels, WHOLE_NAME]
    for curve, exact in zip(data["curves"], [*levels.T, levels.sum(axis=1)], strict=True):
        np.testing.assert_allclose(curve["values"], exact, atol=1e-5)
        line = curves[curve["name"]]
        along = np.interp(np.log(data["omega"]), np.log(numbers(line["x"])), numbers(line["y"]))
        np.testing.assert_allclose(curve["values"], along, atol=0.03)
    page.choose("laboratory_part", "phase")
    at = data["omega"].index(0.25)  # none is beyond -180° there
    angles = np.degrees(np.angle(single[at]))
    phases = [curve["values"][at] for curve in drawn(page)["curves"]]
    np.testing.assert_allclose(phases, [*angles, angles.sum()], atol=1e-4)
    whole = traces(page.figures()[0])[WHOLE_NAME]
    steps = np.diff(numbers(whole["y"]))
    assert np.abs(steps).max() < 30, "the phase has no jumps"
    assert numbers(whole["y"])[-1] == pytest.approx(
        np.degrees(np.angle(response(ASTAZERO.parameters, 1.0))).sum(), abs=1e-3
    )


@pytest.mark.parametrize("delay", [0.0, 0.4])
def test_a_curve_passes_below_its_bar_where_the_papers_condition_is_met(delay: float) -> None:
    cars = Parameters([0.0409, 0.0612], [0.445, 0.12], [1.16, 1.19], delay=delay)
    report = stability_report(cars)
    subject = AssessedVehicles(ParameterSet("Mine", ("met", "not"), cars))
    figure = json.loads(response_curves(subject, "magnitude", 300).to_json())
    bars = [trace for trace in figure["data"] if trace.get("name") == CONDITION]
    plain = Parameters(cars.alpha, cars.beta, cars.tau)
    for bar, vehicle, single in zip(bars, report.vehicles, plain, strict=True):
        (omega, same), (limit, level) = numbers(bar["x"]), numbers(bar["y"])
        assert omega == same == pytest.approx(float(np.sqrt(single.alpha)), rel=1e-6)
        gain = 20 * np.log10(np.abs(response(single[None], omega)[0]))
        assert level == pytest.approx(gain, abs=1e-4), "the curve of α, β and τ"
        assert (level < limit) == vehicle.linf_paper.stable
    phase = response_curves(subject, "phase", 300)
    assert CONDITION not in [trace.name for trace in phase.data]


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


def test_the_scale_of_the_waves_is_the_largest_growth() -> None:
    page = open_page("Stability", with_example()).choose(PLATOON, 2)
    assert drawn(page)["growth"] == pytest.approx(PEAKS[2].gain ** FOLLOWERS, rel=1e-6)
    page.choose(PLATOON, 0)
    assert PEAKS[0].gain ** FOLLOWERS > MOST_GROWTH == drawn(page)["growth"]


def test_a_car_that_never_settles_has_no_waves() -> None:
    session = sessions.workspaces().new()
    session.chosen_source = "hand"
    undamped, calm = (float(UNDAMPED.alpha), 0.0, 0.0), (CALM.alpha, CALM.beta, CALM.tau)
    session.choices[ROWS] = (("odd", *undamped), ("calm", *map(float, calm)))
    page = open_page("Stability", session).choose(PLATOON, WHOLE)
    odd, other = gains(drawn(page))
    assert np.isnan(odd).all()
    assert np.isfinite(other).all()


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
    sentence = most_amplifying(AssessedVehicles(vehicles))
    assert all(part in sentence for part in parts), sentence
    assert len(sentence.split()) <= 20


def test_the_sentence_is_the_models_where_the_measured_gain_contradicts_it() -> None:
    audi, tesla = (GainCheck(number, 20, contradiction="damps") for number in (2, 5))
    assert most_amplifying(AssessedVehicles(ASTAZERO, checks=(tesla,))).startswith("All four")
    assert most_amplifying(AssessedVehicles(ASTAZERO, checks=(audi, tesla))).startswith(
        "By the model"
    )


def test_a_vehicle_that_may_amplify_is_not_said_to() -> None:
    pair = ParameterSet("Mine", ("wild", "calm"), row(Parameters(0.08, 0.12, 1.5), CALM))
    draws = np.tile(pair.parameters.values, (100, 1, 1))
    draws[:40, 0, 2] = 4.0  # stable in 40 % of them
    known = from_draws(pair.parameters, Parameters.of(draws), 0.9)
    assert most_amplifying(AssessedVehicles(pair, known)).startswith("Wild may amplify")
