"""Recordings from arrays and data frames in memory, checked as those of files are."""

import hashlib
from collections.abc import Sequence
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike

from accpinn.channels import GAP, MAX_VEHICLES, SPEED, Quantity
from accpinn.errors import RecordingError
from accpinn.recordings import Mode, Recording, clocks
from accpinn.recordings.clocks import LONGEST_STEP, SHORTEST_STEP
from accpinn.recordings.sampling import merged, recording_of
from accpinn.recordings.source import excerpt
from accpinn.recordings.tables import MINIMUM_SAMPLES
from accpinn.units import GAP_UNITS, SPEED_UNITS, FloatArray

SOURCE = "arrays"
"""File name of a recording that comes from none."""
Units = tuple[str, str, str]
"""Units of time, speed and gap."""


def from_arrays(
    time: ArrayLike,
    speeds: ArrayLike,
    gaps: ArrayLike,
    names: Sequence[str] | None = None,
    *,
    units: Units = ("s", "m/s", "m"),
) -> Recording:
    """The recording of arrays, checked and with findings as that of a file.

    Args:
        time: (N,) instants, increasing; numbers, or numpy's datetime64.
        speeds: (N, M+1) leader first; nan where missing.
        gaps: (N, M) from bumper to bumper, or (N,) for one follower; nan where missing.
        names: M+1 names of the vehicles, as make and model.
        units: of time, speed and gap, as ("ms", "km/h", "ft").

    Raises:
        RecordingError: one sentence of argument, fault and cure.

    Examples:
        >>> import accpinn, numpy as np
        >>> time = np.arange(0, 60, 0.1)
        >>> speeds = 20 + np.sin(0.3 * time[:, None] - [0.0, 0.4])
        >>> gaps = 30 + 0.1 * np.cumsum(speeds[:, 0] - speeds[:, 1])
        >>> mine = accpinn.from_arrays(time, speeds, gaps, ["Audi A8", "Audi A6"])
        >>> mine.duration, mine.label(2), mine.findings
        (59.9, '2 Audi A6', ())
    """
    if not isinstance(units, tuple | list) or len(units) != 3:
        raise _refusal("units", f"{excerpt(repr(units))} is not allowed", 'give ("s", "m/s", "m")')
    for unit, choices in zip(units, (clocks.FORMS, SPEED_UNITS, GAP_UNITS), strict=True):
        if unit not in choices:
            listed = ", ".join(choices)
            raise _refusal("units", f"{excerpt(repr(unit))} is not known", f"choose from {listed}")
    speed = _array("speeds", speeds, SPEED_UNITS[units[1]], SPEED)
    gap = _array("gaps", gaps, GAP_UNITS[units[2]], GAP)
    gap = gap[:, None] if gap.ndim == 1 else gap
    if speed.ndim != 2 or not 2 <= speed.shape[1] <= MAX_VEHICLES:
        raise _refusal("speeds", f"the shape is {speed.shape}", "give (N, M+1), leader first")
    samples, vehicles = speed.shape
    if gap.shape != (samples, vehicles - 1):
        wanted = f"give {(samples, vehicles - 1)}, a column a follower"
        raise _refusal("gaps", f"the shape is {gap.shape}", wanted)
    instants = _instants(time, units[0])
    if instants.shape != (samples,):
        raise _refusal("time", f"the shape is {instants.shape}", f"give ({samples},)")
    if samples < MINIMUM_SAMPLES:
        raise _refusal("time", f"there are {samples} samples", f"give {MINIMUM_SAMPLES} or more")
    seconds = _checked(instants)
    channels = np.column_stack([speed, gap])
    labels = [SPEED.of(k + 1) for k in range(vehicles)]
    labels += [GAP.of(k + 1) for k in range(vehicles - 1)]
    for label, channel in zip(labels, channels.T, strict=True):
        if np.isnan(channel).all():
            argument = "speeds" if label.startswith(SPEED.column) else "gaps"
            raise _refusal(argument, f"{label} has no value", "leave that vehicle out")
    seconds, channels, rates = merged(seconds, channels, labels)
    content = hashlib.sha256(seconds.tobytes() + channels.tobytes())
    return recording_of(
        seconds, channels[:, :vehicles], channels[:, vehicles:],
        np.full((len(seconds), vehicles), Mode.UNKNOWN, np.int8),
        refuse=lambda fault, cure, row: _refusal("time", f"{fault} (sample {row})", cure),
        findings=[rates] if rates else [],
        source=SOURCE,
        sha256=content.hexdigest(),
        names=_names(names, vehicles),
    )  # fmt: skip


