"""String stability at a speed: the CTHP's is the same at all, that of other models is not."""

import numpy as np
import pytest

from accpinn.model.registry import FOLLOWING
from accpinn.stability.report import peak_gains, stability_at, stability_report


def test_the_cthp_is_the_same_at_every_speed() -> None:
    model = FOLLOWING["cthp-s0-delay"]
    gains = peak_gains(model, model.typical, [10.0, 20.0, 30.0])
    assert np.ptp(gains) < 1e-9
    (given,) = stability_report(model.linearised(model.typical, 20.0)[None]).vehicles
    assert gains[0] == pytest.approx(given.peak.db)


def test_a_nonlinear_model_has_its_own_at_each_speed_below_its_desired_one() -> None:
    model = FOLLOWING["idm"]
    theta = model.typical
    speeds = np.array([10.0, 20.0, 30.0, 60.0])
    gains = peak_gains(model, theta, speeds)
    assert np.isnan(gains[3])
    assert stability_at(model, theta, 60.0) is None
    for speed, gain in zip(speeds[:3], gains, strict=False):
        assert stability_at(model, theta, speed).peak.db == pytest.approx(gain)
    assert np.ptp(gains[:3]) > 0.1
