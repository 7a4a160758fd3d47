"""Platoons that drive by a model of the registry, as segments."""

from dataclasses import replace

import numpy as np

from accpinn.model.following import FollowingModel
from accpinn.model.registry import FOLLOWING
from accpinn.recordings.synthetic import LeaderProfile, leader_speed
from accpinn.segment import Segment
from accpinn.units import FloatArray, Seconds
from tests.support.driving import segment_of

CTHPS = tuple(key for key, model in FOLLOWING.items() if model.is_linear)
"""The paper's model, and those with terms beside it."""
LEADER = LeaderProfile(24.0, 6.0, 33.0, (8.0, 20.0), (0.5, 1.5), 0.2)
"""A drive over all speeds, so that the shape of a model over speed can be seen."""


def driven(
    model: FollowingModel, theta: FloatArray, seed: int, noise: float, seconds: Seconds = 150.0
) -> list[Segment]:
    """A platoon of vehicles (M, n) behind a leader as segments, one a follower."""
    rng = np.random.default_rng(seed)
    instants = np.arange(0.0, seconds + 0.05, 0.1)
    ahead = leader_speed(LEADER, instants, rng)
    speed = float(ahead[0])
    gaps = np.array([model.equilibrium_gaps(row, speed) for row in theta])
    run = model.simulate(theta.T, instants, ahead, np.full(len(gaps), speed), gaps)
    speeds = run.speeds + noise * rng.standard_normal(run.speeds.shape)
    measured = run.gaps + 2 * noise * rng.standard_normal(run.gaps.shape)
    return [
        replace(
            segment_of(instants, speeds[:, k : k + 2], measured[:, k : k + 1]),
            vehicles=(k + 1, k + 2),
            start=1000.0 * seed,
            sha256=str(seed),
        )
        for k in range(len(theta))
    ]
