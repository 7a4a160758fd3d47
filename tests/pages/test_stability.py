"""The pages Stability and Platoon without a browser: answers, sources, controls, refusals."""

from contextlib import suppress
from dataclasses import replace
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as some
from streamlit.testing.v1 import AppTest

from accpinn.errors import ParameterError
from accpinn.methods import least_squares
from accpinn.methods.fit import Outcome
from accpinn.methods.pinn.config import FAST
from accpinn.model.cthp import Parameters
from accpinn.model.published import ASTAZERO, CASALE
from accpinn.recordings.recording import Window
from accpinn.results.messages.stability import AFTER_COLLISION, reason
from accpinn.results.snapshot.create import create
from accpinn.stability.report import stability_report
from accpinn.tasks.estimations import training
from accpinn.tasks.request import TrainingRequest
from pages.ui.platoon.controls import parse_order
from pages.ui.session.resources import library
from pages.ui.session.workspace import Workspace
from pages.ui.stability.charts import clicked_point
from tests.support.apptest import (
    PLATOON,
    STABILITY,
    boxes,
    figures,
    open_page,
    plain,
    texts,
    with_sample,
    workspace_of,
)

pytestmark = pytest.mark.usefixtures("fresh_server")

CALM = Parameters(0.05, 0.6, 1.8)


def fitted(window: Window | None = None, **changes: Any) -> Workspace:
    """A session whose training is done; its fit stands in for a network's."""
    found = with_sample()
    found.choose(window=window, vehicles=(2, 3, 4, 5))
    assert found.segment
    fit = replace(least_squares.fit(found.segment, "II"), **changes)
    task = training(found.id, TrainingRequest(found.segment, "II", FAST))
    task.answer(fit)
    found.training = task
    return found


def choose(page: AppTest, key: str, value: object) -> AppTest:
    """Set the widget of that key, whatever kind it is, and run."""
    for kind in ("button_group", "selectbox", "number_input", "text_input", "toggle"):
        for widget in page.get(kind):
            if widget.key == key:
                widget.set_value(value).run()
                assert not page.exception, page.exception
                return page
    raise AssertionError(f"no widget {key}")


def press(page: AppTest, key: str) -> AppTest:
    page.button(key=key).click().run()
    assert not page.exception, page.exception
    return page


# Stability


def test_stability_answers_before_anything_was_trained() -> None:
    page = open_page(STABILITY)
    said = plain(page)
    assert "All four vehicles amplify disturbances, Audi A6 the most: up to 1.51 times" in said
    assert "L₂ **NO**, L∞ **NO**" in said
    assert len(page.get("plotly_chart")) == 3


def test_the_papers_yes_and_the_exact_no_catch_the_eye() -> None:
    page = open_page(STABILITY)
    (warning,) = boxes(page, "warning")
    assert "Tesla Model 3" in warning
    assert "necessary but not sufficient" in warning
    assert "1.095" in warning
    page = choose(page, "stability_example", CASALE.title)
    assert not page.warning
    assert "Hyundai amplifies disturbances up to 1.49 times at 0.0879 rad/s" in plain(page)


def test_every_verdict_has_its_sentence() -> None:
    (why,) = (e for e in open_page(STABILITY).expander if e.label.startswith("Reasons"))
    said = "\n".join(element.value for element in why.markdown).replace("\\", "")
    for vehicle in stability_report(ASTAZERO.parameters).vehicles:
        for verdict in (vehicle.l2, vehicle.linf_paper, vehicle.linf_exact):
            assert reason(verdict, vehicle) in said


def test_stability_shows_the_fit_once_there_is_one() -> None:
    found = fitted()
    page = open_page(STABILITY, found)
    assert found.segment
    html = plain(page)
    for label in found.segment.labels[1:]:
        assert label in html
    # Vehicle 3 keeps the colour it has on the other pages.
    curves = [trace for trace in figures(page)[0]["data"] if "line" in trace]
    assert curves[0]["line"]["color"] == "#d8660c"
    choose(page, "stability_source", "published")
    assert "Audi A6" in plain(page)
    choose(page, "stability_source", "fit")
    assert "Audi A6 " not in plain(page)


@pytest.mark.parametrize("path", [STABILITY, PLATOON])
def test_a_stopped_training_is_no_result(path: str) -> None:
    stopped = {"outcome": Outcome.STOPPED, "iterations": 930, "config": {"iterations": 20_000}}
    page = open_page(path, fitted(**stopped))
    assert "stopped at 930 of 20,000 iterations" in boxes(page, "warning")[0]
    choose(page, f"{path[8:].lower()[:-3]}_source", "published")
    assert "stopped at" not in plain(page)


