"""The measured gain as a figure: points, bars and the model's curve."""

import numpy as np

from accpinn.model.published import ASTAZERO
from accpinn.results.figures.stability import Model, measured_bode
from accpinn.stability.frequency import response
from accpinn.stability.measured_gain import measured_gain
from tests.support.figures import legend, named
from tests.support.samples import PLATOON, sample


def test_points_with_bars_stand_beside_the_models_curve() -> None:
    found, audi = measured_gain(sample(PLATOON).segment, 0), ASTAZERO.parameters[0]
    figure = measured_bode(found, "<2> Audi", "#0c7eae", Model("Audi", audi))
    points = named(figure, "&lt;2&gt; Audi, measured")
    clear = found.coherent
    np.testing.assert_array_equal(points.x, found.omega[clear])
    np.testing.assert_allclose(points.y, 20 * np.log10(found.gain[clear]))
    upper = 10 ** ((np.asarray(points.y) + points.error_y.array) / 20)
    np.testing.assert_allclose(upper, found.upper[clear])
    faint = named(figure, "&lt;2&gt; Audi, measured, not coherent")
    assert len(faint.x) == (~clear).sum()
    assert faint.opacity < points.opacity
    curve = named(figure, "Audi, model")
    gain = np.abs(response(ASTAZERO.parameters[:1], np.asarray(curve.x)))[0]
    np.testing.assert_allclose(curve.y, 20 * np.log10(gain))
    assert len(legend(figure)) == 3


def test_a_band_is_drawn_from_posterior_samples() -> None:
    found = measured_gain(sample(PLATOON).segment, 1)
    without = measured_bode(found, "BMW", "#d8660c")
    draws = ASTAZERO.parameters
    figure = measured_bode(found, "BMW", "#d8660c", Model("BMW", draws[1], draws))
    (area,) = (trace for trace in figure.data if trace.fill == "toself")
    assert np.isfinite(area.y).all()
    assert not any(trace.fill or "model" in trace.name for trace in without.data)
