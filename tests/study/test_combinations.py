"""Every method and preset with every model, windows, Case and fixed values: right, or refused.

A combination ends in an estimate of what was asked for, near the truth of data that were made by
that model, or in one sentence that names what can. Of the methods that take no time all are tried.
The others (`SLOW`) take seconds: of these six models each, with windows, Case and fixed values in
turn, so that each method meets one window and two, both Cases, and fixed values and none.
"""

from collections.abc import Iterator
from dataclasses import replace
from functools import cache
from itertools import cycle, product
from typing import Any

import numpy as np
import pytest

from accpinn import ModelSpec, Segment, analyse, fit
from accpinn.errors import ConfigError
from accpinn.methods.registry import METHODS, VARIANTS, variant_of
from accpinn.model.cthp import Case
from accpinn.model.registry import FOLLOWING
from accpinn.recordings.synthetic import leader_speed
from accpinn.units import FloatArray
from tests.support.driving import segment_of
from tests.support.following import LEADER

TRUTH = {
    "alpha": 0.1, "beta": 0.3, "tau": 1.2, "s0": 4.0, "lag": 0.4, "delay": 0.5,  # CTHP
    "a": 1.0, "b": 2.0, "T": 1.1, "v0": 38.0,  # IDM
    "kappa": 0.15, "relative": 0.3, "scale": 20.0, "steepness": 0.05, "middle": 20.0,  # FVDM
    "alpha_long": 0.1, "q": 1.5, "beta_opening": 0.3, "k": 1.2, "headway": 1.2,  # unequal gains
}  # fmt: skip
GAINS = ("alpha", "a", "kappa", "alpha_long")
FURTHER = 1.15
"""The gain of the second follower in Case II, by that of the first."""
SLOW = {
    "pinn": ("cthp", "cthp-s0", "cthp-lag", "cthp-delay", "cthp-s0-lag", "cthp-s0-delay"),
    **dict.fromkeys(
        ("pinn-fast", "pinn-paper", "simulation"),
        ("cthp", "cthp-s0-delay", "cthp-lag", "idm", "idm-delay", "fvdm-lag"),
    ),
}
IN_TURN: tuple[tuple[int, Case, bool], ...] = (
    (1, "II", False), (2, "I", True), (2, "II", True), (1, "I", False), (1, "I", True),
    (2, "II", False),
)  # fmt: skip
"""Number of windows, Case, and whether a parameter is fixed."""
NEAR = {
    "pinn": (0.1, 0.1, 0.01), "pinn-paper": (0.5, 0.3, 0.1), "particle": (0.4, 0.4, 0.02),
    "dual-ukf": (0.1, 0.1, 0.01),
}  # fmt: skip
"""Largest relative errors of α, β and the time gap. A lag and a delay are alike to the likelihood;
filters take the model as inexact; `paper` runs few iterations from the first follower's truth."""
NEAR_OTHERS = (0.03, 0.03, 0.01)


def able(name: str) -> tuple[str, ...]:
    """The models of a method with its settings."""
    method, config = variant_of(name)
    return tuple(METHODS[method].models(config.to_json() if config else {}))


def fixed_value(model: str) -> dict[str, float]:
    """The last parameter that may be fixed, at its true value; none of the paper's model."""
    return {name: TRUTH[name] for name in [*FOLLOWING[model].fixable][-1:]}


def truth(model: str, case: Case) -> FloatArray:
    """(2, n) the parameters of two followers."""
    names = FOLLOWING[model].names
    further = [FURTHER if name in GAINS and case == "II" else 1.0 for name in names]
    return np.array([TRUTH[name] for name in names]) * [np.ones(len(names)), further]


