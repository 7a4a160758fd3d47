"""One parameter set over several windows."""

from dataclasses import replace

import numpy as np
import pytest

from accpinn.errors import AccpinnError
from accpinn.evaluation.evaluation import part
from accpinn.model.cthp import Parameters
from accpinn.segment.segment import Segment
from accpinn.study.result import Result
from accpinn.study.run import fit_windows
from bench.disturbed import Disturbance, disturbed
from tests.support.driving import MIXED, driven

TRUTH = Parameters([0.08], [0.2], [1.3])
DURATION = 150.0


def window(seed: int) -> Segment:
    """A recording of its own, so no two of them share samples."""
    return disturbed(TRUTH, seed, Disturbance(), duration=DURATION)


@pytest.fixture(scope="module")
def same() -> Result:
    return fit_windows([window(seed) for seed in range(4)])


class TestJointFit:
    def test_windows_together_say_more_than_one_alone(self, same: Result) -> None:
        def off(parameters: Parameters) -> float:
            return float(np.abs(np.log(parameters[0].values / TRUTH[0].values)).mean())

        assert off(same.parameters) < 0.7 * np.mean([off(o.fit.parameters) for o in same.windows])
        widths = [one.uncertainty.upper.values / one.uncertainty.lower.values
                  for one in (same, *same.windows)]  # fmt: skip
        assert (widths[0] < np.min(widths[1:], axis=0)).all()
        assert same.uncertainty.inside.all()
        assert all(fit.parameters == same.parameters for fit in same.fits)
        assert same.answer.findings == ()

    def test_one_set_for_all_followers(self) -> None:
        parts = [driven(MIXED[:2], duration=60.0, noise=0.05) for _ in range(2)]
        parts[1] = replace(parts[1], start=60.0)
        joint = fit_windows(parts, "I")
        assert joint.parameters[0] == joint.parameters[1]
        assert {one.vehicle for one in joint.answer.findings} <= {0}

    def test_what_bounds_rule_out_is_that_of_all_windows(self) -> None:
        whole = driven(((0.10, -0.04, 1.8),), duration=160.0, noise=0.05)
        windows = part(whole, 0, 801), part(whole, 801, whole.samples)
        found = fit_windows(windows)
        assert found.parameters.beta[0] == 0.0
        one, other = (fit.unconstrained.values[0] for fit in found.fits)
        np.testing.assert_array_equal(one, other)
        assert one[1] == pytest.approx(-0.04, abs=0.02)


def recorded(start: float, **changes: object) -> Segment:
    """A window of one recording; short, as it is to be refused."""
    return replace(driven(), start=start, sha256="one file", **changes)


@pytest.mark.parametrize(
    ("segments", "words"),
    [
        ([], "at least two"),
        ([recorded(0.0)], "at least two"),
        ([recorded(0.0), recorded(59.0)], "0–60 s and 59–119 s overlap"),
        ([driven(), driven()], "0–60 s and 0–60 s overlap"),
        ([recorded(0.0), driven(MIXED[:2])], "2 followers"),
        ([recorded(0.0), driven(step=0.4)], "0.4 s apart"),
        ([recorded(0.0), driven(duration=15.0)], "too short"),
    ],
)
def test_segments_that_cannot_share_a_likelihood(segments: list[Segment], words: str) -> None:
    with pytest.raises(AccpinnError, match=words):
        fit_windows(segments)
