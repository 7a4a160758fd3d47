"""The app's settings: nothing leaves the computer, and its colours can be read."""

import tomllib
from pathlib import Path
from typing import Any

import pytest

CONFIG = Path(__file__).parents[2] / ".streamlit" / "config.toml"


@pytest.fixture
def config() -> dict[str, Any]:
    return tomllib.loads(CONFIG.read_text(encoding="utf-8"))


def test_nothing_leaves_the_computer(config: dict[str, Any]) -> None:
    assert config["browser"]["gatherUsageStats"] is False
    assert config["server"]["showEmailPrompt"] is False
    assert config["server"]["address"] == "localhost"


@pytest.mark.parametrize("side", ["light", "dark"])
def test_text_and_eleven_vehicles_have_enough_contrast(config: dict[str, Any], side: str) -> None:
    theme = config["theme"][side]
    for background in (theme["backgroundColor"], theme["secondaryBackgroundColor"]):
        assert contrast(theme["textColor"], background) > 7
        assert contrast(theme["linkColor"], background) > 4.5
    colours = theme["chartCategoricalColors"]
    assert len(set(colours)) == len(colours) == 11
    assert all(contrast(colour, theme["backgroundColor"]) >= 3 for colour in colours)


def contrast(one: str, other: str) -> float:
    """Contrast ratio of two #rrggbb colours, 1 to 21 (WCAG 2, relative luminance)."""
    dark, light = sorted((luminance(one), luminance(other)))
    return (light + 0.05) / (dark + 0.05)


def luminance(colour: str) -> float:
    channels = [int(colour[i : i + 2], 16) / 255 for i in (1, 3, 5)]
    linear = [c / 12.92 if c <= 0.04045 else ((c + 0.055) / 1.055) ** 2.4 for c in channels]
    return 0.2126 * linear[0] + 0.7152 * linear[1] + 0.0722 * linear[2]
