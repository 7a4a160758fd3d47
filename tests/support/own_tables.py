"""Tables of one's own, as people have them: a pair that drives by a known model, written anew."""

import io
from functools import cache

import numpy as np
import pandas as pd

from accpinn.units import FloatArray
from tests.support.driving import driven

LAW = (0.08, 0.3, 1.2)
"""α [1/s²], β [1/s], τ [s] of the follower."""
DURATION = 240.0


@cache
def pair(step: float = 0.1) -> tuple[FloatArray, FloatArray, FloatArray]:
    """(N,) time in s, (N, 2) speeds in m/s and (N, 1) gaps in m, with noise of 1 cm and cm/s."""
    segment = driven((LAW,), DURATION, step, noise=0.01)
    return segment.time, segment.speeds, segment.gaps


def iso_with_units() -> bytes:
    """ISO 8601 at 15 Hz, and units in the header that are not the package's."""
    time, speeds, gaps = pair(1 / 15)
    stamps = np.datetime64("2024-05-01T10:00:00", "us") + (1e6 * time).round().astype("m8[us]")
    return _csv({
        "timestamp": np.datetime_as_string(stamps, unit="ms"),
        "leader speed (km/h)": (3.6 * speeds[:, 0]).round(4),
        "ego speed (km/h)": (3.6 * speeds[:, 1]).round(4),
        "gap (ft)": (gaps[:, 0] / 0.3048).round(4),
    })  # fmt: skip


def long_format() -> bytes:
    """One row a vehicle and instant, with positions and lengths."""
    time, speeds, gaps = pair()
    steps = (speeds[1:, 0] + speeds[:-1, 0]) / 2 * np.diff(time)
    leader = 100 + np.concatenate([[0.0], np.cumsum(steps)])
    places = {7: (leader, 0), 12: (leader - 4.6 - gaps[:, 0], 7)}
    rows = [
        pd.DataFrame({
            "time": time, "vehicle_id": name, "leader_id": ahead,
            "x [m]": place.round(4), "speed [m/s]": speeds[:, k].round(4), "length [m]": 4.6,
        })
        for k, (name, (place, ahead)) in enumerate(places.items())
    ]  # fmt: skip
    return pd.concat(rows).sort_values(["time", "vehicle_id"]).to_csv(index=False).encode()


def workbook() -> bytes:
    """A spreadsheet."""
    time, speeds, gaps = pair()
    frame = pd.DataFrame({
        "Time [s]": time.round(3), "Lead speed [m/s]": speeds[:, 0].round(4),
        "Ego speed [m/s]": speeds[:, 1].round(4), "Gap [m]": gaps[:, 0].round(4),
    })  # fmt: skip
    content = io.BytesIO()
    frame.to_excel(content, index=False)
    return content.getvalue()


def plain(**columns: FloatArray) -> bytes:
    """Comma-separated values in m, m/s and s under names that tell them; some may be others."""
    time, speeds, gaps = pair()
    usual = {"time": time.round(3), "lead_speed": speeds[:, 0], "ego_speed": speeds[:, 1],
             "gap": gaps[:, 0]}  # fmt: skip
    return _csv(usual | columns)


def _csv(columns: dict[str, FloatArray]) -> bytes:
    return pd.DataFrame(columns).to_csv(index=False).encode()
