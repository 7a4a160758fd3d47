"""The pages Stability and Platoon without a browser: source, verdicts, orders, disturbances."""

import json
from collections.abc import Callable
from dataclasses import replace
from math import isfinite, pi
from typing import Any

import numpy as np
import pytest

from accpinn import Library, Parameters, Result, stability_report
from accpinn.errors import AccpinnError
from accpinn.methods.estimate import Outcome
from accpinn.methods.pinn.config import PresetName
from accpinn.model.cthp import Case
from accpinn.model.published import ASTAZERO, CASALE
from accpinn.platoon import AFTER_COLLISION
from accpinn.recordings import Window, files
from accpinn.results.figures.style import FOLLOWERS, LEADER, SHARED
from accpinn.results.messages.estimate import assumption
from accpinn.results.messages.stability import GIVEN_PARAMETERS, probabilities, reason
from accpinn.results.tables.estimates import EVERY_FOLLOWER
from accpinn.results.tables.stability import margin_table, verdict_table
from accpinn.study.snapshot import prepare_snapshot
from accpinn.study.vehicles import assessed_vehicles
from accpinn.tasks import Task
from pages.ui.components.parameter_picker import ROWS, SNAPSHOT, parameters_from
from pages.ui.platoon import parse_order
from pages.ui.session import sessions
from pages.ui.session.resources import SAMPLES, library
from pages.ui.session.workspace import Workspace
from tests.support.apptest import (
    MINUTE,
    Page,
    fitted,
    numbers,
    open_page,
    read,
    train_at_once,
    with_example,
    with_pair,
    with_sample,
)
from tests.support.snapshots import altered, missing_the_drive, whole

pytestmark = pytest.mark.usefixtures("fresh_server")


def headline(page: Page) -> str:
    """What the page says first, which begins with its source."""
    first = (m.value for m in page.markdown if "\n#### " in m.value or m.value[:6] == "##### ")
    return read(next(first)).removeprefix("##### ")


CALM = ("calm", 0.05, 0.6, 1.8)


def test_published_vehicles_are_answered_before_anything_was_trained() -> None:
    page = open_page("Stability", with_example())
    said = page.plain()
    assert GIVEN_PARAMETERS in said
    said = page.open_tab("stability", "Numbers").plain()
    for vehicle in stability_report(ASTAZERO.parameters).vehicles:
        for verdict in (vehicle.l2, vehicle.linf_paper, vehicle.linf_exact):
            assert reason(verdict, vehicle) in said
    assert len(page.figures()) == 2
    assert len(page.open_tab("stability", "Poles and responses").figures()) == 4
    page.choose("stability_impulse", 1)
    gain = stability_report(ASTAZERO.parameters).vehicles[1].linf_gain
    assert f"<b>{gain:.3f}</b>" in page.figures()[3]["layout"]["annotations"][0]["text"]

    page.open_tab("stability", "Region")
    page.choose("stability_plane", "alpha")
    page.choose("stability_held", 1)
    assert page.figures()[1]["layout"]["xaxis"]["title"]["text"].startswith("α")
    assert "BMW X5's β" in page.plain()
    page.choose("frame_pictures", "PNG")
    (_, plane) = page.get("plotly_chart")
    saved = json.loads(plane.proto.config)["toImageButtonOptions"]
    assert (saved["format"], saved["filename"]) == ("png", "accpinn_stability_map")
    page.choose("parameters_example", CASALE.title)
    assert "Hyundai's β" in page.plain()


@pytest.mark.parametrize("preset", ["calibrated", "fast", "paper"])
def test_what_is_trained_is_what_is_shown(preset: PresetName) -> None:
    session = with_pair()
    session.preset, session.settings[preset] = preset, {"iterations": 20}
    result = train_at_once(session)
    (shown,) = (parameters_from(session, "estimate", ()).vehicles.parameters.everything,)
    assert shown == pytest.approx(result.parameters.everything, abs=1e-9)
    page = open_page("Stability", session)
    assert page.shows(verdict_table(assessed_vehicles(result)))
    assert ("Probability" in page.plain()) is (result.posterior is not None)


