"""The pages Stability and Platoon without a browser: answers, sources, controls, refusals."""

import math
from contextlib import suppress
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as some
from pages.ui.platoon.order import parse_order
from pages.ui.stability.certainty import certainty
from streamlit.testing.v1 import AppTest

from accpinn.errors import ParameterError
from accpinn.inference.intervals import Interval
from accpinn.methods import least_squares
from accpinn.methods.fit import Outcome
from accpinn.model.cthp import Parameters
from accpinn.model.published import ASTAZERO, CASALE, parameter_set
from accpinn.recordings.recording import Window
from accpinn.results.snapshot.create import create
from accpinn.stability.report import stability_report
from accpinn.tasks.task import Status
from pages.ui.session.resources import library
from pages.ui.session.workspace import Workspace
from pages.ui.stability.charts import clicked_point
from pages.ui.stability.views import headline
from tests.support.apptest import (
    PLATOON,
    STABILITY,
    figures,
    open_page,
    texts,
    with_sample,
    workspace_of,
)

pytestmark = pytest.mark.usefixtures("fresh_server")

CALM, LOUD = Parameters(0.05, 0.6, 1.8), Parameters(0.08, 0.12, 1.5)
UNDAMPED = Parameters(0.04, 0.0, 0.0)


def fitted(window: Window | None = None, **changes: Any) -> Workspace:
    """A session whose training is done; its fit stands in for a network's."""
    found = with_sample()
    found.choose(window=window, vehicles=(2, 3, 4, 5))
    assert found.segment
    fit = replace(least_squares.fit(found.segment, "II"), **changes)
    job: Any = SimpleNamespace(fit=fit, status=Status.DONE, is_active=False, stop=lambda: None)
    found.job = job
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


def errors(page: AppTest) -> list[str]:
    return [error.value.replace("\\", "") for error in page.error]


# Stability


def test_stability_answers_before_anything_was_trained() -> None:
    page = open_page(STABILITY)
    said = texts(page)
    assert "All four vehicles amplify disturbances, Audi A6 the most: up to 1.51 times" in said
    assert "L2 **NO**, L∞ **NO**" in said
    assert len(page.get("plotly_chart")) == 3


def test_the_papers_yes_and_the_exact_no_catch_the_eye() -> None:
    page = open_page(STABILITY)
    (warning,) = page.warning
    assert "Tesla Model 3" in warning.value
    assert "necessary but not sufficient" in warning.value
    assert "1\\.095 times" in warning.value
    page = choose(page, "stability_example", CASALE.title)
    assert not page.warning
    assert "Hyundai amplifies disturbances up to 1.49 times at 0.0879 rad/s" in texts(page)


def test_every_verdict_has_its_sentence() -> None:
    (why,) = (e for e in open_page(STABILITY).expander if e.label.startswith("Why"))
    said = "\n".join(element.value for element in why.markdown).replace("\\", "")
    for vehicle in stability_report(ASTAZERO.parameters).vehicles:
        for verdict in (vehicle.l2, vehicle.linf_paper, vehicle.linf_exact):
            assert verdict.reason in said


def test_stability_speaks_of_the_fit_once_there_is_one() -> None:
    found = fitted()
    page = open_page(STABILITY, found)
    assert found.segment
    html = texts(page)
    for label in found.segment.labels[1:]:
        assert label in html
    # Vehicle 3 keeps the colour it has on the other pages.
    curves = [trace for trace in figures(page)[0]["data"] if "line" in trace]
    assert curves[0]["line"]["color"] == "#d8660c"
    choose(page, "stability_source", "published")
    assert "Audi A6" in texts(page)
    choose(page, "stability_source", "fit")
    assert "Audi A6 " not in texts(page)


