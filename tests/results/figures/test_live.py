"""The charts of a training while it runs: constant specifications, and the present data."""

import numpy as np
import pytest

from accpinn.model.cthp import Parameters, Trajectories
from accpinn.results.figures import live
from accpinn.segment.cut import cut
from accpinn.segment.segment import Segment
from tests.results.figures.test_training import history
from tests.support.openacc_files import recording


@pytest.fixture
def segment() -> Segment:
    return cut(recording(), 0.0, 30.0)


def test_only_the_data_change_from_one_moment_to_the_next(segment: Segment) -> None:
    truth = Parameters.of([[0.1, 0.2, 1.2], [0.11, 0.21, 1.21]])
    early = live.live_history(history(moments=3), segment.info, truth, solved=truth)
    late = live.live_history(history(), segment.info, truth, solved=truth)
    assert [chart.spec for chart in early] == [chart.spec for chart in late]
    loss, alpha, _, tau = late
    assert {"total", "data", "physics"} <= {*loss.data["of"]}
    assert (loss.data["x"] >= 1).all(), "a logarithmic axis has no zero"
    assert {*alpha.data["kind"]} == {"now", "truth", "least squares"}
    ends = tau.data[tau.data["kind"] == "truth"].groupby("of")["y"].unique()
    assert sorted(float(value) for (value,) in ends) == [1.2, 1.21]


def test_case_one_has_one_line_for_all(segment: Segment) -> None:
    _, alpha, *_ = live.live_history(history(sets=1), segment.info)
    assert len({*alpha.data["of"]}) == 1


def test_curves_are_thinned_and_on_the_recording_s_clock(segment: Segment) -> None:
    now = Trajectories(segment.time, segment.speeds + 1, segment.gaps + 2)
    gap, speed = live.live_motion(segment, 1, now)
    for chart, shift in ((gap, 2.0), (speed, 1.0)):
        assert len(chart.data) <= 2.2 * live.DRAWN
        assert chart.data["x"].min() == segment.start
        data, network = (chart.data[chart.data["of"] == name] for name in ("data", "network"))
        assert np.isclose(network["y"].max() - data["y"].max(), shift)
