"""What is to be known about a recording and a segment of it, in sentences."""

from collections.abc import Iterable, Sequence

from accpinn.channels import DRIVER, GAP, RECORDED
from accpinn.recordings import recording as recorded
from accpinn.results.messages import Labelled, joined, message, percent
from accpinn.segment import quality, segment

FLAGS = {recorded.HUMAN_FLAG: "human drivers", 1: "ACC", 2: "mixed"}
"""Of the whole recording; it does not say which vehicle was driven by whom."""


@message.register
def _(finding: recorded.RecordingFinding, about: Labelled) -> str:
    match finding:
        case recorded.MetadataMissing():
            return f"The metadata row {finding.key} is missing."
        case recorded.MetadataUnreadable():
            return (
                f'The metadata row {finding.key} cannot be read and is ignored: "{finding.text}".'
            )
        case recorded.NamesWithoutData():
            listed = ", ".join(map(about.label, finding.vehicles))
            return f"The header names vehicles without data: {listed}."
        case recorded.VehiclesWithoutName():
            return f"The header gives no name for vehicle {', '.join(map(str, finding.vehicles))}."
        case recorded.VehicleCountMismatch():
            return (
                f"The header states {finding.stated} vehicles and names {finding.named}, and the"
                f" columns hold {finding.recorded}; a name may belong to another vehicle."
            )
        case recorded.GapsUnused():
            listed = ", ".join(map(GAP.of, finding.gaps))
            return f"{listed} cannot be used, as one of the two vehicles has no speed column."
        case recorded.LineEndMissing():
            return (
                "The last row has no line end; if the file was cut short, its last number is wrong."
            )
        case recorded.ModesUnknown():
            return (
                f"{DRIVER.of(finding.vehicle)} holds neither ACC nor Human in {finding.samples}"
                f' samples (as "{finding.example}").'
            )
        case recorded.SamplesMissing():
            return _missing(finding, about)
        case recorded.GapContradictsSpeeds():
            ahead, behind = finding.vehicle, finding.vehicle + 1
            return (
                f"{GAP.of(ahead)} contradicts the speeds of vehicles {ahead} and {behind}: its rate"
                f" of change correlates with their difference by {finding.correlation:.2f} (sound"
                f" data: 1); do not trust results for vehicle {behind}."
            )
        case recorded.ValuesOutOfRange():
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
        case recorded.ValuesFrozen():
            name = RECORDED[finding.channel].name.lower()
            return (
                f"The {name} of {about.label(finding.vehicle)} is frozen for"
                f" {finding.window.duration:.1f} s while it moves, at {finding.window}."
            )
        case recorded.MappingRemembered():
            return (
                "The columns were read by the mapping that an earlier file with the same columns"
                " was given."
            )
        case recorded.LittleLeaderMotion():
            return (
                f"The speed of the leader, {about.label(finding.vehicle)}, varies by only"
                f" {finding.deviation:.2f} m/s (standard deviation); this excitation may be too"
                " small to identify the parameters."
            )


def driver_summary(recording: recorded.Recording) -> str:
    """Who drives, by name: "Human: 1; ACC: 2, 3"; by the file's flag where it gives no modes."""
    by_mode: dict[str, list[str]] = {}
    for vehicle in recording.vehicles:
        if vehicle.modes and any(vehicle.modes.values()):
            mode = " and ".join(name for name, samples in vehicle.modes.items() if samples)
            by_mode.setdefault(mode, []).append(str(vehicle.index))
    if by_mode:
        return "; ".join(f"{mode}: {', '.join(which)}" for mode, which in by_mode.items())
    flag = FLAGS.get(recording.acc_flag) if recording.acc_flag is not None else None
    return "driver modes not recorded" + (f" (flagged as {flag})" if flag else "")


def _missing(finding: recorded.SamplesMissing, about: Labelled) -> str:
    column, is_gap = RECORDED[finding.channel].of(finding.vehicle), finding.channel == GAP.column
    what = column if is_gap else f"{column} ({about.label(finding.vehicle)})"
    where = " although both speeds are known" if is_gap else ""
    return (
        f"{what} is missing in {_rounded(finding.share)} of the samples{where}, at"
        f" {_longest(finding.windows, finding.shorter)}."
    )


