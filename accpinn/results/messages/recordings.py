"""What is to be known about a recording, in sentences."""

from accpinn.channels import DRIVER, GAP, RECORDED
from accpinn.recordings import recording as found
from accpinn.results.messages import Labelled, message


def share(value: float) -> str:
    """A share, 0 to 1, in percent: 57 %, 0.3 %."""
    percent = 100 * value
    return f"{percent:.0f} %" if percent >= 1 else f"{percent:.1g} %"


@message.register
def _(finding: found.MetadataMissing, about: Labelled) -> str:
    return f"The metadata row {finding.key} is missing."


@message.register
def _(finding: found.MetadataUnreadable, about: Labelled) -> str:
    return f'The metadata row {finding.key} cannot be read and is ignored: "{finding.text}".'


@message.register
def _(finding: found.NamesWithoutData, about: Labelled) -> str:
    listed = ", ".join(map(about.label, finding.vehicles))
    return f"The header names vehicles without data: {listed}."


@message.register
def _(finding: found.VehiclesWithoutName, about: Labelled) -> str:
    return f"The header gives no name for vehicle {', '.join(map(str, finding.vehicles))}."


@message.register
def _(finding: found.VehicleCountMismatch, about: Labelled) -> str:
    return (
        f"The header states {finding.stated} vehicles and names {finding.named}, and the columns"
        f" hold {finding.recorded}; a name may belong to another vehicle."
    )


@message.register
def _(finding: found.GapsUnused, about: Labelled) -> str:
    listed = ", ".join(map(GAP.of, finding.gaps))
    return f"{listed} cannot be used, as one of the two vehicles has no speed column."


@message.register
def _(finding: found.LineEndMissing, about: Labelled) -> str:
    return "The last row has no line end; if the file was cut short, its last number is wrong."


@message.register
def _(finding: found.ModesUnknown, about: Labelled) -> str:
    return (
        f"{DRIVER.of(finding.vehicle)} holds neither ACC nor Human in {finding.samples} samples"
        f' (as "{finding.example}").'
    )


@message.register
def _(finding: found.SamplesMissing, about: Labelled) -> str:
    column = RECORDED[finding.channel].of(finding.vehicle)
    is_gap = finding.channel == GAP.column
    what = column if is_gap else f"{column} ({about.label(finding.vehicle)})"
    where = " although both speeds are known" if is_gap else ""
    blocks = "shorter block" if finding.shorter == 1 else "shorter blocks"
    others = f" and in {finding.shorter} {blocks}" if finding.shorter else ""
    return (
        f"{what} is missing in {share(finding.share)} of the samples{where}, at"
        f" {', '.join(map(str, finding.windows))}{others}."
    )


@message.register
def _(finding: found.GapContradictsSpeeds, about: Labelled) -> str:
    ahead, behind = finding.vehicle, finding.vehicle + 1
    return (
        f"{GAP.of(ahead)} contradicts the speeds of vehicles {ahead} and {behind}: its rate of"
        f" change correlates with their difference by {finding.correlation:.2f} (sound data: 1);"
        f" do not trust results for vehicle {behind}."
    )


@message.register
def _(finding: found.ValuesOutOfRange, about: Labelled) -> str:
    channel = RECORDED[finding.channel]
    column, unit = channel.of(finding.vehicle), channel.unit
    if finding.extreme < channel.lowest:
        return (
            f"{column} is negative in {finding.samples} samples, the lowest"
            f" {finding.extreme:.2g} {unit}."
        )
    return (
        f"{column} exceeds {channel.highest:g} {unit} in {finding.samples} samples, up to"
        f" {finding.extreme:.4g}; check its unit."
    )


@message.register
def _(finding: found.ValuesFrozen, about: Labelled) -> str:
    name = RECORDED[finding.channel].name.lower()
    return (
        f"The {name} of {about.label(finding.vehicle)} is frozen for"
        f" {finding.window.duration:.1f} s while it moves, at {finding.window}."
    )


@message.register
def _(finding: found.LittleLeaderMotion, about: Labelled) -> str:
    return (
        f"The speed of the leader, {about.label(finding.vehicle)}, varies by only"
        f" {finding.deviation:.2f} m/s (standard deviation); this excitation may be too small to"
        " identify the parameters."
    )