def test_a_stopped_training_is_no_result_in_a_snapshot_either() -> None:
    found = fitted(outcome=Outcome.STOPPED, iterations=930)
    assert found.segment
    assert found.fit
    library().add(create(found.segment, found.fit, name="early"))
    page = choose(open_page(STABILITY), "stability_source", "snapshot")
    assert "stopped at 930 iterations" in boxes(page, "warning")[0]


@pytest.mark.parametrize("path", [STABILITY, PLATOON])
def test_excluded_regimes_are_named(path: str) -> None:
    found = fitted()
    assert found.segment
    assert "without catching up" not in plain(open_page(path, found))
    found.segment = replace(found.segment, excluded_regimes=("catching up",))
    page = open_page(path, found)
    assert "without catching up" in " ".join(caption.value for caption in page.caption)
    if path == STABILITY:
        assert (
            "String stability, synthetic_astazero_like.csv, 0–300 s, without catching up"
            in plain(page)
        )


def test_published_parameters_do_not_pass_for_ones_own_while_training_runs() -> None:
    found = fitted()
    assert found.training
    assert found.training.request
    found.training = training(found.id, found.training.request)  # waits
    page = open_page(STABILITY, found)
    assert any("your own training is not finished" in info for info in boxes(page, "info"))
    found.parameter_choice.source = "published"
    assert not open_page(STABILITY, found).info, "then they were asked for"


def test_the_answer_has_its_certainty_with_and_without_the_bands() -> None:
    page = open_page(STABILITY, fitted())
    for _ in range(2):
        assert "Peak gain of the estimate" in plain(page)
        if page.toggle(key="stability_uncertainty").value:
            choose(page, "stability_uncertainty", False)
    headline = next(m.value for m in page.markdown if m.value.startswith("####"))
    assert "vehicle 3" in headline, "two Hyundai are not “2 Hyundai”"
    choose(page, "stability_source", "published")
    assert "Peak gain of the estimate" not in plain(page)


def test_a_lost_fit_gives_way_to_the_example() -> None:
    found = fitted()
    page = choose(open_page(STABILITY, found), "stability_source", "fit")
    found.choose(window=Window(0.0, 100.0))
    page.run()
    assert not page.exception
    assert "Audi A6 the most" in plain(page)


def test_by_hand_begins_with_what_was_shown_and_is_kept_over_pages() -> None:
    page = choose(open_page(STABILITY), "stability_example", CASALE.title)
    choose(page, "stability_source", "hand")
    found = workspace_of(page)
    assert found.parameter_choice.rows == (("Hyundai", 0.0104, 0.0718, 1.52),)
    assert "Hyundai amplifies disturbances" in plain(page)
    found.parameter_choice.rows = (("calm", CALM.alpha, CALM.beta, CALM.tau), ("", 0.08, 0.12, 1.5))
    again = open_page(STABILITY, found)
    assert "One of two vehicles amplifies disturbances: Vehicle 2" in plain(again)
    other = open_page(PLATOON, found)
    assert "Follower 2: Vehicle 2" in plain(other)


@pytest.mark.parametrize(
    ("row", "sentence"),
    [
        (("A", None, 0.1, 1.0), "Parameter set 1: α is missing"),
        (("A", 0.1, -0.1, 1.0), "β = -0.1 is negative"),
        (("A", 1e60, 0.1, 1.0), "is beyond any vehicle"),
    ],
)
@pytest.mark.parametrize("path", [STABILITY, PLATOON])
def test_bad_values_by_hand_are_refused_in_one_sentence(
    path: str, row: tuple[Any, ...], sentence: str
) -> None:
    page = open_page(STABILITY)
    found = workspace_of(page)
    found.parameter_choice.source, found.parameter_choice.rows = "hand", (row,)
    (error,) = boxes(open_page(path, found), "error")
    assert sentence in error


def test_an_empty_table_by_hand_is_refused() -> None:
    found = workspace_of(open_page(STABILITY))
    found.parameter_choice.source, found.parameter_choice.rows = "hand", ()
    (error,) = boxes(open_page(STABILITY, found), "error")
    assert "0 vehicles; give at least one" in error


def test_names_by_hand_are_shown_as_they_are() -> None:
    found = workspace_of(open_page(STABILITY))
    found.parameter_choice.source = "hand"
    found.parameter_choice.rows = (
        ("<script>*x*</script>", 0.08, 0.12, 1.5),
        ("$a_b$", 0.08, 0.12, 1.5),
    )
    for path in (STABILITY, PLATOON):
        said = texts(open_page(path, found))
        assert "<script>" not in said.replace("\\<script", "")
        assert "$a_b$" not in "\n".join(m.value for m in open_page(path, found).markdown)


