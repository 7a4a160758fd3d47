"""Sensitivity of the estimates to instants at which the model may not hold.

The same methods are applied to the same window four times: to all instants, and with the regimes of
`segment.quality` excluded in turn. The model is meant for car-following alone, yet car-following is
selected by the time gap, which the model is to explain; so neither end is the truth, and the
distance between them shows how far the data and the model disagree.
"""

from dataclasses import dataclass, replace

from accpinn.errors import SegmentError
from accpinn.methods.fit import Fit
from accpinn.methods.registry import METHODS
from accpinn.model.cthp import Case, Parameters
from accpinn.recordings.recording import Recording
from accpinn.segment.quality import EXCLUDABLE, Regimes, exclude_regimes, label_regimes
from accpinn.segment.segment import Segment

COMPARED = ("least-squares", "splines")
CHOICES = {
    "all instants": (),
    "without catching up": ("catching up",),
    "without standstill and manual": ("standstill", "manual"),
    "car-following only": EXCLUDABLE,
}
"""The regimes excluded, by what is then left."""


@dataclass(frozen=True)
class SensitivityResult:
    """The parameters that one method finds from a part of the instants; M followers."""

    choice: str
    """Which instants, a key of `CHOICES`."""
    excluded_regimes: tuple[str, ...]
    share: tuple[float, ...]
    """(M,) share of each follower's instants excluded, 0 to 1."""
    method: str
    parameters: Parameters | None
    """(M,); None where too little is left, or samples are missing for long."""
    fault: SegmentError | None = None
    """Why there are none."""


def sensitivity(
    segment: Segment, recording: Recording | None = None, case: Case = "II"
) -> tuple[SensitivityResult, ...]:
    """A row for each method and choice, choices first; takes two or three times splines' time."""
    plain = replace(segment, mask=None, excluded_regimes=())
    regimes = label_regimes(plain, recording)
    known: dict[str, tuple[Fit, ...]] = {}
    rows: list[SensitivityResult] = []
    for choice, names in CHOICES.items():
        share = _share(regimes, names)
        try:
            part = exclude_regimes(plain, regimes, names) if any(share) else plain
            digest = part.info.digest  # a regime that does not occur changes nothing
            if digest not in known:
                known[digest] = tuple(METHODS[method].fit(part, case) for method in COMPARED)
        except SegmentError as fault:
            rows += [
                SensitivityResult(choice, names, share, method, None, fault) for method in COMPARED
            ]
            continue
        rows += [
            SensitivityResult(choice, names, share, fit.method, fit.parameters)
            for fit in known[digest]
        ]
    return tuple(rows)


def _share(regimes: Regimes, names: tuple[str, ...]) -> tuple[float, ...]:
    """(M,) of the instants in any of the regimes."""
    codes = [regimes.names.index(name) for name in names]
    return tuple(sum(shares[code] for code in codes) for shares in regimes.shares)
