"""Leaders: the settings that none can drive are refused."""

from collections.abc import Callable
from math import inf, nan

import numpy as np
import pytest

from accpinn.errors import ParameterError
from accpinn.platoon.leader import Brake, Leader, Recorded, Sinusoid, SpeedStep


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: Sinusoid(frequency=0.0), "frequency = 0, but it must be above zero"),
        (lambda: Sinusoid(frequency=nan), "frequency = nan is no number"),
        (lambda: Sinusoid(amplitude=-1.0), "amplitude = -1, but it must be zero or more"),
        (lambda: SpeedStep(duration=0.0), "duration = 0, but it must be above zero"),
        (lambda: Brake(deceleration=0.0), "deceleration = 0, but it must be above zero"),
        (lambda: Brake(hold=inf), "hold = inf is no number"),
        (lambda: Recorded(np.arange(3.0), np.arange(2.0)), "as many speeds as instants"),
        (lambda: Recorded(np.arange(2.0), np.array([20, nan])), "numbers are missing"),
        (lambda: Recorded(np.array([0, 1, 3.0]), np.ones(3)), "not evenly spaced"),
    ],
)
def test_impossible_settings_are_refused(make: Callable[[], Leader], words: str) -> None:
    with pytest.raises(ParameterError, match=words):
        make()
    assert [phase.level for phase in SpeedStep(3.0).phases()] == [0, 3], "it may have either sign"