def test_the_estimate_is_shown_with_its_certainty_until_it_is_lost() -> None:
    session = fitted()
    page = open_page("Stability", session)
    assert all(label in page.plain() for label in session.segment.labels[1:])
    said = headline(page)
    assert said.startswith("Estimate: synthetic_astazero_like.csv, 0–60 s")
    subject = assessed_vehicles(session.result)
    assert probabilities(subject.vehicles, subject.uncertainty) in page.plain()
    # Vehicle 3 keeps the colour it has on the other pages.
    curves = [trace for trace in page.figures()[0]["data"] if "line" in trace]
    assert curves[0]["line"]["color"] == "#d8660c"
    assert assumption(session.result) in page.plain()
    banded = len(page.figures()[0]["data"])
    page.choose("stability_uncertainty", False)
    assert len(page.figures()[0]["data"]) < banded
    page.choose("stability_source", "published")
    assert headline(page).startswith("Published: AstaZero (paper, Table III)")
    session.training.results = (replace(session.result),)
    assert headline(page.run()).startswith("Estimate: "), "a new one takes its place"
    session.choose(window=Window(0.0, 100.0))
    page.sound()
    assert not page.get("plotly_chart"), "nothing published passes for what is not there"
    page.press("stability_open_example")
    assert headline(page).startswith("Published: AstaZero (paper, Table III)")


@pytest.mark.parametrize("title", ["Train", "Stability", "Platoon"])
def test_what_is_against_an_estimate_stands_beside_its_conclusions(title: str) -> None:
    session = fitted()
    result = session.result
    missing, against = missing_the_drive(result)
    page = open_page(title, session)
    assert against not in page.plain()
    assert "train_models" not in page.buttons
    session.training.results = (missing,)
    said = page.run().plain()
    assert against in said
    if title == "Train":
        page.press("train_models")
        assert session.choices["compare_view"] == "models"
    else:
        assert not any(trust.in_words[1:] in said for trust in result.trust[1:])


@pytest.mark.parametrize("title", ["Stability", "Platoon"])
def test_a_stopped_training_has_no_verdict_and_excluded_regimes_are_named(title: str) -> None:
    stopped = {"outcome": Outcome.STOPPED, "iterations": 230, "posterior": None, "windows": None}
    session = fitted(**stopped)
    page = open_page(title, session)
    assert "stopped at 230 of 300 iterations" in page.boxes("warning")[0]
    assert headline(page).endswith("#### No verdict")
    assert "unstable" not in page.plain().split()
    library().add(prepare_snapshot(session.result, "early"))
    session.choose_source("snapshot")
    assert headline(page.run()).endswith("#### No verdict")
    train_at_once(session)
    info = replace(session.result.info, excluded_regimes=("catching up",))
    session.training.results = (replace(session.result, infos=(info,)),)
    page.run()
    assert "without catching up" in headline(page)
    assert "No verdict" not in page.plain()


def test_followers_that_share_their_parameters_have_one_colour() -> None:
    session = fitted()
    train_at_once(session, "I")
    page = open_page("Stability", session)
    assert EVERY_FOLLOWER in page.plain()
    curves = [trace["line"]["color"] for trace in page.figures()[0]["data"] if "line" in trace]
    assert SHARED in curves
    assert not {*curves} & {LEADER, *FOLLOWERS}
    page = open_page("Platoon", session).choose("platoon_kind", "recorded")
    assert "Recorded" in [one["name"] for one in page.figures()[2]["data"]]


