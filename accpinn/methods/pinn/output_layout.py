"""Where speeds and space-gaps stand among the network's outputs."""

import numpy as np

from accpinn.units import FloatArray


def output_columns(followers: int) -> tuple[list[int], list[int]]:
    """Where speeds (M+1) and space-gaps (M) stand among the outputs v_0, v_1, p_1, v_2, p_2, ..."""
    return [0, *range(1, 2 * followers, 2)], list(range(2, 2 * followers + 1, 2))


def stack_outputs(speeds: FloatArray, gaps: FloatArray) -> FloatArray:
    """(N, M+1) speeds and (N, M) gaps as (N, 2M+1) in the order of `output_columns`."""
    followers = gaps.shape[1]
    stacked = np.empty((len(gaps), 2 * followers + 1))
    speed_columns, gap_columns = output_columns(followers)
    stacked[:, speed_columns], stacked[:, gap_columns] = speeds, gaps
    return stacked