def test_the_map_can_be_turned() -> None:
    page = open_page(STABILITY)
    assert figures(page)[2]["layout"]["xaxis"]["title"]["text"].startswith("β")
    choose(page, "stability_plane", "alpha")
    choose(page, "stability_held", 1)
    assert figures(page)[2]["layout"]["xaxis"]["title"]["text"].startswith("α")
    assert "BMW X5's β" in plain(page)
    choose(page, "stability_example", CASALE.title)
    assert "Hyundai's β" in plain(page)


# From one page to the other


def test_a_peak_goes_to_the_platoon_page() -> None:
    page = press(open_page(STABILITY), "stability_peak_1")
    drive = workspace_of(page).platoon_choice
    assert (drive.order, drive.vehicle, drive.kind) == ("repeated", 1, "sinusoid")
    assert drive.omega == pytest.approx(0.2657, abs=1e-4)
    other = open_page(PLATOON, workspace_of(page))
    assert other.number_input(key="platoon_frequency").value == drive.omega
    assert "Follower 8: BMW X5" in plain(other)


def test_the_whole_platoons_peak_drives_all_in_order() -> None:
    page = press(open_page(STABILITY), "stability_peak_-1")
    drive = workspace_of(page).platoon_choice
    assert drive.order == "learned"
    assert drive.omega == pytest.approx(0.2189, abs=1e-4)


def test_a_click_is_a_frequency_and_a_vehicle() -> None:
    assert clicked_point([]) is None
    assert clicked_point([{"x": 0.3, "y": 1.0, "customdata": 2}]) == (0.3, 2)
    assert clicked_point([{"x": 0.3, "y": 1.0, "customdata": [2]}]) == (0.3, 2)
    assert clicked_point([{"x": 0.3, "y": 1.0, "customdata": -1}]) == (0.3, -1)


# Platoon


def test_the_platoon_drives_before_anything_was_trained() -> None:
    page = open_page(PLATOON)
    assert page.number_input(key="platoon_frequency").value == pytest.approx(0.2189)
    assert "The oscillation grows to 2.44 times the leader's" in plain(page)
    assert "By |H| the last follower reaches 2.44 m/s." in plain(page)
    assert len(page.get("plotly_chart")) == 4


def test_eight_times_one_vehicle_as_in_the_paper() -> None:
    page = choose(open_page(PLATOON), "platoon_order", "repeated")
    choose(page, "platoon_vehicle", 2)
    choose(page, "platoon_frequency", 0.25)
    gain = 4.233  # |H(0.25j)| of AstaZero's vehicle 3 to the eighth power
    assert f"grows to {gain:.3g} times" in plain(page)
    choose(page, "platoon_followers", 3)
    assert "Follower 3: Mercedes A-Class" in plain(page)
    assert "Follower 4: Mercedes A-Class" not in plain(page)
    assert "grows to 1.72 times" in plain(page)


def test_the_frequency_follows_the_vehicle_until_one_is_given() -> None:
    page = choose(open_page(PLATOON), "platoon_order", "repeated")
    assert page.number_input(key="platoon_frequency").value == pytest.approx(0.214, abs=1e-4)
    choose(page, "platoon_vehicle", 3)
    assert page.number_input(key="platoon_frequency").value == pytest.approx(0.1059, abs=1e-4)
    choose(page, "platoon_frequency", 0.3)
    choose(page, "platoon_vehicle", 0)
    assert page.number_input(key="platoon_frequency").value == 0.3
    press(page, "platoon_peak")
    assert page.number_input(key="platoon_frequency").value == pytest.approx(0.214, abs=1e-4)


def test_an_order_of_ones_own() -> None:
    page = choose(open_page(PLATOON), "platoon_order", "own")
    assert "Follower 8: Tesla Model 3" in plain(page), "twice in order to begin with"
    choose(page, "platoon_own", "4, 1-2")
    for name in ("1: Tesla Model 3", "2: Audi A6", "3: BMW X5"):
        assert name in plain(page)
    choose(page, "platoon_own", "5")
    assert "there is no vehicle 5; give numbers from 1 to 4" in boxes(page, "error")[0]
    assert not page.get("plotly_chart")


@pytest.mark.parametrize(
    ("text", "order"),
    [("1", [0]), ("1-3", [0, 1, 2]), ("3-1, 2", [2, 1, 0, 1]), ("2 2,2", [1, 1, 1]),
     (" 1 – 2 ,, 3 ", [0, 1, 2])],
)  # fmt: skip
def test_orders_are_numbers_and_ranges(text: str, order: list[int]) -> None:
    assert parse_order(text, 3) == order


