"""The answer on string stability: its counts, and how certain it is."""

import math
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from accpinn.inference.intervals import Interval
from accpinn.model.cthp import Parameters
from accpinn.model.published import ParameterSet
from accpinn.results.messages.stability import amplification, certainty
from accpinn.stability.report import stability_report

CALM, LOUD = Parameters(0.05, 0.6, 1.8), Parameters(0.08, 0.12, 1.5)
UNDAMPED = Parameters(0.04, 0.0, 0.0)


def named(*vehicles: Parameters) -> ParameterSet:
    names = tuple(f"V{k}" for k in range(1, len(vehicles) + 1))
    return ParameterSet("Mine", names, Parameters.stack(vehicles))


@pytest.mark.parametrize(
    ("vehicles", "sentence"),
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
def test_the_headline_counts(vehicles: tuple[Parameters, ...], sentence: str) -> None:
    chosen = named(*vehicles)
    assert sentence in amplification(chosen, stability_report(chosen.parameters))


@pytest.mark.parametrize(
    ("stable", "gapless", "said"),
    [
        (0.01, 0.0, "certain: at least 95 %"),
        (0.01, 0.09, "90 % amplify, 1 % do not, 9 % have no gap control"),
        (0.60, 0.0, "40 % amplify, 60 % do not."),
        (math.nan, math.nan, "do not determine whether V1"),
    ],
)
def test_certainty_counts_posterior_samples(stable: float, gapless: float, said: str) -> None:
    chosen = named(LOUD)
    ends = Interval(np.array([1.0]), np.array([1.53]))
    uncertainty: Any = SimpleNamespace(
        level=0.9,
        probability_l2=np.array([stable]),
        no_gap_control=np.array([gapless]),
        peak_gain=ends,
        inside=np.array([[True, False, True]]),
    )
    sentence = certainty(chosen, stability_report(chosen.parameters), uncertainty)
    assert said in sentence
    assert "outside their intervals: β." in sentence
    assert ("90 % interval: 1.00 to 1.53" in sentence) == (stable == stable)
