"""How much an estimate depends on instants at which the law may not hold.

The same methods learn from the same window four times: with all instants, and with the regimes of
`segment.regimes` left out in turn. Car-following alone is the law's own ground, yet it is chosen by
the time gap, which the law is to explain; so neither end is the truth, and the distance between
them says how far the data and the law disagree.
"""

from dataclasses import dataclass, replace

from accpinn.errors import SegmentError
from accpinn.methods.fit import Fit
from accpinn.methods.registry import METHODS
from accpinn.model.cthp import Case, Parameters
from accpinn.recordings.recording import Recording
from accpinn.segment.regimes import EXCLUDABLE, Regimes, exclude_regimes, label_regimes
from accpinn.segment.segment import Segment

COMPARED = ("least-squares", "splines")
CHOICES = {
    "all instants": (),
    "without catching up": ("catching up",),
    "without standstill and manual": ("standstill", "manual"),
    "car-following only": EXCLUDABLE,
}
"""What is left out, by what is left in."""


@dataclass(frozen=True)
class SensitivityResult:
    """What one method learns from a part of the instants; M followers."""

    choice: str
    """Which instants, a key of `CHOICES`."""
    left_out: tuple[str, ...]
    """The regimes left out."""
    share: tuple[float, ...]
    """(M,) share of each follower's instants left out, 0 to 1."""
    method: str
    parameters: Parameters | None
    """(M,); None where too little is left."""
    refusal: str = ""
    """Why there are none."""


def sensitivity(
    segment: Segment, recording: Recording | None = None, case: Case = "II"
) -> tuple[SensitivityResult, ...]:
    """A row for each method and choice, choices first; two or three times the splines' time.

    Args:
        segment: the data; what it leaves out itself plays no part.
        recording: what it was cut from, for the driver modes.
        case: "I" or "II".
    """
    plain = replace(segment, mask=None, excluded_regimes=())
    regimes = label_regimes(plain, recording)
    known: dict[str, tuple[Fit, ...]] = {}
    rows: list[SensitivityResult] = []
    for choice, names in CHOICES.items():
        share = _share(regimes, names)
        try:
            part = exclude_regimes(plain, regimes, names) if any(share) else plain
        except SegmentError as fault:
            rows += [
                SensitivityResult(choice, names, share, method, None, str(fault))
                for method in COMPARED
            ]
            continue
        digest = part.info.digest  # a regime that does not occur changes nothing
        if digest not in known:
            known[digest] = tuple(METHODS[method].fit(part, case) for method in COMPARED)
        rows += [
            SensitivityResult(choice, names, share, fit.method, fit.parameters)
            for fit in known[digest]
        ]
    return tuple(rows)


def _share(regimes: Regimes, names: tuple[str, ...]) -> tuple[float, ...]:
    """(M,) of the instants in any of the regimes."""
    codes = [regimes.names.index(name) for name in names]
    return tuple(sum(shares[code] for code in codes) for shares in regimes.shares)
