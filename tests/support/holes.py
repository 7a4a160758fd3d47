"""Segments with samples removed, for tests of what is done where nothing was measured."""

from dataclasses import replace

import numpy as np

from accpinn.segment import BlocksMissing, Segment
from accpinn.units import Stretch

FALSE_VALUE = 1e3
"""Stands where nothing was measured: whoever reads it is far off."""


def with_holes(segment: Segment, columns: dict[int, list[Stretch]]) -> Segment:
    """The segment without some samples.

    Args:
        segment: complete.
        columns: by channel, speeds (M+1) and then gaps (M), the samples to remove.
    """
    values = np.hstack([segment.speeds, segment.gaps])
    missing = np.zeros(values.shape, bool)
    found = []
    for column, blocks in columns.items():
        for block in blocks:
            missing[block.rows, column] = True
        windows = tuple(segment.window for _ in blocks)
        found.append(BlocksMissing((f"channel {column}",), missing[:, column].mean(), windows))
    values[missing] = FALSE_VALUE
    speeds, gaps = np.split(values, [len(segment.vehicles)], axis=1)
    return replace(segment, speeds=speeds, gaps=gaps, missing=missing, findings=tuple(found))
