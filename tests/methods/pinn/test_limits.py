"""Windows so long that a training would not fit into memory."""

import re
from dataclasses import replace

import numpy as np
import pytest

from accpinn.errors import SegmentError
from accpinn.methods import Law
from accpinn.methods.pinn.config import FAST, PinnConfig, preset
from accpinn.methods.pinn.training import require_memory
from accpinn.methods.registry import METHODS
from accpinn.segment.segment import Segment
from tests.support.driving import segment_of
from tests.support.methods import train


def of_length(duration: float, step: float = 0.1, masked: bool = False) -> Segment:
    """A segment of nothing in particular."""
    time = step * np.arange(round(duration / step) + 1)
    segment = segment_of(time, np.zeros((len(time), 2)), np.ones((len(time), 1)))
    mask = np.zeros((len(time), 1), bool) if masked else None
    return replace(segment, mask=mask)


@pytest.mark.parametrize("masked", [False, True])
@pytest.mark.parametrize(
    "config",
    [preset("fast"), preset("fast", highest_frequency=2.0), preset("calibrated"), preset("paper")],
)
@pytest.mark.parametrize("model", ["cthp", "idm", "idm-delay"])
def test_the_longest_window_named_is_allowed(config: PinnConfig, masked: bool, model: str) -> None:
    step = 0.5 if masked else 0.1
    with pytest.raises(SegmentError, match="GB of memory") as caught:
        require_memory(of_length(200_000, step, masked), config, model)
    (longest,) = re.findall(r"at most ([\d,]+) s", str(caught.value))
    seconds = float(longest.replace(",", ""))
    require_memory(of_length(seconds, step, masked), config, model)
    with pytest.raises(SegmentError):
        require_memory(of_length(1.05 * seconds, step, masked), config, model)


def test_a_training_is_refused_before_its_work() -> None:
    with pytest.raises(SegmentError, match="take at most"):
        train(of_length(15_000))
    require_memory(of_length(2_000), FAST)
    with pytest.raises(SegmentError, match="take at most"):
        METHODS["pinn"].fit(of_length(2_000), settings=FAST, law=Law("idm"))
