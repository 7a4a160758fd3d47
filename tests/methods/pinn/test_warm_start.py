"""A training that begins where another one ended, also on another computer."""

from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from accpinn.methods.store import Store

from accpinn.errors import ConfigError
from accpinn.methods.fit import Fit, StartedFrom
from accpinn.methods.pinn.config import FAST, PAPER, PinnConfig
from accpinn.methods.pinn.request import TrainingRequest, WarmStart
from accpinn.model.cthp import Parameters
from accpinn.segment.segment import Segment
from tests.support.driving import MIXED, driven
from tests.support.methods import train

PAPER_SHORT = replace(PAPER, iterations=40)
FAST_SHORT = replace(FAST, iterations=60)


@cache
def segment() -> Segment:
    return driven(noise=0.05)


@cache
def cold(config: PinnConfig) -> Fit:
    return train(segment(), "II", config, threads=1)


def warm(fit: Fit) -> WarmStart:
    return WarmStart.of(fit, "snapshot abc")


def first_loss(fit: Fit) -> float:
    return float(fit.history.total[0])


@pytest.mark.parametrize("config", [PAPER_SHORT, FAST_SHORT], ids=["paper", "fast"])
def test_begins_where_the_other_ended(config: PinnConfig) -> None:
    before = cold(config)
    after = train(segment(), "II", config, threads=1, warm=warm(before))
    assert first_loss(after) == pytest.approx(before.loss["total"], rel=1e-6)
    assert first_loss(after) < first_loss(before)
    assert after.loss["total"] < 1.01 * before.loss["total"]
    assert StartedFrom("snapshot abc") in after.findings
    assert after.history.parameters[0] == before.parameters


def test_one_set_of_parameters_from_several() -> None:
    platoon = driven(MIXED, noise=0.05)
    config = replace(PAPER, iterations=5)
    several = train(platoon, "II", config, threads=1)
    one = train(platoon, "I", config, threads=1, warm=warm(several))
    np.testing.assert_allclose(
        one.history.parameters.values[0, 0], several.parameters.values.mean(axis=0)
    )


def test_is_never_taken_for_a_cold_one(tmp_path: Path) -> None:
    store, config = Store(tmp_path), PAPER_SHORT
    start = warm(cold(config))
    train(segment(), "II", config, threads=1, store=store)
    after = train(segment(), "II", config, threads=1, store=store, warm=start)
    assert not after.cached
    again = train(segment(), "II", config, threads=1, store=store, warm=start)
    assert again.cached
    assert again.parameters.values.tobytes() == after.parameters.values.tobytes()
    other = WarmStart(start.arrays, Parameters.of(start.parameters.values + 1e-9), start.origin)
    requests = [TrainingRequest(segment(), "II", config, begin) for begin in (None, start, other)]
    keys = {key for request in requests for key in request.keys}
    assert len(keys) == 6


@pytest.mark.parametrize("config", [PAPER_SHORT, FAST_SHORT], ids=["paper", "fast"])
def test_what_does_not_fit_is_refused_in_one_sentence(config: PinnConfig) -> None:
    other = FAST_SHORT if config is PAPER_SHORT else PAPER_SHORT
    good = warm(cold(config))
    shorter = {name: values[..., :-1] for name, values in good.arrays.items()}
    for start in (
        warm(cold(other)),
        WarmStart({}, good.parameters, "nothing"),
        WarmStart(shorter, good.parameters, "a smaller one"),
    ):
        with pytest.raises(ConfigError, match="do not fit this network"):
            train(segment(), "II", config, threads=1, warm=start)
    with pytest.raises(ConfigError, match="3 followers"):
        train(
            segment(),
            "II",
            config,
            warm=WarmStart(good.arrays, Parameters.of(np.ones((3, 3))), "three"),
        )


def test_fast_weights_of_another_window_are_refused() -> None:
    with pytest.raises(ConfigError, match="do not fit"):
        train(driven(duration=30.0), "II", FAST_SHORT, threads=1, warm=warm(cold(FAST_SHORT)))
