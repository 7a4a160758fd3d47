"""Leaders: the settings that none can drive are refused."""

from collections.abc import Callable
from math import inf, nan

import pytest

from accpinn.errors import ParameterError
from accpinn.platoon.leader import Brake, Leader, Sinusoid, SpeedStep


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: Sinusoid(frequency=0.0), "frequency = 0, but it must be above zero"),
        (lambda: Sinusoid(frequency=nan), "frequency = nan is no number"),
        (lambda: Sinusoid(amplitude=-1.0), "amplitude = -1, but it must be zero or more"),
        (lambda: SpeedStep(duration=0.0), "duration = 0, but it must be above zero"),
        (lambda: Brake(deceleration=0.0), "deceleration = 0, but it must be above zero"),
        (lambda: Brake(hold=inf), "hold = inf is no number"),
    ],
)
def test_impossible_settings_are_refused(make: Callable[[], Leader], words: str) -> None:
    with pytest.raises(ParameterError, match=words):
        make()
    assert [phase.level for phase in SpeedStep(3.0).phases()] == [0, 3], "it may have either sign"