@pytest.mark.parametrize("path", [STABILITY, PLATOON])
def test_a_stopped_training_is_no_result(path: str) -> None:
    stopped = {"outcome": Outcome.STOPPED, "iterations": 930, "config": {"iterations": 20_000}}
    page = open_page(path, fitted(**stopped))
    assert "stopped at 930 of 20,000 iterations; these are not yet" in page.warning[0].value
    choose(page, f"{path[8:].lower()[:-3]}_source", "published")
    assert "stopped at" not in texts(page)


def test_a_stopped_training_is_no_result_in_a_snapshot_either() -> None:
    found = fitted(outcome=Outcome.STOPPED, iterations=930)
    assert found.segment
    assert found.fit
    library().add(create(found.segment, found.fit, name="early"))
    page = choose(open_page(STABILITY), "stability_source", "snapshot")
    assert "stopped at 930 iterations" in page.warning[0].value


@pytest.mark.parametrize("path", [STABILITY, PLATOON])
def test_what_the_law_leaves_out_is_said(path: str) -> None:
    found = fitted()
    assert found.segment
    assert "left out" not in texts(open_page(path, found))
    found.segment = replace(found.segment, excluded_regimes=("catching up",))
    page = open_page(path, found)
    assert "catching up left out" in " ".join(caption.value for caption in page.caption)
    if path == STABILITY:
        assert (
            "String stability, synthetic_astazero_like.csv, 0–300 s, catching up left out"
            in texts(page)
        )


def test_published_laws_do_not_pass_for_ones_own_while_training_runs() -> None:
    found = fitted()
    assert found.job
    running: Any = found.job
    running.fit, running.status, running.is_active = None, Status.RUNNING, True
    page = open_page(STABILITY, found)
    assert any("your own training is not finished" in info.value for info in page.info)
    found.laws.source = "published"
    assert not open_page(STABILITY, found).info, "then they were asked for"


def test_the_answer_says_how_sure_it_is_with_and_without_the_bands() -> None:
    page = open_page(STABILITY, fitted())
    for _ in range(2):
        assert "the data allow" in texts(page)
        assert "certain" in texts(page)
        if page.toggle(key="stability_doubt").value:
            choose(page, "stability_doubt", False)
    assert "vehicle 3" in headline_of(page), "two Hyundai are not “2 Hyundai”"
    choose(page, "stability_source", "published")
    assert "the data allow" not in texts(page)


def headline_of(page: AppTest) -> str:
    return next(m.value for m in page.markdown if m.value.startswith("####"))


@pytest.mark.parametrize(
    ("stable", "gapless", "said"),
    [
        (0.01, 0.0, "verdict is certain: at least 95 % of the laws that the data allow agree"),
        (0.01, 0.09, "90 % amplify, 1 % do not, 9 % keep no gap (α = 0)"),
        (0.60, 0.0, "40 % amplify, 60 % do not."),
        (math.nan, math.nan, "do not determine what V1 does"),
    ],
)
def test_certainty_counts_the_laws_that_the_data_allow(
    stable: float, gapless: float, said: str
) -> None:
    laws = parameter_set("Mine", ("V1",), (LOUD,))
    ends = Interval(np.array([1.0]), np.array([1.53]))
    uncertainty: Any = SimpleNamespace(
        level=0.9,
        probability_l2=np.array([stable]),
        gapless=np.array([gapless]),
        peak_gain=ends,
        inside=np.array([[True, False, True]]),
    )
    sentence = certainty(laws, stability_report(laws.parameters), uncertainty).replace("\\", "")
    assert said in sentence
    assert "the estimate's β." in sentence
    assert ("the data allow 1.00 to 1.53 (90 % interval)" in sentence) == (stable == stable)


def test_a_lost_fit_gives_way_to_the_example() -> None:
    found = fitted()
    page = choose(open_page(STABILITY, found), "stability_source", "fit")
    found.choose(window=Window(0.0, 100.0))
    page.run()
    assert not page.exception
    assert "Audi A6 the most" in texts(page)


