"""Figures of car-following models: the peak gain over speed is that of each linearisation."""

import numpy as np

from accpinn.model.registry import FOLLOWING
from accpinn.results.figures.models import SPEEDS, Follower, peak_over_speed
from accpinn.stability.report import stability_at
from tests.support.figures import rectangles

IDM = np.array([0.6, 1.6, 0.9, 3.0, 45.0])


def test_the_peak_gain_over_speed_has_its_band_and_the_recorded_speeds() -> None:
    model = FOLLOWING["idm"]
    draws = IDM * np.exp(0.05 * np.random.default_rng(0).standard_normal((200, 5)))
    figure = peak_over_speed([Follower("A <b>", "#0c7eae", model, IDM, draws)], (15.0, 25.0), 20.0)
    band, curve = figure.data
    assert curve.name == "A &lt;b&gt;"
    lower, upper = band.y[:SPEEDS], band.y[SPEEDS:][::-1]
    assert (lower <= curve.y).all()
    assert (curve.y <= upper).all()
    assert lower[0] < curve.y[0] < upper[0]
    for kmh, peak in list(zip(curve.x, curve.y, strict=True))[::6]:
        np.testing.assert_allclose(peak, stability_at(model, IDM, kmh / 3.6).peak.db)
    (recorded,) = rectangles(figure)
    np.testing.assert_allclose([recorded.x0, recorded.x1], [54.0, 90.0])
    assert figure.layout.yaxis.range[1] > upper.max()
