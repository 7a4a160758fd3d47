"""The frequency laboratory answers in the browser, with the numbers that Python has."""

import json
import re
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from playwright.sync_api import Page, expect

from accpinn.model.published import ASTAZERO
from accpinn.stability.criteria import response
from accpinn.stability.what_if import WhatIf
from accpinn.units import FloatArray
from pages.ui.laboratory import FOLLOWERS
from tests.browser.conftest import Open
from tests.browser.running import button, chart, idle

pytestmark = pytest.mark.browser
SLIDER = "Frequency of the leader's speed"
SHOWN = """slider => ({
    frequency: slider.getAttribute("aria-valuetext"),
    levels: [...document.querySelectorAll(".laboratory-mark text[data-curve]")]
        .map(text => text.textContent),
    last: slider.getRootNode().querySelector("svg[data-last]").dataset.last,
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


Response = Callable[[FloatArray], NDArray[np.complex128]]


def published(omega: FloatArray) -> NDArray[np.complex128]:
    """The response of the paper's cars."""
    return response(ASTAZERO.parameters, omega)


def agrees(shown: dict[str, Any], answer: Response = published) -> float:
    """Check that what is written is what Python has, to its last digit; returns the frequency."""
    omega = float(shown["frequency"].split()[0])
    levels = [float(level.split()[0].replace("−", "-")) for level in shown["levels"]]
    gains = np.abs(answer(np.array([omega]))[:, 0])
    exact = 20 * np.log10([*gains, gains.prod()])
    np.testing.assert_allclose(levels, exact, atol=0.0051)
    assert float(shown["last"]) == pytest.approx(gains[0] ** FOLLOWERS, abs=0.0051), "eight Audis"
    return omega


def follows_a_change(page: Page) -> None:
    """Check that the browser's responses of changed cars are Python's, and are taken back."""
    button(page, "What if").click()
    keys = {"Change of the time gap": 6, "Change of the delay": 5, "Feed-forward of": 8,
            "Latency of": 3}  # fmt: skip
    for name, presses in keys.items():
        slider = page.get_by_role("slider", name=name)
        for _ in range(presses):
            slider.press("ArrowRight")
    changed = WhatIf(ASTAZERO.parameters, 0.3, 0.25, 0.4, 0.15)
    slider = page.get_by_role("slider", name=SLIDER)
    omega = agrees(slider.evaluate(SHOWN), changed.response)
    gains = np.abs(changed.response(np.array([omega]))[:, 0])
    box = page.locator(".what-if")
    exact = np.array(json.loads(box.get_attribute("data-gains") or ""))
    np.testing.assert_allclose(exact, gains, rtol=1e-9)
    peaks = np.array(json.loads(box.get_attribute("data-peaks") or ""))
    np.testing.assert_allclose(peaks, changed.peaks.gain, rtol=1e-4, err_msg="on other frequencies")
    expect(box.locator("b")).to_contain_text("Largest growth")
    button(page, "Reset").click()
    agrees(slider.evaluate(SHOWN))
    expect(box.locator("b")).to_have_text("")


def test_the_slider_answers_at_once_with_pythons_numbers(opened: Open) -> None:
    page = opened("/Stability")
    button(page, "Open a published example").click()
    chart(page, "stability_bode").scroll_into_view_if_needed()
    expect(page.locator(".laboratory-mark text")).to_have_count(2 * (len(ASTAZERO) + 1) + 1)
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
    follows_a_change(page)
    page.wait_for_function("sent")
    idle(page)
    assert not page.evaluate("drawn"), "the response is drawn once"
    page.reload()
    expect(page.locator(".laboratory-mark text").first).to_be_visible()
    expect(slider).to_have_attribute("aria-valuetext", re.compile(r"^0\.25 rad/s"))
    agrees(slider.evaluate(SHOWN))