def test_by_hand_begins_with_what_was_shown_and_is_kept_over_pages() -> None:
    page = choose(open_page(STABILITY), "stability_example", CASALE.title)
    choose(page, "stability_source", "hand")
    found = workspace_of(page)
    assert found.laws.rows == (("Hyundai", 0.0104, 0.0718, 1.52),)
    assert "Hyundai amplifies disturbances" in texts(page)
    found.laws.rows = (("calm", CALM.alpha, CALM.beta, CALM.tau), ("", 0.08, 0.12, 1.5))
    again = open_page(STABILITY, found)
    assert "One of two vehicles amplifies disturbances: Vehicle 2" in texts(again)
    other = open_page(PLATOON, found)
    assert "Follower 2: Vehicle 2" in texts(other)


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
    found.laws.source, found.laws.rows = "hand", (row,)
    (error,) = errors(open_page(path, found))
    assert sentence in error


def test_an_empty_table_by_hand_is_refused() -> None:
    found = workspace_of(open_page(STABILITY))
    found.laws.source, found.laws.rows = "hand", ()
    (error,) = errors(open_page(STABILITY, found))
    assert "0 vehicles; give at least one" in error


def test_names_by_hand_are_shown_as_they_are() -> None:
    found = workspace_of(open_page(STABILITY))
    found.laws.source = "hand"
    found.laws.rows = (("<script>*x*</script>", 0.08, 0.12, 1.5), ("$a_b$", 0.08, 0.12, 1.5))
    for path in (STABILITY, PLATOON):
        said = texts(open_page(path, found))
        assert "<script>" not in said.replace("\\<script", "")
        assert "$a_b$" not in "\n".join(m.value for m in open_page(path, found).markdown)


@pytest.mark.parametrize(
    ("laws", "sentence"),
    [
        ((CALM,), "V1 does not amplify any frequency."),
        ((CALM, CALM), "None of the vehicles amplifies any frequency."),
        ((Parameters(0.05, 0.6, 1.62),) * 2, "peaks can still grow"),
        ((CALM, UNDAMPED), "One of two vehicles amplifies disturbances: V2, without limit"),
        ((CALM, LOUD), "One of two vehicles amplifies disturbances: V2, up to"),
        ((LOUD, CALM, LOUD), "Two of three vehicles amplify disturbances, V1 the most"),
        ((LOUD,) * 12, "All 12 vehicles amplify disturbances, V1 the most"),
    ],
)
def test_the_headline_counts(laws: Parameters, sentence: str) -> None:
    named = parameter_set("Mine", [f"V{k}" for k in range(1, len(laws) + 1)], laws)
    assert sentence in headline(named, stability_report(laws))


def test_the_map_can_be_turned() -> None:
    page = open_page(STABILITY)
    assert figures(page)[2]["layout"]["xaxis"]["title"]["text"].startswith("β")
    choose(page, "stability_plane", "alpha")
    choose(page, "stability_held", 1)
    assert figures(page)[2]["layout"]["xaxis"]["title"]["text"].startswith("α")
    assert "BMW X5's β" in texts(page)
    choose(page, "stability_example", CASALE.title)
    assert "Hyundai's β" in texts(page)


# From one page to the other


def test_a_peak_goes_to_the_platoon_page() -> None:
    page = press(open_page(STABILITY), "stability_peak_1")
    drive = workspace_of(page).drive
    assert (drive.order, drive.vehicle, drive.kind) == ("repeated", 1, "sinusoid")
    assert drive.omega == pytest.approx(0.2657, abs=1e-4)
    other = open_page(PLATOON, workspace_of(page))
    assert other.number_input(key="platoon_frequency").value == drive.omega
    assert "Follower 8: BMW X5" in texts(other)


def test_the_whole_platoons_peak_drives_all_in_order() -> None:
    page = press(open_page(STABILITY), "stability_peak_-1")
    drive = workspace_of(page).drive
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
    assert "The oscillation grows to 2.44 times the leader's" in texts(page)
    assert "By |H| the last follower reaches 2.44 m/s." in texts(page)
    assert len(page.get("plotly_chart")) == 4


