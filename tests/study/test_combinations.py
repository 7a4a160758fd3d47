"""Every method and preset with every model, windows, Case and fixed values: right, or refused.

A combination ends in an estimate of what was asked for, near the truth of data that were made by
that model, or in one sentence that names what can estimate the model. All combinations of methods
that take no time are tried; of the others each model, with windows, Case and fixed values in turn,
so that every method meets each of these with a CTHP and with a nonlinear model.
"""

from dataclasses import replace
from functools import cache
from itertools import product
from typing import Any

import numpy as np
import pytest

from accpinn import ModelSpec, Segment, fit
from accpinn.errors import ConfigError
from accpinn.methods.estimate import Outcome
from accpinn.methods.registry import METHODS, VARIANTS, variant_of
from accpinn.model.cthp import Case
from accpinn.model.registry import FOLLOWING
from accpinn.recordings.synthetic import leader_speed
from tests.support.driving import segment_of
from tests.support.following import LEADER

TRUTH = {
    "alpha": 0.1, "beta": 0.3, "tau": 1.2, "s0": 4.0, "lag": 0.4, "delay": 0.5,  # CTHP
    "a": 1.0, "b": 2.0, "T": 1.1, "v0": 38.0,  # IDM
    "kappa": 0.15, "relative": 0.3, "scale": 20.0, "steepness": 0.05, "middle": 20.0,  # FVDM
}  # fmt: skip
FURTHER = 1.15
"""The gains of the second follower in Case II, by those of the first."""
GAINS = ("alpha", "a", "kappa")
FIXED = {"cthp": "", "idm": "v0", "fvdm": "middle"}
"""The parameter that is fixed: of a CTHP its first term."""


def able(name: str) -> tuple[str, ...]:
    """The models of a method and its settings."""
    method, config = variant_of(name)
    return tuple(METHODS[method].models(config.to_json() if config else {}))


def thetas(model: str, case: Case) -> np.ndarray:
    """(2, n) the true parameters of two followers."""
    first = [TRUTH[name] for name in FOLLOWING[model].names]
    factors = [FURTHER if name in GAINS and case == "II" else 1.0 for name in FOLLOWING[model].names]
    return np.array([first, np.multiply(first, factors)])


@cache
def windows(model: str, case: Case, count: int) -> tuple[Segment, ...]:
    """So many drives of two followers by a model, 90 s each, with 1 cm and 1 cm/s of noise."""
    following, theta, made = FOLLOWING[model], thetas(model, case), []
    for seed in range(count):
        rng, instants = np.random.default_rng(seed), np.arange(0.0, 90.05, 0.1)
        ahead = leader_speed(LEADER, instants, rng)
        speed = float(ahead[0])
        gaps = np.array([following.equilibrium_gaps(row, speed) for row in theta])
        run = following.simulate(theta.T, instants, ahead, np.full(2, speed), gaps)
        noisy = [part + 0.01 * rng.standard_normal(part.shape) for part in (run.speeds, run.gaps)]
        made.append(replace(segment_of(instants, *noisy), start=1000.0 * seed))
    return tuple(made)
