"""A recording in some ten lines, for `print` and notebooks."""

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from accpinn.recordings import Recording

VEHICLES, FINDINGS = 6, 3
"""Vehicles and findings that are listed; of more the number is told."""


def summary(recording: "Recording") -> str:
    """What the file is, each vehicle with its missing samples and driver, findings, what to do."""
    setting = recording.distance_setting
    known = (recording.campaign, recording.date, setting and f"distance setting {setting}")
    told = "".join(f", {part}" for part in known if part)
    lines = [
        f"Recording: {recording.source}{told}; {recording.duration:g} s in {recording.samples:,}"
        f" samples of {recording.sample_time:g} s"
    ]
    for vehicle in recording.vehicles[:VEHICLES]:
        modes = vehicle.modes or {}
        driven = ", ".join(f"{name} {count / recording.samples:.0%}"
                           for name, count in modes.items() if count)  # fmt: skip
        missing = f", {vehicle.missing_share:.0%} missing" if vehicle.missing else ""
        data = f"driver {driven or 'not recorded'}{missing}" if vehicle.present else "no data"
        lines.append(f"  {recording.label(vehicle.index)}: {data}")
    lines += _further(len(recording.vehicles) - VEHICLES, "vehicle")
    findings = recording.findings
    lines += [f"  {finding.sentence(recording)}" for finding in findings[:FINDINGS]]
    lines += _further(len(findings) - FINDINGS, "finding")
    return "\n".join([*lines, "More: .vehicles, .time, .speed, .gap, .findings"])


def _further(count: int, noun: str) -> list[str]:
    return [f"  and {count} more {noun}{'s' * (count > 1)}"] if count > 0 else []
