"""Estimates of segments, with all that the recommended method says of them."""

from collections.abc import Mapping, Sequence

from accpinn.inference.typical import with_posterior
from accpinn.methods.estimate import Estimate
from accpinn.methods.joint_likelihood import joint_maxima
from accpinn.methods.registry import METHODS, recommended_method
from accpinn.model.cthp import Case, Parameters
from accpinn.model.registry import BEST
from accpinn.model.spec import ModelSpec
from accpinn.segment import Segment


def point(
    segments: Segment | Sequence[Segment],
    case: Case = "II",
    model: str = BEST,
    fixed: Mapping[str, float] | None = None,
) -> Estimate:
    """The recommended estimate of windows, before its intervals are known."""
    windows = (segments,) if isinstance(segments, Segment) else tuple(segments)
    method = METHODS[recommended_method(model)]
    return method.fit(windows, case, spec=ModelSpec.of(model, fixed))


def estimated(
    segments: Segment | Sequence[Segment],
    case: Case = "II",
    model: str = BEST,
    fixed: Mapping[str, float] | None = None,
    level: float = 0.9,
) -> Estimate:
    """The same with its posterior."""
    windows = (segments,) if isinstance(segments, Segment) else tuple(segments)
    found = point(windows, case, model, fixed)
    method = METHODS[found.method]
    kind = method.posterior(found.settings)
    assert kind is not None
    return with_posterior(found, windows, kind, level=level)


def likeliest(segment: Segment, case: Case = "II", model: str = "cthp") -> Parameters:
    """(M,) the parameters of greatest likelihood of one window."""
    maxima = joint_maxima((segment,), case, ModelSpec(model))
    rows = maxima * segment.followers if case == "I" else maxima
    return Parameters.of([maximum.complete for maximum in rows])
