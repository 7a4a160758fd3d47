"""A drive that is proposed, in sentences."""

from accpinn.study.next_drive import NextDrive

ABOUT_DRIVE = (
    "From the drive alone: of the car as it drives then. With all that is known: of its typical"
    " value; windows of one car differ, which no single drive removes."
)


def drive_in_words(proposed: NextDrive) -> str:
    """What the car ahead does, and how far the intervals of α and β shrink."""
    shares = {row.name: row.relative_width for row in proposed.narrowing}
    told = [f"{100 * shares[name]:.0f} % ({symbol})" for name, symbol in (("alpha", "α"),
            ("beta", "β")) if name in shares]  # fmt: skip
    wide = " and ".join(told)
    narrower = f" Intervals {wide} as wide as after a motorway drive." if told else ""
    return f"{proposed.limits.duration:g} s: {proposed.kind}.{narrower}"