def _rounded(share: float) -> str:
    """A share in percent, small ones with one digit."""
    percent = 100 * share
    return f"{percent:.0f} %" if percent >= 1 else f"{percent:.1g} %"


def _longest(windows: Sequence[recorded.Window], unlisted: int = 0) -> str:
    """The longest windows in order of time, and how many others there are with those unlisted."""
    longest = sorted(windows, key=lambda window: -window.duration)[: recorded.BLOCKS_LISTED]
    listed = ", ".join(map(str, sorted(longest, key=lambda window: window.start)))
    others = len(windows) - len(longest) + unlisted
    return listed + (f" and in {others} shorter block{'s' * (others > 1)}" if others else "")


@message.register
def _(finding: segment.SegmentFinding, about: Labelled) -> str:
    match finding:
        case segment.WindowMoved():
            return (
                f"The window starts at {finding.start:g} s, the sample nearest to"
                f" {finding.asked:g} s."
            )
        case segment.WindowShortened():
            return (
                f"The window ends with the recording at {finding.window.end:.1f} s:"
                f" {finding.window.duration:.1f} s instead of {finding.asked:g} s."
            )
        case segment.Resampled():
            return (
                f"Resampled linearly to even steps of {finding.step:g} s, as the file's steps vary."
            )
        case segment.Bridged():
            samples = "1 sample" if finding.samples == 1 else f"{finding.samples} samples"
            return (
                f"Bridged {samples} of {finding.column} at {', '.join(map(str, finding.windows))}."
            )
        case segment.BlocksMissing():
            are = "is" if len(finding.columns) == 1 else "are"
            return (
                f"{joined(finding.columns)} {are} missing in {_rounded(finding.share)} of the"
                f" window, at {_longest(finding.windows)}; the likelihood leaves these samples out."
            )
        case segment.RegimesExcluded():
            shares = _each(about, finding.vehicles, map(percent, finding.shares), "{}: {}")
            return (
                f"Excluded from the equations of the model: {' and '.join(finding.regimes)}"
                f" ({shares} of the instants)."
            )
        case segment.DrivenByHand():
            shares = _each(
                about, finding.vehicles, map(percent, finding.shares), "{} ({} of the time)"
            )
            by = "flag (it gives no driver modes)" if finding.by_flag else "driver modes"
            return (
                f"These are not ACC parameters: by the file's {by}, a driver controls {shares}."
                " α, β and τ then describe the driver."
            )
        case segment.NothingToExclude():
            return f"Nothing to exclude: no instant is {' or '.join(finding.regimes)}."


@message.register
def _(
    finding: quality.NearEquilibrium | quality.LittleCarFollowing | quality.GapsNegative,
    about: Labelled,
) -> str:
    match finding:
        case quality.NearEquilibrium():
            figures = (
                f"Δv varies by {deviation:.2f} m/s, condition number {condition:.0f}"
                for deviation, condition in zip(finding.deviations, finding.conditions, strict=True)
            )
            return (
                "Near equilibrium, where α, β and τ are poorly identified:"
                f" {_each(about, finding.vehicles, figures)}."
            )
        case quality.LittleCarFollowing():
            return (
                f"In car-following (moving, time gap at most {quality.CAR_FOLLOWING:g} s) for less"
                f" than {percent(quality.LITTLE_CAR_FOLLOWING)} of the time, and elsewhere the"
                " model does not hold:"
                f" {_each(about, finding.vehicles, map(percent, finding.shares))}."
            )
        case quality.GapsNegative():
            counts = (f"at {count} instants" for count in finding.instants)
            each = _each(about, finding.vehicles, counts)
            return f"The space-gap is negative, which cannot be: {each}."


def _each(
    about: Labelled, vehicles: Iterable[int], figures: Iterable[str], form: str = "{} ({})"
) -> str:
    """Each vehicle with its figure: "2 Audi (34 %), 3 BMW (12 %)"."""
    pairs = zip(map(about.label, vehicles), figures, strict=True)
    return ", ".join(form.format(*pair) for pair in pairs)
