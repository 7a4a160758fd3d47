"""The frequency laboratory answers in the browser, with the numbers that Python has."""

import json
import re

import numpy as np
import pytest
from playwright.sync_api import Page, expect

from accpinn.model.published import ASTAZERO
from accpinn.stability.criteria import response
from accpinn.stability.what_if import WhatIf
from pages.ui.laboratory import FOLLOWERS
from tests.browser.conftest import Open
from tests.browser.running import chart, idle

pytestmark = pytest.mark.browser
ANSWER_MS, STEPS = 150, 20
"""Limit of the best answer to so many steps of the slider, from the key to both charts' paint."""
TIMES = """() => {
    window.answers = [];
    window.drawn = 0;
    document.querySelector(".st-key-stability_bode .js-plotly-plot")
        .on("plotly_afterplot", () => window.drawn++);
    addEventListener("keydown", event => requestAnimationFrame(() => {
        const channel = new MessageChannel();  // after the paint
        channel.port1.onmessage = () => window.answers.push(performance.now() - event.timeStamp);
        channel.port2.postMessage(0);
    }), { capture: true });
}"""
REPORTED_MS = 800
"""Time after which the server knows where the slider was left."""
SLIDER = "Frequency of the leader's speed"


def shown(page: Page) -> tuple[float, list[float], float]:
    """The frequency, what is written of the response there, and of the last car's amplitude."""
    text = page.get_by_role("slider", name=SLIDER).get_attribute("aria-valuetext") or ""
    levels = page.locator(".laboratory-mark text[data-curve]").all_text_contents()
    waves = page.get_by_role("img", name="Speeds of the cars")
    numbers = [float(level.split()[0].replace("−", "-")) for level in levels]
    return float(text.split()[0]), numbers, float(waves.get_attribute("data-last") or "nan")


def agrees(page: Page) -> None:
    """Check that what is written is what Python has, to its last digit."""
    omega, levels, last = shown(page)
    gains = np.abs(response(ASTAZERO.parameters, np.array([omega]))[:, 0])
    exact = 20 * np.log10([*gains, gains.prod()])
    np.testing.assert_allclose(levels, exact, atol=0.0051)
    assert last == pytest.approx(gains[0] ** FOLLOWERS, abs=0.0051), "eight Audis"


def follows_a_change(page: Page) -> None:
    """Check that the browser's responses of changed cars are Python's, and are taken back."""
    page.get_by_role("button", name="What if").click()
    keys = {"Change of the time gap": 6, "Change of the delay": 5, "Feed-forward of": 8,
            "Latency of": 3}  # fmt: skip
    for name, presses in keys.items():
        slider = page.get_by_role("slider", name=name)
        for _ in range(presses):
            slider.press("ArrowRight")
    changed = WhatIf(ASTAZERO.parameters, 0.3, 0.25, 0.4, 0.15)
    omega, levels, last = shown(page)
    gains = np.abs(changed.response(np.array([omega]))[:, 0])
    np.testing.assert_allclose(levels, 20 * np.log10([*gains, gains.prod()]), atol=0.0051)
    assert last == pytest.approx(gains[0] ** FOLLOWERS, abs=0.0051)
    box = page.locator(".what-if")
    exact = np.array(json.loads(box.get_attribute("data-gains") or ""))
    np.testing.assert_allclose(exact, gains, rtol=1e-9)
    peaks = np.array(json.loads(box.get_attribute("data-peaks") or ""))
    np.testing.assert_allclose(peaks, changed.peaks.gain, rtol=1e-4, err_msg="on other frequencies")
    expect(box.locator("b")).to_contain_text("Largest growth")
    page.get_by_role("button", name="Reset").click()
    agrees(page)
    expect(box.locator("b")).to_have_text("")


def test_the_slider_answers_at_once_with_pythons_numbers(opened: Open) -> None:
    page = opened("/Stability")
    page.get_by_role("button", name="Open a published example").click()
    chart(page, "stability_bode").scroll_into_view_if_needed()
    expect(page.locator(".laboratory-mark text")).to_have_count(2 * (len(ASTAZERO) + 1) + 1)
    idle(page)
    agrees(page)
    slider = page.get_by_role("slider", name=SLIDER)
    before = slider.get_attribute("aria-valuetext")
    slider.focus()
    page.evaluate(TIMES)
    for _ in range(STEPS):
        page.keyboard.press("ArrowRight")
    page.wait_for_function(f"answers.length >= {STEPS}")
    answers = page.evaluate("answers")
    print(f"{min(answers):.0f} ms at best, {np.median(answers):.0f} ms in the middle")
    assert min(answers) <= ANSWER_MS
    assert slider.get_attribute("aria-valuetext") != before
    agrees(page)
    button = page.get_by_role("button", name="0.25", exact=True)
    button.click()
    expect(button).to_have_attribute("aria-pressed", "true")
    assert shown(page)[0] == 0.25
    agrees(page)
    follows_a_change(page)
    page.wait_for_timeout(REPORTED_MS)
    idle(page)
    assert not page.evaluate("drawn"), "the response is drawn once"
    page.reload()
    expect(page.locator(".laboratory-mark text").first).to_be_visible()
    expect(slider).to_have_attribute("aria-valuetext", re.compile(r"^0\.25 rad/s"))
    agrees(page)
