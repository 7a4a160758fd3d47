"""The page Platoon without a browser: order, disturbance, captions and panels."""

from contextlib import suppress
from dataclasses import replace
from math import isfinite, pi

import pytest
from hypothesis import given
from hypothesis import strategies as some

from accpinn.errors import ParameterError
from accpinn.model.published import CASALE
from accpinn.platoon.simulation import AFTER_COLLISION
from pages.ui.platoon import parse_order
from tests.support.apptest import PLATOON, Page, fitted, numbers, open_page, with_example


def reach(page: Page, place: int) -> tuple[float, float]:
    """First and last instant that a chart draws; its numbers may be packed."""
    drawn = [one for one in page.figures()[place]["data"] if one["mode"] != "text"]
    known = [x for one in drawn for x in numbers(one["x"]) if x is not None and isfinite(x)]
    return min(known), max(known)


def traces(page: Page, place: int) -> list[str]:
    """The names in the upper panel of a chart."""
    return [one["name"] for one in page.figures()[place]["data"] if one.get("yaxis") == "y"]


MAP = "Map of speeds"


@pytest.mark.usefixtures("fresh_server")
class TestPage:
    def test_a_published_example_drives_before_anything_was_trained(self) -> None:
        page = open_page(PLATOON, with_example())
        said = page.plain()
        assert page.widget("platoon_frequency").value == pytest.approx(0.2189)
        assert "The oscillation grows to 2.44 times the leader's" in said
        assert len(page.get("plotly_chart")) == 3
        assert page.selectbox(key="platoon_kind").options == ["Sinusoid", "Step", "Brake"]
        assert "[m/s]" in page.figures()[2]["layout"]["yaxis"]["title"]["text"]
        page.choose("platoon_db", True)
        assert "[dB re leader]" in page.figures()[2]["layout"]["yaxis"]["title"]["text"]
        assert "From 6 to 235 s of 500 s." in page.open_tab("platoon", MAP).plain()
        assert "From 414 to 500 s of 500 s." in page.open_tab("platoon", "Animation").plain()
        said = page.open_tab("platoon", "The paper's four panels").plain()
        assert "(a) Mercedes A-Class at 0.25 rad/s: grows to 4.2" in said
        assert "(d) Tesla Model 3 at 0.3 rad/s: fades to 0.42" in said
        assert len(page.get("plotly_chart")) == 6

    def test_both_charts_show_the_part_and_the_view_that_were_chosen(self) -> None:
        page = open_page(PLATOON, with_example())
        start, period = 500 - 3 * 2 * pi / 0.2189, 0.2
        for chart in page.figures()[:2]:
            assert chart["data"][0]["hovertemplate"]
        assert reach(page, 0) == pytest.approx((start, 500), abs=period)
        assert reach(page, 1) == pytest.approx((start, 500), abs=period)
        page.choose("platoon_whole", True)
        assert reach(page, 0) == reach(page, 1) == (0, 500)
        assert "at 20.0 m/s" in page.figures()[1]["layout"]["yaxis"]["title"]["text"]
        page.choose("platoon_view", "road")
        assert "on the road" in page.figures()[1]["layout"]["yaxis"]["title"]["text"]

    def test_one_vehicle_is_repeated_at_its_peak_until_a_frequency_is_given(self) -> None:
        page = open_page(PLATOON, with_example()).choose("platoon_order", "repeated")
        assert page.widget("platoon_frequency").value == pytest.approx(0.214, abs=1e-4)
        page.choose("platoon_vehicle", 2)
        page.choose("platoon_frequency", 0.25)
        gain = 4.233  # |H(0.25j)| of AstaZero's vehicle 3 to the eighth power
        assert f"grows to {gain:.3g} times" in page.plain()
        page.choose("platoon_followers", 3)
        assert "Follower 3: Mercedes A-Class" in page.plain()
        assert "Follower 4: Mercedes A-Class" not in page.plain()
        assert "grows to 1.72 times" in page.plain()
        page.choose("platoon_vehicle", 3)
        assert page.widget("platoon_frequency").value == 0.25
        page.press("platoon_peak")
        assert page.widget("platoon_frequency").value == pytest.approx(0.1059, abs=1e-4)
        page.choose("platoon_followers", 8)
        # Other vehicles begin without what was chosen among the former.
        page.choose("platoon_example", CASALE.title)
        assert page.widget("platoon_frequency").value == pytest.approx(0.0879, abs=1e-4)
        assert "Follower 8: Hyundai" in page.plain()

    def test_an_order_of_ones_own(self) -> None:
        page = open_page(PLATOON, with_example()).choose("platoon_order", "own")
        assert "Follower 8: Tesla Model 3" in page.plain(), "twice in order to begin with"
        page.choose("platoon_own", "4, 1-2")
        for name in ("1: Tesla Model 3", "2: Audi A6", "3: BMW X5"):
            assert name in page.plain()
        page.choose("platoon_own", "5")
        assert "there is no vehicle 5; give numbers from 1 to 4" in page.boxes("error")[0]
        assert not page.get("plotly_chart")

    def test_steps_brakes_and_the_recorded_leader(self) -> None:
        page = open_page(PLATOON, fitted())
        page.choose("platoon_source", "published")
        for kind, setting, plenty in (("step", "change", -20.0), ("brake", "drop", 20.0)):
            said = page.choose("platoon_kind", kind).plain()
            assert "The largest speed deviation grows to" in said
            assert "The smallest gap is" in said
            said = page.choose(f"platoon_{kind}_{setting}", plenty).plain()
            assert AFTER_COLLISION in said
            assert "times as much as the leader's; Audi A6 collides at" in said
            assert not any("collides" in box for box in page.boxes("warning")), "named once"
        session = page.workspace()
        session.segment = replace(session.segment, start=40.0)
        said = page.choose("platoon_kind", "recorded").plain()
        assert "as recorded" in said
        assert "largest speed deviation" in said
        names = [f"{label}, measured" for label in session.segment.labels[1:]]
        assert [one for one in traces(page, 0) if one in names] == names
        page.choose("platoon_measured", False)
        assert not set(names) & set(traces(page, 0))
        said = page.open_tab("platoon", MAP).plain()
        assert "From 40 to 340 s" in said, "by the recording's clock"
        page.choose("platoon_order", "repeated")
        assert page.widget("platoon_followers").value == 3, "as many as recorded"

    def test_settings_are_refused_or_warned_of_and_kept_for_mending(self) -> None:
        page = open_page(PLATOON, with_example()).choose("platoon_sinusoid_duration", -5.0)
        (error,) = page.boxes("error")
        assert "Leader: duration = -5" in error
        assert page.widget("platoon_sinusoid_duration").value == -5.0
        page.choose("platoon_sinusoid_duration", 60.0)
        assert not page.error
        assert any("transient" in warning for warning in page.boxes("warning"))
        page.choose("platoon_sinusoid_duration", 30.0)
        assert any("too short" in warning for warning in page.boxes("warning"))
        assert "From 6 to 30 s of 30 s." in page.open_tab("platoon", MAP).plain()
        page.choose("platoon_frequency", 0.0)
        assert "frequency" in page.boxes("error")[0]


def test_orders_are_numbers_and_ranges_and_others_are_refused() -> None:
    for text, order in (("1", [0]), ("1-3", [0, 1, 2]), ("3-1, 2", [2, 1, 0, 1]),
                        ("2 2,2", [1, 1, 1]), (" 1 – 2 ,, 3 ", [0, 1, 2])):  # fmt: skip
        assert parse_order(text, 3) == order
    for text, fault in (("", "there are 0"), ("a", "“a” is not a number"), ("0", "no vehicle 0"),
                        ("1-9", "1-9"), ("1,-1", "is not a number"),
                        ("1 " * 21, "there are 21")):  # fmt: skip
        with pytest.raises(ParameterError, match=f"Order of followers: .*{fault}"):
            parse_order(text, 3)


@given(some.text(max_size=30), some.integers(1, 12))
def test_any_text_is_an_order_or_a_sentence(text: str, count: int) -> None:
    with suppress(ParameterError):
        order = parse_order(text, count)
        assert order
        assert all(0 <= k < count for k in order)
