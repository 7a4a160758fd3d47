"""A recording in some ten lines, for `print` and notebooks."""

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from accpinn.recordings import Recording

VEHICLES, FINDINGS = 6, 3
"""Most vehicles and findings that are listed; further ones are counted."""


def summary(recording: "Recording") -> str:
    """Facts of the file, vehicles with missing samples and driver, findings, where more is."""
    setting = recording.distance_setting
    facts = (recording.campaign, recording.date, setting and f"distance setting {setting}")
    known_facts = "".join(f", {part}" for part in facts if part)
    lines = [
        f"Recording: {recording.source}{known_facts}; {recording.duration:g} s in"
        f" {recording.samples:,} samples of {recording.sample_time:g} s"
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