def from_frame(
    frame: pd.DataFrame,
    *,
    time: str,
    speeds: Sequence[str],
    gaps: str | Sequence[str],
    units: Units = ("s", "m/s", "m"),
    names: Sequence[str] | None = None,
) -> Recording:
    """The recording of columns of a pandas frame, as `from_arrays` makes it.

    Args:
        frame: N rows.
        time: name of the column of time.
        speeds: names of the columns of speed, leader first.
        gaps: names of the columns of space-gap, one a follower.
        units: of time, speed and gap.
        names: names of the vehicles; by default those of the columns of speed.

    Raises:
        RecordingError: one sentence of argument, fault and cure.

    Examples:
        >>> import accpinn, pandas as pd
        >>> frame = pd.read_csv(accpinn.sample_path("paper_study"), skiprows=5)
        >>> mine = accpinn.from_frame(frame, time="Time", speeds=["Speed1", "Speed2"], gaps="IVS1")
        >>> mine.samples, mine.label(2)
        (3001, '2 Speed2')
    """
    columns = getattr(frame, "columns", None)
    if columns is None:
        raise _refusal("frame", f"{excerpt(repr(frame))} is no frame", "give a pandas DataFrame")
    gaps = [gaps] if isinstance(gaps, str) else gaps
    if isinstance(speeds, str) or not isinstance(speeds, Sequence):
        raise _refusal("speeds", f"{excerpt(repr(speeds))} is no list", "list names, leader first")
    if not isinstance(gaps, Sequence):
        raise _refusal("gaps", f"{excerpt(repr(gaps))} is no list", "list names, one a follower")
    for argument, listed in (("speeds", speeds), ("gaps", gaps)):
        if not len(listed):
            raise _refusal(argument, "no column is named", "list the names of columns")
    chosen = [("time", time), *(("speeds", n) for n in speeds), *(("gaps", n) for n in gaps)]
    for argument, name in chosen:
        count = sum(column == name for column in columns)
        if count != 1:
            every = excerpt(", ".join(map(str, columns)), 150)
            fault = f'{"no column" if not count else "several columns"} "{excerpt(str(name))}"'
            raise _refusal(argument, f"the frame has {fault}", f"choose among {every}")
    used = [str(name) for _, name in chosen]
    if twice := next((name for name in used if used.count(name) > 1), ""):
        raise _refusal("frame", f'"{excerpt(twice)}" is named twice', "name a column once")
    return from_arrays(
        frame[time].to_numpy(),
        np.column_stack([_column("speeds", frame[name]) for name in speeds]),
        np.column_stack([_column("gaps", frame[name]) for name in gaps]),
        [str(name) for name in speeds] if names is None else names,
        units=units,
    )


def _column(argument: str, series: "pd.Series[Any]") -> FloatArray:
    try:
        return np.asarray(series, dtype=np.float64)
    except (TypeError, ValueError):
        fault = f'column "{excerpt(str(series.name))}" holds other things than numbers'
        raise _refusal(argument, fault, "give numbers, nan where missing") from None


def _array(argument: str, values: ArrayLike, factor: float, quantity: Quantity) -> FloatArray:
    try:
        array = np.asarray(values, dtype=np.float64) * factor
    except (TypeError, ValueError):
        raise _refusal(
            argument, "these are no numbers", "give an array, nan where missing"
        ) from None
    array = np.where(np.isinf(array), np.nan, array)
    largest = np.nanmax(np.abs(array), initial=0.0)
    if largest > quantity.possible:
        fault = f"{largest:g} {quantity.unit} cannot be a measurement"
        raise _refusal(argument, fault, "correct it, or name its unit")
    return array


def _instants(time: ArrayLike, unit: str) -> FloatArray:
    """The instants (N,) in s, from numbers, datetime64 or texts of clocks."""
    try:
        return clocks.seconds(np.atleast_1d(np.asarray(time)).ravel(), unit).reshape(np.shape(time))
    except clocks.TimeUnreadable as fault:
        message = f'"{excerpt(fault.cell)}" (sample {fault.index}) {fault.fault}'
        raise _refusal("time", message, "correct it, or name its unit") from None
    except (TypeError, ValueError):
        raise _refusal("time", "these are no instants", "give an array of numbers") from None


def _checked(instants: FloatArray) -> FloatArray:
    """The instants from the first one on, increasing at the pace of a recording."""
    missing = np.flatnonzero(np.isnan(instants))
    if len(missing):
        raise _refusal("time", f"sample {missing[0]} is missing", "leave that sample out")
    seconds = np.asarray(instants - instants[0])
    steps = np.diff(seconds)
    backward = np.flatnonzero(steps <= 0)
    if len(backward):
        fault = f"it does not increase at sample {backward[0] + 1}"
        raise _refusal("time", fault, "sort the samples and drop those that come twice")
    typical = float(np.median(steps))
    if not SHORTEST_STEP <= typical <= LONGEST_STEP:
        fault = f"samples are {typical:g} s apart where 0.1 s is usual"
        raise _refusal("time", fault, "name the unit of time")
    return seconds


def _names(names: Sequence[str] | None, vehicles: int) -> dict[int, str]:
    if names is None:
        return {}
    if isinstance(names, str) or not isinstance(names, Sequence) or len(names) != vehicles:
        raise _refusal("names", f"{excerpt(repr(names))} does not fit", f"list {vehicles} names")
    return {k: excerpt(str(name), 80) for k, name in enumerate(names, 1)}


def _refusal(argument: str, fault: str, cure: str) -> RecordingError:
    return RecordingError(f"{argument}: {fault}; {cure}.")
