"""The frequency laboratory answers in the browser, with the numbers that Python has."""

import re
from typing import Any

import numpy as np
import pytest
from playwright.sync_api import expect

from accpinn.model.published import ASTAZERO
from accpinn.stability.criteria import response
from pages.ui.laboratory import FOLLOWERS
from tests.browser.conftest import Open
from tests.browser.running import button, chart, idle

pytestmark = pytest.mark.browser
SLIDER = "Frequency of the leader's speed"
SHOWN = """slider => ({
    frequency: slider.getAttribute("aria-valuetext"),
    levels: [...document.querySelectorAll(".laboratory-mark text[data-curve]")]
        .map(text => text.textContent),
    last: slider.getRootNode().querySelector("svg").dataset.last,
})"""
"""The frequency, what is written of the response there, and of the last car's amplitude."""
STEPPED = f"""slider => Array.from({{length: 20}}, () => {{
    slider.stepUp();
    slider.dispatchEvent(new Event("input"));
    return ({SHOWN})(slider);
}})"""
"""The same after each step of the slider: within one task, so that no server can have helped."""
COUNTED = """() => {
    window.drawn = window.sent = 0;
    document.querySelector(".st-key-stability_bode .js-plotly-plot")
        .on("plotly_afterplot", () => window.drawn++);
    const send = WebSocket.prototype.send;
    WebSocket.prototype.send = function (message) {
        window.sent++;
        send.call(this, message);
    };
}"""
"""From now on, count how often the response is drawn and how often the server is told something."""


def agrees(shown: dict[str, Any]) -> float:
    """Check that what is written is what Python has, to its last digit; returns the frequency."""
    omega = float(shown["frequency"].split()[0])
    levels = [float(level.split()[0].replace("−", "-")) for level in shown["levels"]]
    gains = np.abs(response(ASTAZERO.parameters, np.array([omega]))[:, 0])
    exact = 20 * np.log10([*gains, gains.prod()])
    np.testing.assert_allclose(levels, exact, atol=0.0051)
    assert float(shown["last"]) == pytest.approx(gains[0] ** FOLLOWERS, abs=0.0051), "eight Audis"
    return omega


def test_the_slider_answers_at_once_with_pythons_numbers(opened: Open) -> None:
    page = opened("/Stability")
    button(page, "Open a published example").click()
    chart(page, "stability_bode").scroll_into_view_if_needed()
    expect(page.locator(".laboratory-mark text")).to_have_count(2 * (len(ASTAZERO) + 1))
    idle(page)
    slider = page.get_by_role("slider", name=SLIDER)
    before = agrees(slider.evaluate(SHOWN))
    page.evaluate(COUNTED)
    slider.press("ArrowRight")
    frequencies = [agrees(slider.evaluate(SHOWN)), *map(agrees, slider.evaluate(STEPPED))]
    assert (np.diff([before, *frequencies]) > 0).all()
    chip = button(page, "0.25", exact=True)
    chip.click()
    expect(chip).to_have_attribute("aria-pressed", "true")
    assert agrees(slider.evaluate(SHOWN)) == 0.25
    page.wait_for_function("sent")
    idle(page)
    assert not page.evaluate("drawn"), "the response is drawn once"
    page.reload()
    expect(page.locator(".laboratory-mark text").first).to_be_visible()
    expect(slider).to_have_attribute("aria-valuetext", re.compile(r"^0\.25 rad/s"))
    agrees(slider.evaluate(SHOWN))