def test_every_new_training_turns_to_the_current_estimate() -> None:
    session = fitted()
    session.choose_source("published")
    session.training = Task(session.id, "training", lambda _: iter(()))  # waits
    assert headline(open_page("Stability", session)).startswith("Published"), "as it was asked for"
    train_at_once(session, seconds=1.0)
    assert session.parameter_source == "estimate"
    session.choose_source("published")
    open_page("Train", session).press("train_next")
    assert session.parameter_source == "estimate"
    session.choose_source("published")
    session.preset, session.settings["fast"] = "fast", {"iterations": 5}
    session.train()
    assert session.parameter_source == "estimate"
    session.training.stop()


# By hand


def test_by_hand_begins_with_what_was_shown_and_is_kept_over_pages() -> None:
    page = open_page("Stability", with_example()).choose("parameters_example", CASALE.title)
    page.choose("stability_source", "hand")
    session = page.workspace()
    assert session.choices[ROWS] == (("Hyundai", 0.0104, 0.0718, 1.52, 0.0, 0.0, 0.0),)
    assert "Hyundai amplifies by" in page.plain()
    session.choices[ROWS] = (CALM, ("", 0.08, 0.12, 1.5))
    again = open_page("Stability", session)
    assert "Vehicle 2 amplifies most: by up to 38 %" in again.plain()
    assert "Vehicle 2" in open_page("Platoon", session).plain()


@pytest.mark.parametrize("model", ["cthp-s0-delay", "idm", "fvdm-lag"])
def test_what_is_taken_over_by_hand_is_the_learned_set_with_all_digits(model: str) -> None:
    session = with_pair()
    session.choose_model(model)
    result = train_at_once(session)
    learned = assessed_vehicles(result)
    page = open_page("Stability", session).choose("stability_source", "hand")
    typed = parameters_from(session, "hand", ())
    np.testing.assert_allclose(
        typed.vehicles.parameters.everything, learned.vehicles.parameters.everything,
        rtol=1e-12, atol=0,
    )  # fmt: skip
    for one, other in zip(typed.report.vehicles, learned.report.vehicles, strict=True):
        assert [v.stable for v in (one.l2, one.linf_paper, one.linf_exact)] == [
            v.stable for v in (other.l2, other.linf_paper, other.linf_exact)
        ]
        assert one.linf_gain == pytest.approx(other.linf_gain, rel=1e-12)
        assert one.peak.gain == pytest.approx(other.peak.gain, rel=1e-12)
    page.choose("stability_rows_cars", 3)
    assert len(parameters_from(session, "hand", ()).vehicles) == 3
    assert page.press("stability_rows_take").sound()
    assert len(session.choices[ROWS]) == 1
    assert not open_page("Platoon", session).error


def test_by_hand_another_model_has_its_own_parameters() -> None:
    page = open_page("Stability", with_example()).choose("stability_source", "hand")
    page.choose("stability_rows_model", "idm-delay")
    session = page.workspace()
    assert [len(row) for row in session.choices[ROWS]] == [8] * 4
    assert parameters_from(session, "hand", ()).vehicles.model == "idm-delay"
    name, *values = session.choices[ROWS][0]
    for place, value, sentence in ((0, -1.0, "a = -1 is not allowed"), (3, None, "s₀ is missing"),
                                   (6, None, "the speed is missing"),
                                   (6, 60.0, "no equilibrium")):  # fmt: skip
        session.choices[ROWS] = ((name, *values[:place], value, *values[place + 1 :]),)
        (error,) = open_page("Stability", session).boxes("error")
        assert sentence in error


def test_waves_of_either_direction_are_shown_of_models_that_tell_them_apart() -> None:
    page = open_page("Stability", with_example()).choose("stability_source", "hand")
    page.choose("stability_rows_model", "unequal")
    session = page.workspace()
    name, *values = session.choices[ROWS][0]
    session.choices[ROWS] = ((name, *values), ("Other", values[0], 3.0, *values[2:]))
    page = open_page("Stability", session).open_tab("stability", "Waves")
    for figure in page.figures()[-2:]:
        assert len(figure["data"]) == 4
    waves = parameters_from(session, "hand", ()).waves
    assert waves is not None
    assert waves.vehicles[0].braking == pytest.approx(waves.vehicles[0].accelerating, rel=0.01)
    assert waves.vehicles[1].braking != pytest.approx(waves.vehicles[1].accelerating, rel=0.01)


