"""A simulated platoon on the road, seen from its leader, as a browser animates it."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from accpinn.channels import SPEED
from accpinn.platoon import PlatoonRun
from accpinn.results.cast import Cast
from accpinn.results.figures import style
from accpinn.results.figures.platoon import CAR_LENGTH, close_up, colours_of, samples
from accpinn.units import FloatArray

INSTANTS = 500
"""Largest number of instants; between two of them the browser moves the cars on."""
POSITION = "Position behind the leader [m], driving to the right"


def watched(run: PlatoonRun) -> NDArray[np.intp]:
    """The samples that are shown, those of the close-up."""
    return samples(run, close_up(run), INSTANTS)


def motion(run: PlatoonRun, cast: Cast) -> dict[str, Any]:
    """The motion of the cars for the browser as JSON, with the digits that a screen shows.

    Returns:
        "time" (N,) in s; of each vehicle, leader first, "places" (N,) of its front behind the
        leader's in m and "speeds" (N,) in m/s, null from a collision on; the leader's "way" (N,) in
        m; names, numbers and colours; the cars' "length" in m.
    """
    driven, rows = run.valid, watched(run)
    behind = np.zeros((len(rows), len(cast.labels)))
    behind[:, 1:] = -np.cumsum(driven.gaps[rows] + CAR_LENGTH, axis=1)
    from scipy.integrate import cumulative_trapezoid  # takes a while, which few need

    way = cumulative_trapezoid(driven.speeds[:, 0], driven.time, initial=0)[rows]
    return {
        "time": driven.time[rows].round(3).tolist(),
        "places": _rounded(behind, 2),
        "speeds": _rounded(driven.speeds[rows], 3),
        "way": (way - way[0]).round(2).tolist(),
        "names": [*cast.labels],
        "numbers": [*cast.numbers],
        "colours": colours_of(cast),
        "length": CAR_LENGTH,
        "position": POSITION,
        "speed": SPEED.axis,
        "grid": style.GRID,
    }


def _rounded(values: FloatArray, digits: int) -> list[list[float | None]]:
    """The columns of a table as JSON has them; null for a vehicle that has collided."""
    return [[None if v != v else v for v in row] for row in values.T.round(digits).tolist()]