def test_eight_times_one_vehicle_as_in_the_paper() -> None:
    page = choose(open_page(PLATOON), "platoon_order", "repeated")
    choose(page, "platoon_vehicle", 2)
    choose(page, "platoon_frequency", 0.25)
    gain = 4.233  # |H(0.25j)| of AstaZero's vehicle 3 to the eighth power
    assert f"grows to {gain:.3g} times" in texts(page)
    choose(page, "platoon_followers", 3)
    assert "Follower 3: Mercedes A-Class" in texts(page)
    assert "Follower 4: Mercedes A-Class" not in texts(page)
    assert "grows to 1.72 times" in texts(page)


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
    assert "Follower 8: Tesla Model 3" in texts(page), "twice in order to begin with"
    choose(page, "platoon_own", "4, 1-2")
    for name in ("1: Tesla Model 3", "2: Audi A6", "3: BMW X5"):
        assert name in texts(page)
    choose(page, "platoon_own", "5")
    assert "there is no vehicle 5; give numbers from 1 to 4" in errors(page)[0]
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
    assert "The largest speed deviation grows to" in texts(page)
    assert "The smallest gap is" in texts(page)
    choose(page, f"platoon_{plenty}", 20.0 if kind == "brake" else -20.0)
    assert "What comes after has no meaning" in texts(page)
    assert not any("runs into" in warning.value for warning in page.warning), "said once"
    assert "times as much as the leader's, until follower 1 collides at" in texts(page)
    assert "Only what comes before the collision." in texts(page)
    assert ", until the collision." in texts(page)


def test_settings_that_make_no_sense_are_refused_and_kept_for_mending() -> None:
    page = choose(open_page(PLATOON), "platoon_sinusoid_duration", -5.0)
    (error,) = errors(page)
    assert "Leader: duration = -5" in error
    assert page.number_input(key="platoon_sinusoid_duration").value == -5.0
    choose(page, "platoon_sinusoid_duration", 400.0)
    assert not page.error
    choose(page, "platoon_frequency", 0.0)
    assert "frequency" in errors(page)[0]


def test_a_transient_that_is_not_over_is_said() -> None:
    page = choose(open_page(PLATOON), "platoon_sinusoid_duration", 60.0)
    assert any("transient" in warning.value for warning in page.warning)
    choose(page, "platoon_sinusoid_duration", 30.0)
    assert any("need a whole period" in warning.value for warning in page.warning)


def test_the_recorded_leader_is_offered_with_a_recording_only() -> None:
    found = fitted()
    page = choose(open_page(PLATOON, found), "platoon_kind", "recorded")
    assert "as recorded" in texts(page)
    assert "largest speed deviation" in texts(page)
    alone = open_page(PLATOON)
    assert alone.selectbox(key="platoon_kind").options == ["Sinusoid", "Step", "Brake"]


def test_captions_say_which_part_of_the_run_is_shown() -> None:
    said = texts(open_page(PLATOON))
    assert "From 6 to 235 s of 500 s." in said
    assert "From 443 to 500 s of 500 s." in said
    assert "All 500 s." not in said
    brief = texts(choose(open_page(PLATOON), "platoon_sinusoid_duration", 30.0))
    assert "From 6 to 30 s of 30 s." in brief


def test_amplitudes_in_db() -> None:
    page = open_page(PLATOON)
    assert "[m/s]" in figures(page)[1]["layout"]["yaxis"]["title"]["text"]
    choose(page, "platoon_db", True)
    assert "[dB re leader]" in figures(page)[1]["layout"]["yaxis"]["title"]["text"]


def test_the_papers_panels_and_back() -> None:
    page = press(open_page(PLATOON), "platoon_panels")
    said = texts(page).replace("\\", "")
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
    assert "Follower 8: Hyundai" in texts(page)
