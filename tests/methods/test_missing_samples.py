"""Missing samples: the likelihood leaves them out, and every other method refuses them."""

from functools import cache

import numpy as np
import pytest

from accpinn.errors import SegmentError
from accpinn.inference.intervals import intervals
from accpinn.methods.registry import METHODS
from accpinn.methods.series import measured_of, series_of
from accpinn.model.cthp import Parameters
from accpinn.segment.cut import cut
from accpinn.segment.segment import Segment
from accpinn.units import Stretch
from bench.disturbed import Disturbance, disturbed
from tests.support.driving import LAW
from tests.support.holes import with_holes
from tests.support.openacc_files import platoon, recording

BLOCKS = [Stretch(200, 499), Stretch(900, 1149), Stretch(1700, 2099), Stretch(2600, 3000)]
"""45 % of 300 s."""
OWN = {1: BLOCKS, 2: BLOCKS}
"""The follower's speed and its gap."""


@cache
def complete() -> Segment:
    return disturbed(Parameters.of([LAW]), 4, Disturbance(0.25, 4.0))


def test_the_estimate_stays_and_its_intervals_widen() -> None:
    segment = with_holes(complete(), OWN)
    fits = [METHODS["maximum-likelihood"].fit(one) for one in (complete(), segment)]
    whole, part = (intervals(*pair) for pair in zip((complete(), segment), fits, strict=True))
    widths, wider = (one.upper.values - one.lower.values for one in (whole, part))
    shift = np.abs(fits[1].parameters.values - fits[0].parameters.values)
    assert (shift < 0.5 * widths).all()
    assert (wider > 1.1 * widths).all()
    assert ((part.lower.values < LAW) & (part.upper.values > LAW)).all()


def test_too_little_that_is_measured_is_refused() -> None:
    most = [Stretch(0, 2899)]
    with pytest.raises(SegmentError, match="count and are measured"):
        series_of([with_holes(complete(), {2: most})], "II")


@pytest.mark.parametrize("key", [key for key, one in METHODS.items() if not one.allows_missing])
def test_every_other_method_refuses_them_in_one_sentence(key: str) -> None:
    frame = platoon()
    frame.loc[150:209, ["Speed2", "IVS1", "IVS2"]] = np.nan
    segment = cut(recording(frame), allow_missing=True)
    with pytest.raises(SegmentError) as caught:
        METHODS[key].fit(segment)
    sentence = str(caught.value)
    assert sentence.startswith("run.csv: Speed2 is missing at 15–20.9 s")
    assert sentence.endswith("take a window without it, or choose maximum-likelihood.")


def test_bridged_samples_serve_every_method_but_not_the_likelihood() -> None:
    frame = platoon()
    frame.loc[150:154, "Speed2"] = np.nan
    segment = cut(recording(frame))
    assert METHODS["least-squares"].fit(segment).parameters
    assert np.isnan(measured_of(segment)[30, 1, 0])
    assert np.isnan(measured_of(segment)).sum() == 2  # as own speed and as speed ahead