@pytest.mark.parametrize("title", ["Stability", "Platoon"])
def test_by_hand_bad_values_are_refused_and_names_shown_as_they_are(title: str) -> None:
    session = sessions.workspaces().new()
    session.chosen_source = "hand"
    for rows, sentence in (
        ((("A", None, 0.1, 1.0),), "Parameter set 1: α is missing"),
        ((("A", 0.1, -0.1, 1.0),), "β = -0.1 is negative"),
        ((), "0 vehicles; give at least one"),
    ):
        session.choices[ROWS] = rows
        (error,) = open_page(title, session).boxes("error")
        assert sentence in error
    session.choices[ROWS] = (("<script>*x*</script>", 0.08, 0.12, 1.5), ("$a_b$", 0.08, 0.12, 1.5))
    page = open_page(title, session)
    assert "<script>" not in page.texts().replace("\\<script", "")
    assert "$a_b$" not in "\n".join(m.value for m in page.markdown)


def test_vehicles_of_one_name_are_told_apart() -> None:
    session = sessions.workspaces().new()
    session.chosen_source = "hand"
    session.choices[ROWS] = (("A", 0.05, 0.6, 1.8), ("A", 0.08, 0.12, 1.5))
    page = open_page("Platoon", session).choose("platoon_order", "repeated")
    for vehicle in (1, 0):
        page.choose("platoon_vehicle", vehicle)
        assert session.choices["platoon_vehicle"] == vehicle


# In every state


TABS = ("Numbers", "Poles and responses", "Region", "Margin", "Measured")
ODD = (("undamped", 0.1, 0.0, 0.0), ("bare", 0.0, 0.3, 1.0), ("silent", 0.0, 0.0, 1.0), CALM)


def by_hand(*rows: tuple[str, float, float, float]) -> Workspace:
    session = sessions.workspaces().new()
    session.chosen_source, session.choices[ROWS] = "hand", rows
    return session


def estimated(model: str, case: Case = "II") -> Workspace:
    session = fitted()
    session.choose_model(model)
    train_at_once(session, case)
    return session


STATES: dict[str, Callable[[], Workspace]] = {
    "odd by hand": lambda: by_hand(*ODD),
    "one by hand": lambda: by_hand(CALM),
    "eight by hand": lambda: by_hand(*[(f"car {k}", 0.08, 0.1 * k, 1.2) for k in range(1, 9)]),
    "with a lag": lambda: estimated("cthp-s0-lag"),
    "nonlinear": lambda: estimated("idm"),
    "shared parameters": lambda: estimated("cthp-s0-delay", "I"),
}


@pytest.mark.parametrize("state", STATES)
def test_every_tab_is_drawn_in_every_state(state: str) -> None:
    session = STATES[state]()
    page = open_page("Stability", session)
    for tab in TABS:
        page.open_tab("stability", tab)
        assert not page.boxes("error")
        if tab == "Region":
            for plane in ("alpha", "gains"):
                page.choose("stability_plane", plane)
                assert not page.boxes("error")
        if tab == "Margin":
            source = parameters_from(session, session.parameter_source, ())
            assert page.shows(margin_table(source))


# From several results


@pytest.mark.parametrize("title", ["Stability", "Platoon"])
def test_cars_come_from_several_results(title: str) -> None:
    session = fitted()
    assert "several" not in open_page(title, session).widget(f"{title.lower()}_source").options
    alone = with_sample()
    alone.choose(window=MINUTE, vehicles=(3, 4))
    alone.choose_model("idm")
    own = train_at_once(alone)
    task = Task(session.id, "estimate of 4", lambda _: iter(()))
    task.finish(own)
    session.cars[4] = task
    page = open_page(title, session).choose(f"{title.lower()}_source", "several")
    said = headline(page)
    assert said.startswith("Cars from several results: ")
    assert f"{own.info.labels[1]}: IDM" in said
    shown = parameters_from(session, "several", ())
    rows = session.result.parameters.complete.copy()
    rows[1] = own.parameters.complete[0]
    assert shown.vehicles.parameters.complete == pytest.approx(rows)
    assert shown.uncertainty.draws.complete[:, 1] == pytest.approx(
        own.posterior.typical.complete[:, 0]
    )
    session.open(files.read(SAMPLES / "synthetic_vicolungo_like.csv"))
    assert not session.own_results, "they are of the other recording"