@cache
def windows(model: str, case: Case, count: int) -> tuple[Segment, ...]:
    """Drives of 90 s of two followers by a model, with 1 cm and 1 cm/s of noise."""
    following, theta, made = FOLLOWING[model], truth(model, case), []
    for seed in range(count):
        rng, instants = np.random.default_rng(seed), np.arange(0.0, 90.05, 0.1)
        ahead = leader_speed(LEADER, instants, rng)
        speed = float(ahead[0])
        gaps = np.array([following.equilibrium_gaps(row, speed) for row in theta])
        run = following.simulate(theta.T, instants, ahead, np.full(2, speed), gaps)
        noisy = [part + 0.01 * rng.standard_normal(part.shape) for part in (run.speeds, run.gaps)]
        made.append(replace(segment_of(instants, *noisy), start=1000.0 * seed))
    return tuple(made)


def chosen(name: str, model: str) -> dict[str, Any]:
    """The method of a name, its preset, and few iterations where many would take minutes."""
    method, config = variant_of(name)
    given: dict[str, Any] = {"method": method, "preset": config.preset if config else None}
    if name == "pinn-paper":
        first = truth(model, "I")[0].tolist()
        nonlinear = [] if FOLLOWING[model].is_linear else [1, 1, 1, 0, 0, 0, *first]
        given["settings"] = {"iterations": 20, "initial": nonlinear or first[:3]}
    return given


def combinations() -> Iterator[Any]:
    for name in VARIANTS:
        if name in SLOW:
            yield from ((name, m, *which) for m, which in zip(SLOW[name], cycle(IN_TURN)))
            continue
        for model, count, case in product(able(name), (1, 2), ("I", "II")):
            yield from (
                (name, model, count, case, is_fixed)
                for is_fixed in (False, True)
                if not is_fixed or FOLLOWING[model].fixable
            )


@pytest.mark.parametrize(("name", "model", "count", "case", "is_fixed"), [*combinations()])
def test_an_estimate_is_of_what_was_asked_for_and_near_the_truth(
    name: str, model: str, count: int, case: Case, is_fixed: bool
) -> None:
    segments, fixed = windows(model, case, count), fixed_value(model) if is_fixed else {}
    result = fit(segments, case=case, model=model, fixed=fixed, **chosen(name, model))
    estimate = result.estimate
    assert (estimate.spec, estimate.case) == (ModelSpec.of(model, fixed), case)
    assert (estimate.method, estimate.settings.get("preset")) == tuple(
        chosen(name, model).values()
    )[:2]
    assert [info.window for info in result.infos] == [segment.window for segment in segments]
    assert len(estimate.curves) in (0, count)
    for parameter, value in fixed.items():
        np.testing.assert_allclose(
            estimate.values(estimate.parameters, parameter), value, rtol=1e-12
        )
    for k, theta in enumerate(truth(model, case)):
        speed = float(estimate.speeds[k])
        near = FOLLOWING[model].linearised(theta, speed)
        gap = float(FOLLOWING[model].equilibrium_gaps(theta, speed)) / speed
        values = [span.value for span in estimate.gains_and_gap(k)]
        off = np.abs(np.array(values) / [near.alpha, near.beta, gap] - 1.0)
        assert (off <= NEAR.get(name, NEAR_OTHERS)).all(), off
    values = [estimate.values(estimate.parameters, name) for name in estimate.names]
    assert case == "II" or all(first == second for first, second in values)


@pytest.mark.parametrize("name", VARIANTS)
def test_what_a_method_cannot_estimate_is_refused_in_a_sentence_that_names_what_can(
    name: str,
) -> None:
    segments = windows("cthp", "II", 1)
    for model in FOLLOWING.keys() - set(able(name)):
        with pytest.raises(ConfigError) as refusal:
            fit(segments, model=model, **chosen(name, model))
        sentence = str(refusal.value)
        assert f"cannot estimate {model};" in sentence
        assert f"For {model} choose the method simulation" in sentence
        assert model in able("simulation")
        assert sentence.count(". ") == 1, "what is wrong, and what can"
    for model in able(name):
        with pytest.raises(ConfigError, match=rf"fixed: .* cannot be fixed; {model} has "):
            analyse(segments, model=model, fixed={"nothing": 1.0}, **chosen(name, model))
