"""What was done to the data of a segment, and how well they determine the parameters."""

from collections.abc import Iterable

from accpinn.results.messages import Labelled, message
from accpinn.segment import quality
from accpinn.segment import segment as found


@message.register
def _(finding: found.WindowMoved, about: Labelled) -> str:
    return f"The window starts at {finding.start:g} s, the sample nearest to {finding.asked:g} s."


@message.register
def _(finding: found.WindowShortened, about: Labelled) -> str:
    return (
        f"The window ends with the recording at {finding.window.end:.1f} s:"
        f" {finding.window.duration:.1f} s instead of {finding.asked:g} s."
    )


@message.register
def _(finding: found.Resampled, about: Labelled) -> str:
    return f"Resampled linearly to even steps of {finding.step:g} s, as the file's steps vary."


@message.register
def _(finding: found.Bridged, about: Labelled) -> str:
    samples = "1 sample" if finding.samples == 1 else f"{finding.samples} samples"
    return f"Bridged {samples} of {finding.column} at {', '.join(map(str, finding.windows))}."


@message.register
def _(finding: found.RegimesExcluded, about: Labelled) -> str:
    shares = (f"{100 * share:.0f} %" for share in finding.shares)
    return (
        f"Excluded from the equations of the model: {' and '.join(finding.regimes)}"
        f" ({_each(about, finding.vehicles, shares, ': ')} of the instants)."
    )


@message.register
def _(finding: found.NothingToExclude, about: Labelled) -> str:
    return f"Nothing to exclude: no instant is {' or '.join(finding.regimes)}."


@message.register
def _(finding: quality.NearEquilibrium, about: Labelled) -> str:
    figures = (
        f"Δv varies by {deviation:.2f} m/s, condition number {condition:.0f}"
        for deviation, condition in zip(finding.deviations, finding.conditions, strict=True)
    )
    return (
        "Near equilibrium, where α, β and τ are poorly identified:"
        f" {_each(about, finding.vehicles, figures)}."
    )


@message.register
def _(finding: quality.LittleCarFollowing, about: Labelled) -> str:
    shares = (f"{100 * share:.0f} %" for share in finding.shares)
    return (
        f"In car-following (moving, time gap at most {quality.CAR_FOLLOWING:g} s) for less than"
        f" {100 * quality.LITTLE_CAR_FOLLOWING:.0f} % of the time, and elsewhere the model does not"
        f" hold: {_each(about, finding.vehicles, shares)}."
    )


@message.register
def _(finding: quality.GapsNegative, about: Labelled) -> str:
    counts = (f"at {count} instants" for count in finding.instants)
    return f"The space-gap is negative, which cannot be: {_each(about, finding.vehicles, counts)}."


def _each(
    about: Labelled, vehicles: Iterable[int], figures: Iterable[str], form: str = " ("
) -> str:
    """Each vehicle with its figure: "2 Audi (34 %), 3 BMW (12 %)"."""
    end = ")" if form == " (" else ""
    pairs = zip(vehicles, figures, strict=True)
    return ", ".join(f"{about.label(number)}{form}{figure}{end}" for number, figure in pairs)