# From a snapshot


def halved() -> Result:
    """A snapshot of the same name with half the gains."""
    factors = [0.5, 1, 1, 1, 1, 1]
    return altered(whole(), parameters=Parameters.of(whole().parameters.complete * factors))


def test_snapshots_of_one_name_are_told_apart() -> None:
    names = {library().add(kept) for kept in (whole(), halved())}
    assert len(names) == 2
    session = sessions.workspaces().new()
    session.chosen_source = "snapshot"
    page = open_page("Stability", session)
    for name in (*names, *names):
        page.choose(SNAPSHOT, name)
        assert session.choices.get(SNAPSHOT, name) == page.widget(SNAPSHOT).value == name


@pytest.mark.parametrize("title", ["Stability", "Platoon"])
def test_a_snapshot_is_a_source_that_is_read_once(
    title: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    session = sessions.workspaces().new()
    session.chosen_source = "snapshot"
    other = replace(halved(), name="other")
    name, newer = library().add(other), library().add(whole())
    session.choices[SNAPSHOT] = name
    page = open_page(title, session)
    assert not page.error
    held = parameters_from(session, "snapshot", library().entries())
    assert held.vehicles.parameters == other.parameters

    looks, reads = [], []
    entries, opening = Library.entries, Library.read
    monkeypatch.setattr(Library, "entries", lambda s, w="": looks.append(1) or entries(s, w))
    monkeypatch.setattr(Library, "read", lambda s, name: reads.append(name) or opening(s, name))
    page.run()
    assert (len(looks), reads) == (1, [])

    for gone, left in ((name, True), (newer, False)):  # the newest takes its place, then none
        library().delete(gone)
        page.run()
        assert not page.error
        assert bool(page.get("plotly_chart")) == left


# From one page to the other


@pytest.mark.parametrize(
    ("which", "chosen"), [(1, ("repeated", 1, 0.2657)), (-1, ("learned", 0, 0.2189))]
)
def test_the_laboratory_leads_to_the_platoon_page(which: int, chosen: tuple[Any, ...]) -> None:
    page = open_page("Stability", with_example()).choose("laboratory_platoon", which)
    session = page.press("stability_next").workspace()
    drive = [session.choices[f"platoon_{name}"] for name in ("order", "vehicle", "kind")]
    assert drive == [*chosen[:2], "sinusoid"]
    omega = session.choices["platoon_sinusoid_frequency"]
    assert omega == pytest.approx(chosen[2], abs=1e-4)
    if which == 1:
        other = open_page("Platoon", session)
        assert other.widget("platoon_sinusoid_frequency").value == omega
        assert drawn(other)["names"][-1] == "Follower 8: BMW X5"


def test_the_measured_gain_stands_beside_the_model() -> None:
    session = fitted()
    page = open_page("Stability", session).open_tab("stability", "Measured")
    page.choose("stability_measured", 1)
    chart = {trace.get("name"): trace for trace in page.figures()[1]["data"]}
    label = session.segment.labels[2]
    assert {f"{label}, measured", f"{label}, model"} <= chart.keys()
    page.choose("stability_source", "published")
    assert not any("model" in one.get("name", "") for one in page.figures()[1]["data"])
    page.choose("parameters_example", CASALE.title)
    assert any(one.get("name") == "Hyundai, model" for one in page.figures()[1]["data"])
    session.choose(window=Window(0.0, 40.0))
    session.choose_source("published")
    assert "no measured gain" in page.run().boxes("error")[0]
    alone = open_page("Stability", with_example()).open_tab("stability", "Measured")
    assert "needs the recorded speeds" in alone.boxes("info")[0]


# The page Platoon


def drawn(page: Page) -> dict[str, Any]:
    """What the animation draws."""
    (road,) = page.get("bidi_component")
    return dict(json.loads(road.proto.json))


def reach(page: Page, place: int) -> tuple[float, float]:
    """First and last instant that a chart draws; its numbers may be packed."""
    drawn = [one for one in page.figures()[place]["data"] if one["mode"] != "text"]
    known = [x for one in drawn for x in numbers(one["x"]) if x is not None and isfinite(x)]
    return min(known), max(known)


def traces(page: Page, place: int) -> list[str]:
    """The names in the upper panel of a chart."""
    return [one["name"] for one in page.figures()[place]["data"] if one.get("yaxis") == "y"]


MAP = "Map of speeds"


class TestPage:
    def test_a_published_example_drives_before_anything_was_trained(self) -> None:
        page = open_page("Platoon", with_example())
        assert page.widget("platoon_sinusoid_frequency").value == pytest.approx(0.2189)
        assert "2.44 times at the last follower" in page.plain()
        assert page.selectbox(key="platoon_kind").options == ["Sinusoid", "Step", "Brake"]
        bars = next(one for one in page.figures()[2]["data"] if one["name"] == "Simulated")
        assert numbers(bars["base"])[-1] + numbers(bars["y"])[-1] == pytest.approx(2.44, abs=0.005)
        assert "From 414 to 500 s of 500 s." in page.plain(), "the animation"
        assert "From 6 to 235 s of 500 s." in page.open_tab("platoon", MAP).plain()
        assert "2.44" in page.open_tab("platoon", "Numbers").texts()

    def test_both_charts_show_the_part_and_the_view_that_were_chosen(self) -> None:
        page = open_page("Platoon", with_example())
        start, period = 500 - 3 * 2 * pi / 0.2189, 0.2
        for place in (0, 1):
            assert reach(page, place) == pytest.approx((start, 500), abs=period)
        page.choose("platoon_whole", True)
        assert reach(page, 0) == reach(page, 1) == (0, 500)
        page.choose("platoon_view", "road")
        assert "on the road" in page.figures()[1]["layout"]["yaxis"]["title"]["text"]

    def test_one_vehicle_is_repeated_at_its_peak_until_a_frequency_is_given(self) -> None:
        page = open_page("Platoon", with_example()).choose("platoon_order", "repeated")
        assert page.widget("platoon_sinusoid_frequency").value == pytest.approx(0.214, abs=1e-4)
        page.choose("platoon_vehicle", 2)
        page.choose("platoon_sinusoid_frequency", 0.25)
        gain = 4.233  # |H(0.25j)| of AstaZero's vehicle 3 to the eighth power
        assert f"grows to {gain:.3g} times" in page.plain()
        page.choose("platoon_followers", 3)
        assert len(drawn(page)["names"]) == 4
        assert "grows to 1.72 times" in page.plain()
        page.choose("platoon_vehicle", 3)
        assert page.widget("platoon_sinusoid_frequency").value == 0.25
        page.press("platoon_peak")
        assert page.widget("platoon_sinusoid_frequency").value == pytest.approx(0.1059, abs=1e-4)
        # Other vehicles begin without what was chosen among the former.
        page.choose("parameters_example", CASALE.title)
        assert page.widget("platoon_sinusoid_frequency").value == pytest.approx(0.0879, abs=1e-4)

    def test_choices_among_vehicles_are_forgotten_where_others_are_shown(self) -> None:
        session = with_sample()
        for vehicles in ((1, 2, 3), (3, 4, 5)):
            session.choose(window=MINUTE, vehicles=vehicles)
            train_at_once(session)
            page = open_page("Platoon", session).choose("platoon_order", "repeated")
            assert page.widget("platoon_vehicle").value == 0
            page.choose("platoon_vehicle", 1)
            assert open_page("Platoon", session).widget("platoon_vehicle").value == 1

    def test_a_nonlinear_model_has_the_probabilities_of_the_speed(self) -> None:
        session = fitted()
        session.choose_model("idm")
        train_at_once(session)
        open_page("Stability", session).choose("stability_speed", 30.0)
        source = assessed_vehicles(session.result).at_speed(30.0 / 3.6)
        there = open_page("Platoon", session).plain()
        assert probabilities(source.vehicles, source.uncertainty) in there

    def test_an_order_of_ones_own(self) -> None:
        page = open_page("Platoon", with_example()).choose("platoon_order", "own")
        assert drawn(page)["names"][-1] == "Follower 8: Tesla Model 3", "twice in order at first"
        page.choose("platoon_own", "4, 1-2")
        for name in ("1: Tesla Model 3", "2: Audi A6", "3: BMW X5"):
            assert name in page.plain()
        page.choose("platoon_own", "5")
        assert "there is no vehicle 5; give numbers from 1 to 4" in page.boxes("error")[0]
        assert not page.get("plotly_chart")

    def test_steps_brakes_and_the_recorded_leader(self) -> None:
        page = open_page("Platoon", fitted())
        drawn = page.choose("platoon_kind", "recorded").figures()[2]["data"]
        assert "Recorded" in [one["name"] for one in drawn]
        page.choose("platoon_source", "published")
        for kind, setting, plenty in (("step", "change", -20.0), ("brake", "drop", 20.0)):
            assert "The smallest gap is" in page.choose("platoon_kind", kind).plain()
            said = page.choose(f"platoon_{kind}_{setting}", plenty).plain()
            assert AFTER_COLLISION in said
            assert "Audi A6 collides at" in said
            assert not any("collides" in box for box in page.boxes("warning")), "named once"
        session = page.workspace()
        session.segment = replace(session.segment, start=40.0)
        page.choose("platoon_kind", "recorded")
        names = [f"{label}, measured" for label in session.segment.labels[1:]]
        assert [one for one in traces(page, 0) if one in names] == names
        page.choose("platoon_measured", False)
        assert not set(names) & set(traces(page, 0))
        said = page.open_tab("platoon", MAP).plain()
        assert "From 40 to 100 s" in said, "by the recording's clock"
        page.choose("platoon_order", "repeated")
        assert page.widget("platoon_followers").value == 3, "as many as recorded"

    def test_settings_are_refused_or_warned_of_and_kept_for_mending(self) -> None:
        page = open_page("Platoon", with_example()).choose("platoon_sinusoid_duration", -5.0)
        (error,) = page.boxes("error")
        assert "Leader: duration = -5" in error
        assert page.widget("platoon_sinusoid_duration").value == -5.0
        page.choose("platoon_sinusoid_duration", 60.0)
        assert not page.error
        assert any("transient" in warning for warning in page.boxes("warning"))
        page.choose("platoon_sinusoid_duration", 30.0)
        assert any("too short" in warning for warning in page.boxes("warning"))
        assert "From 6 to 30 s of 30 s." in page.open_tab("platoon", MAP).plain()
        page.choose("platoon_sinusoid_frequency", 0.0)
        assert "frequency" in page.boxes("error")[0]


def test_orders_are_numbers_and_ranges_and_others_are_refused() -> None:
    for text, order in (("1", [0]), ("3-1, 2", [2, 1, 0, 1]), ("2 2,2", [1, 1, 1])):
        assert parse_order(text, 3) == order
    for text, fault in (("", "names no vehicles"), ("0", "no vehicle 0"), ("2-9", "no vehicle 4"),
                        ("1 " * 21, "there are 21")):  # fmt: skip
        with pytest.raises(AccpinnError, match=fault):
            parse_order(text, 3)
