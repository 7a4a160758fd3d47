"""Which parameters of a vehicle to use, why, and how sure they are: data for a sentence."""

from collections.abc import Sequence

import numpy as np

from accpinn.errors import Finding
from accpinn.inference.identifiability import is_wide
from accpinn.inference.intervals import ParameterInterval, parameter_intervals
from accpinn.inference.model_adequacy import Adequacy, BetterForm, Inadequate, WeightedForms
from accpinn.segment.segment import Segment
from accpinn.study.result import Result as MethodResult


class Recommendation(Finding, frozen=True, kw_only=True):
    """The parameters to be used of one vehicle: those over all forms of the model.

    Where the forms were not compared, those of maximum likelihood.
    """

    vehicle: int
    """0 for all followers together."""
    better: BetterForm | None
    """A form of the model that describes the data better than the CTHP."""
    weighted: WeightedForms | None
    """None where the forms were not compared."""
    is_adequate: bool | None
    """Whether the tests of the CTHP find nothing; None where another form is better, or where it
    was not tested."""
    intervals: tuple[ParameterInterval, ...]
    """Of α, β and τ, with the estimates to be used. Empty where the data determine none."""
    wide: tuple[str, ...]
    """Symbols of those that are known only to the order of magnitude."""
    outside: tuple[str, ...]
    """Keys of the methods with an estimate outside the CTHP's intervals."""
    methods: int
    """How many were compared."""
    level: float
    """Of the intervals."""


def recommend(
    segment: Segment, rows: Sequence[MethodResult], adequacy: Adequacy | None
) -> tuple[Recommendation, ...]:
    """A recommendation for each follower, or one for all that share their parameters.

    Args:
        segment: the data.
        rows: the methods' results, at least one.
        adequacy: of the forms of the model, where they were compared.
    """
    vehicles = (0,) if segment.shares(rows[0].fit.case) else segment.vehicles[1:]
    return tuple(_of_vehicle(k, vehicle, rows, adequacy) for k, vehicle in enumerate(vehicles))


def _of_vehicle(
    k: int, vehicle: int, rows: Sequence[MethodResult], adequacy: Adequacy | None
) -> Recommendation:
    uncertainty = rows[0].uncertainty
    found = adequacy.findings if adequacy else ()
    of_vehicle = [one for one in found if one.vehicle == vehicle]
    better = next((one for one in of_vehicle if isinstance(one, BetterForm)), None)
    weighted = next((one for one in of_vehicle if isinstance(one, WeightedForms)), None)
    is_known = bool(np.isfinite(uncertainty.lower[k].values).any())
    outside = [row.fit.method for row in rows if is_known and not _is_inside(row, k)]
    preferred = parameter_intervals(uncertainty, k, uncertainty.centre) if is_known else ()
    if weighted and is_known:
        preferred = weighted.intervals
    tests = adequacy.tests if adequacy else None
    tested = tests is not None and bool(np.isfinite(tests.correlated[k]))
    failing = any(isinstance(one, Inadequate) for one in of_vehicle)
    return Recommendation(
        vehicle=vehicle,
        better=better,
        weighted=weighted,
        is_adequate=not failing if (tested or failing) and not better else None,
        intervals=preferred,
        wide=tuple(one.symbol for one in preferred if is_wide(one)),
        outside=tuple(outside),
        methods=len(rows),
        level=uncertainty.level,
    )


def _is_inside(row: MethodResult, k: int) -> bool:
    """Whether no parameter of a follower lies outside; an undetermined one does not."""
    undetermined = np.isnan(row.fit.parameters.values[k])
    return bool((row.uncertainty.inside[k] | undetermined).all())