@pytest.mark.parametrize(
    ("text", "fault"),
    [("", "there are 0"), ("a", "“a” is not a number"), ("0", "no vehicle 0"), ("1-9", "1-9"),
     ("1,-1", "is not a number"), ("1 " * 21, "there are 21")],
)  # fmt: skip
def test_other_orders_are_refused(text: str, fault: str) -> None:
    with pytest.raises(ParameterError, match="Order of followers: ") as refusal:
        parse_order(text, 3)
    assert fault in str(refusal.value)


@given(some.text(max_size=30), some.integers(1, 12))
def test_any_text_is_an_order_or_a_sentence(text: str, count: int) -> None:
    with suppress(ParameterError):
        order = parse_order(text, count)
        assert order
        assert all(0 <= k < count for k in order)


@pytest.mark.parametrize(("kind", "plenty"), [("step", "step_change"), ("brake", "brake_drop")])
def test_steps_and_brakes(kind: str, plenty: str) -> None:
    page = choose(open_page(PLATOON), "platoon_kind", kind)
    assert "The largest speed deviation grows to" in plain(page)
    assert "The smallest gap is" in plain(page)
    choose(page, f"platoon_{plenty}", 20.0 if kind == "brake" else -20.0)
    assert AFTER_COLLISION in plain(page)
    assert not any("collides" in warning for warning in boxes(page, "warning")), "it is named once"
    assert "times as much as the leader's, until follower 1 collides at" in plain(page)
    assert "Only up to the collision." in plain(page)
    assert ", until the collision." in plain(page)


def test_settings_that_make_no_sense_are_refused_and_kept_for_mending() -> None:
    page = choose(open_page(PLATOON), "platoon_sinusoid_duration", -5.0)
    (error,) = boxes(page, "error")
    assert "Leader: duration = -5" in error
    assert page.number_input(key="platoon_sinusoid_duration").value == -5.0
    choose(page, "platoon_sinusoid_duration", 400.0)
    assert not page.error
    choose(page, "platoon_frequency", 0.0)
    assert "frequency" in boxes(page, "error")[0]


def test_a_transient_that_is_not_over_is_said() -> None:
    page = choose(open_page(PLATOON), "platoon_sinusoid_duration", 60.0)
    assert any("transient" in warning for warning in boxes(page, "warning"))
    choose(page, "platoon_sinusoid_duration", 30.0)
    assert any("too short" in warning for warning in boxes(page, "warning"))


def test_the_recorded_leader_is_offered_with_a_recording_only() -> None:
    found = fitted()
    page = choose(open_page(PLATOON, found), "platoon_kind", "recorded")
    assert "as recorded" in plain(page)
    assert "largest speed deviation" in plain(page)
    alone = open_page(PLATOON)
    assert alone.selectbox(key="platoon_kind").options == ["Sinusoid", "Step", "Brake"]


def test_captions_say_which_part_of_the_run_is_shown() -> None:
    said = plain(open_page(PLATOON))
    assert "From 6 to 235 s of 500 s." in said
    assert "From 443 to 500 s of 500 s." in said
    assert "All 500 s." not in said
    brief = plain(choose(open_page(PLATOON), "platoon_sinusoid_duration", 30.0))
    assert "From 6 to 30 s of 30 s." in brief


def test_amplitudes_in_db() -> None:
    page = open_page(PLATOON)
    assert "[m/s]" in figures(page)[1]["layout"]["yaxis"]["title"]["text"]
    choose(page, "platoon_db", True)
    assert "[dB re leader]" in figures(page)[1]["layout"]["yaxis"]["title"]["text"]


def test_the_papers_panels_and_back() -> None:
    page = press(open_page(PLATOON), "platoon_panels")
    said = plain(page)
    assert "(a) Mercedes A-Class at 0.25 rad/s: grows to 4.2" in said
    assert "(d) Tesla Model 3 at 0.3 rad/s: fades to 0.42" in said
    assert len(page.get("plotly_chart")) == 4
    press(page, "platoon_back")
    assert len(page.get("plotly_chart")) == 4


def test_other_vehicles_begin_without_what_was_chosen_among_the_former() -> None:
    page = choose(open_page(PLATOON), "platoon_order", "repeated")
    choose(page, "platoon_vehicle", 3)
    choose(page, "platoon_frequency", 0.3)
    choose(page, "platoon_example", CASALE.title)
    assert page.number_input(key="platoon_frequency").value == pytest.approx(0.0879, abs=1e-4)
    assert "Follower 8: Hyundai" in plain(page)
