"""The answer as figures: what the joint plot draws."""

import numpy as np
import pytest

import accpinn
from accpinn.results.figures.answer import DRAWN, joint
from tests.support.command import STUDY


@pytest.mark.parametrize(("model", "panels"), [("cthp", 3), ("cthp-s0-delay", 6)])
def test_each_pair_of_parameters_has_a_panel(model: str, panels: int) -> None:
    answer = accpinn.fit(STUDY, 0, 60, method="least-squares", model=model).answer
    figure = joint(answer, 0, "#123456")
    clouds = [trace for trace in figure.data if len(trace.x) == DRAWN]
    points = [trace for trace in figure.data if len(trace.x) == 1]
    assert len(clouds) == len(points) == panels
    assert len({(cloud.xaxis, cloud.yaxis) for cloud in clouds}) == panels
    assert (points[0].x[0], points[0].y[0]) == (answer.parameters.alpha, answer.parameters.beta)
    assert np.isin(clouds[0].x, answer.typical.alpha[:, 0]).all()
    titles = [axis.title.text for axis in figure.select_yaxes() if axis.title.text]
    assert len(titles) == (2 if model == "cthp" else 3)
