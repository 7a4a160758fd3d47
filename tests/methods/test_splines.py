"""Generalised smoothing with splines: the optimum of its loss, and published limits."""

import numpy as np
import pytest
from scipy.interpolate import make_lsq_spline

from accpinn.methods import splines
from tests.support.driving import MIXED, driven


class TestSplines:
    def test_loss_is_that_of_its_trajectories(self) -> None:
        """A spline through the trajectories has their derivatives."""
        segment = driven(MIXED, noise=0.05)
        fit = splines.fit(segment)
        time = segment.time
        knots = np.r_[[0.0] * 4, np.linspace(0, 60, 121), [60.0] * 4]
        speeds, gaps = fit.surrogate.speeds, fit.surrogate.gaps
        dv = make_lsq_spline(time, speeds, knots, 4).derivative()(time)
        dp = make_lsq_spline(time, gaps, knots, 4).derivative()(time)
        relative = speeds[:, :-1] - speeds[:, 1:]
        alpha, beta, tau = fit.parameters.values.T
        model = alpha * (gaps - tau * speeds[:, 1:]) + beta * relative
        physics = ((dp - relative) ** 2).sum() + ((dv[:, 1:] - model) ** 2).sum()
        assert fit.loss["physics"] == pytest.approx(physics / (segment.samples * 3), rel=1e-6)
        data = ((speeds - segment.speeds) ** 2).sum() + ((gaps - segment.gaps) ** 2).sum()
        assert fit.loss["data"] == pytest.approx(data / (segment.samples * 3), rel=1e-12)
        assert fit.loss["total"] == fit.loss["data"] + fit.loss["physics"]
