"""Findings where the data determine the parameters weakly, and what would help."""

import numpy as np
import pytest

from accpinn.inference.identifiability import (
    WIDE,
    NarrowerIntervals,
    WeakIdentification,
    identifiability,
)
from accpinn.inference.intervals import Uncertainty, from_draws
from accpinn.model.cthp import Case, Parameters
from accpinn.segment import Segment
from accpinn.segment.quality import assess_quality
from bench.disturbed import Disturbance, disturbed
from tests.support.driving import LAW, segment_of
from tests.support.estimates import estimated

TRUTH = Parameters.of([LAW])


def uncertainty_of(*segments: Segment, case: Case = "II") -> Uncertainty:
    estimate = estimated(segments, case, "cthp")
    return from_draws(estimate.parameters, estimate.posterior.typical, 0.9)


class TestWarnings:
    def test_none_where_the_data_determine_the_parameters(self) -> None:
        segment = disturbed(TRUTH, 1, Disturbance(0.05, 4.0), duration=600.0)
        uncertainty = uncertainty_of(segment)
        assert (uncertainty.upper.values < WIDE * uncertainty.lower.values).all(), (
            "the case needs narrow intervals"
        )
        quality = assess_quality(segment)
        assert identifiability(segment.info, quality, uncertainty, "II", 1e4) == ()

    def test_a_leader_at_constant_speed(self) -> None:
        rng = np.random.default_rng(0)
        time = 0.1 * np.arange(1201)
        speeds = 20 + 0.05 * rng.standard_normal((1201, 2))
        segment = segment_of(time, speeds, 30 + 0.05 * rng.standard_normal((1201, 1)))
        uncertainty = uncertainty_of(segment)
        finding, cure = identifiability(segment.info, assess_quality(segment), uncertainty)
        assert isinstance(finding, WeakIdentification)
        assert finding.wide
        assert finding.leader_deviation == pytest.approx(0.05, abs=0.003)
        assert finding.relative_deviation == pytest.approx(0.07, abs=0.005)
        assert cure == NarrowerIntervals((2,), 120.0, None, is_excited=False)

    @pytest.mark.usefixtures("all_draws")
    @pytest.mark.parametrize("case", ["I", "II"])
    def test_where_there_is_motion_a_longer_window_is_advised(self, case: Case) -> None:
        """Case I has one finding for all."""
        segment = disturbed(Parameters.of([LAW, LAW]), 1, Disturbance(0.6, 4.0), duration=30.0)
        assert segment.speeds[:, 0].std() > 0.5
        uncertainty = uncertainty_of(segment, case=case)
        about = (segment.info, assess_quality(segment), uncertainty, case)
        *findings, cure = identifiability(*about, 1523.0)
        assert [finding.vehicle for finding in findings] == ([0] if case == "I" else [2, 3])
        assert all(finding.is_excited and finding.wide for finding in findings)
        assert cure == NarrowerIntervals((2, 3), 30.0, 1523.0, is_excited=True)
        *_, whole = identifiability(*about, 30.0)
        assert whole.recording is None, "a recording no longer than the window is no cure"
