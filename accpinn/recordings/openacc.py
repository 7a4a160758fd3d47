"""The loader: bytes in, a `Recording` out."""

import hashlib
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from accpinn.recordings.body import Body, read_body
from accpinn.recordings.campaigns import campaign_of
from accpinn.recordings.checks import findings
from accpinn.recordings.header import Header, read_header
from accpinn.recordings.recording import Mode, Recording, Vehicle
from accpinn.recordings.source import LIMIT_BYTES, Source, read_bytes, refusal
from accpinn.units import FloatArray


def read(source: Source, name: str | None = None, limit_bytes: int = LIMIT_BYTES) -> Recording:
    """Read an OpenACC CSV file.

    Args:
        source: path of the file, or the bytes of an upload.
        name: file name to show; needed for bytes only.
        limit_bytes: larger files are refused.

    Raises:
        RecordingError: one sentence of file, place, fault and cure.
    """
    source_file = read_bytes(source, name, limit_bytes)
    header = read_header(source_file)
    body = read_body(source_file, header)
    speed, gap = _by_vehicle(header, body)
    if np.isnan(speed).all() or np.isnan(gap).all():
        kind = "speed" if np.isnan(speed).all() else "space-gap"
        raise refusal(source_file.name, f"all {kind} columns are empty", "choose another recording")
    mode = _modes(body, speed.shape[1])
    recording = Recording(
        source=source_file.name,
        sha256=hashlib.sha256(source_file.raw).hexdigest(),
        campaign=campaign_of(source_file.name, source_file.folder, header.date),
        date=header.date,
        acc_flag=header.acc_flag,
        distance_setting=header.distance_setting,
        vehicles=_vehicles(header, body, speed, mode),
        time=body.time - body.time[0],
        first_time=float(body.time[0]),
        speed=speed,
        gap=gap,
        mode=mode,
    )
    warnings = (*header.warnings, *_layout(header), *body.warnings, *findings(recording))
    return replace(recording, warnings=warnings)


def _by_vehicle(header: Header, body: Body) -> tuple[FloatArray, FloatArray]:
    """Speeds (N, V) and gaps (N, V-1) with NaN for the columns the file lacks."""
    count = max(len(header.names), *body.speed, 2)
    speed = np.full((len(body.time), count), np.nan)
    gap = np.full((len(body.time), count - 1), np.nan)
    for number, values in body.speed.items():
        speed[:, number - 1] = values
    for number, values in body.gap.items():
        if number < count:
            gap[:, number - 1] = values
    return speed, gap


def _modes(body: Body, count: int) -> NDArray[np.int8]:
    mode = np.full((len(body.time), count), Mode.UNKNOWN, dtype=np.int8)
    for number, values in body.mode.items():
        if number <= count:
            mode[:, number - 1] = values
    return mode


def _vehicles(
    header: Header, body: Body, speed: FloatArray, mode: NDArray[np.int8]
) -> tuple[Vehicle, ...]:
    samples, count = speed.shape
    return tuple(
        Vehicle(
            index=number,
            name=_name(header, number),
            present=bool(absent < samples),
            missing=int(absent),
            missing_share=float(absent / samples),
            modes={
                "ACC": int((mode[:, number - 1] == Mode.ACC).sum()),
                "Human": int((mode[:, number - 1] == Mode.HUMAN).sum()),
            }
            if (mode[:, number - 1] != Mode.UNKNOWN).any()
            else None,
        )
        for number, absent in zip(range(1, count + 1), np.isnan(speed).sum(axis=0), strict=True)
    )


def _name(header: Header, number: int) -> str:
    listed = header.names[number - 1] if number <= len(header.names) else ""
    return listed or f"Vehicle {number}"


def _layout(header: Header) -> list[str]:
    """Where names, number of vehicles and columns disagree."""
    names, speeds = header.names, header.columns.speed
    warnings = []
    absent = [number for number in range(1, len(names) + 1) if number not in speeds]
    if absent:
        listed = ", ".join(f"{number} ({names[number - 1] or 'unnamed'})" for number in absent)
        warnings.append(f"The header names vehicles without data: {listed}.")
    unnamed = [n for n in sorted(speeds) if n > len(names) or not names[n - 1]]
    if unnamed:
        listed = ", ".join(str(number) for number in unnamed)
        warnings.append(f"The header gives no name for vehicle {listed}.")
    if header.number is not None and header.number not in {len(names), max(speeds)}:
        warnings.append(
            f"The header speaks of {header.number} vehicles but names {len(names)}, and the"
            f" columns hold {len(speeds)}; names and columns may not belong together."
        )
    elif header.number is not None and header.number < len(names):
        warnings.append(
            f"The header names {len(names)} vehicles for a platoon of {header.number}; a name may"
            " stand at the wrong vehicle."
        )
    orphans = [n for n in sorted(header.columns.gap) if not {n, n + 1} <= set(speeds)]
    if orphans:
        listed = ", ".join(f"IVS{number}" for number in orphans)
        warnings.append(f"Of {listed} one of the two vehicles has no speed column; it is not used.")
    return warnings
