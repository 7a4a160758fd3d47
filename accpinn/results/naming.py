"""What estimates and models are called in tables, captions and documents."""

from accpinn.findings import joined
from accpinn.methods.estimate import Estimate, Outcome
from accpinn.methods.registry import METHODS
from accpinn.model.registry import FOLLOWING, PAPER

PAPERS_POINT = "the paper's estimate: a point, biased where disturbances last"
POINT = "a point, without intervals"


def name_of(estimate: Estimate, with_model: bool = True) -> str:
    """The title of an estimate's method, and in brackets what distinguishes it from others."""
    method = METHODS.get(estimate.method)
    if method is None:
        return estimate.method
    words = [method.variant(estimate.settings)] if method.variant else []
    words += [brief(estimate.model)] if with_model and estimate.model != PAPER else []
    words += ["stopped"] if estimate.outcome is Outcome.STOPPED else []
    return f"{method.title} ({', '.join(words)})" if words else method.title


def brief(key: str) -> str:
    """A model as a few words beside a method's name: a CTHP by the terms that it has beside."""
    model = FOLLOWING[key]
    beside = [parameter.symbol for parameter in model.parameters if parameter.name in model.terms]
    return f"with {joined(beside)}" if beside and model.is_linear else model.title


def about_point(estimate: Estimate) -> str:
    """What an estimate without a posterior is, in a few words; empty for one with a posterior."""
    if estimate.posterior:
        return ""
    method = METHODS.get(estimate.method)
    is_papers = method is not None and method.minimises_papers_loss(estimate.settings)
    return PAPERS_POINT if is_papers and estimate.model == PAPER else POINT
