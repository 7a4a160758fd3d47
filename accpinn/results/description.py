"""The description of a result: one object that cards, tables, captions and documents are views of.

`describe` asks the result for everything at once. A description holds values with their intervals
and what is to be known of each; how that is put in words and cells is with the views.
"""

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import wraps
from math import isnan, nan
from typing import Concatenate, ParamSpec, TypeVar

from accpinn.evaluation import Evaluation
from accpinn.findings import Finding, Labelled, joined
from accpinn.inference.trust import Trust
from accpinn.inference.typical import HeterogeneousFollowers
from accpinn.methods.estimate import SPEEDS, Estimate, Outcome, Span
from accpinn.methods.joint_likelihood import disturbance_sizes
from accpinn.methods.registry import METHODS
from accpinn.methods.state_space import EXTRA
from accpinn.model.registry import FOLLOWING, PAPER, time_gap, value_of
from accpinn.recordings import ValuesOutOfRange
from accpinn.recordings.inconsistency import GapComputed, Inconsistency
from accpinn.results.objections import Objection, against_model
from accpinn.segment import SegmentInfo
from accpinn.study.result import Result
from accpinn.study.vehicles import AssessedVehicles, assessed_vehicles, where
from accpinn.units import FloatArray, MetresPerSecond, Quantity

P = ParamSpec("P")
T = TypeVar("T")
PAPERS_POINT = "the paper's estimate: a point, biased where disturbances last"
POINT = "a point, without intervals"
FIXED, UNDETERMINED = "fixed", "not determined"
LEAST = "the least value that is sought: it may be less"
EXTRAPOLATED = "extrapolated: no window holds this speed"


@dataclass(frozen=True)
class Value:
    """A number with its interval, whose ends are nan where there is none."""

    span: Span
    note: str = ""
    """What changes how it is read: one of the above; empty for nothing."""


Known = tuple[Value, Mapping[str, Value]]
"""The time gap at the stated speed, and the model's own parameters by name."""


@dataclass(frozen=True)
class Row:
    """One follower, or all that share their parameters: then values are of the first of them."""

    number: int
    """In the file; 0 for all."""
    places: Sequence[int]
    """Places of these followers, 0 for the first."""
    known: Known
    windows: tuple[Known, ...]
    """(K,) what each window alone says; empty where the method does not estimate that."""
    gaps: Mapping[MetresPerSecond, Value]
    """The time gap at each of `SPEEDS`."""
    at_median: tuple[tuple[Span, Span, Span], ...]
    """α, β and the time gap of each of these followers at its median speed."""
    is_determined: bool
    """Whether the data determine the time gap."""
    trust: Trust
    against: tuple[Objection, ...]
    """What is against the estimate beside its own windows."""
    disturbance: str
    """How large the disturbances are that the estimate assumes; empty where it assumes none."""

    @property
    def objections(self) -> tuple[Objection, ...]:
        """All that is against the estimate, its own windows included."""
        own = (Objection(reason, self.trust.in_words) for reason in self.trust.reasons)
        return (*self.against, *own)


@dataclass(frozen=True, eq=False)
class Description:
    """What is known of a result, for all that is said and shown of it; findings are sentences."""

    estimate: Estimate
    """For its model, settings, outcome and effort; its numbers are in the rows."""
    infos: tuple[SegmentInfo, ...]
    """(K,) the windows."""
    made: str
    """By what, in words: the method, its variant, and a model that is not the paper's."""
    method: str
    """The same without the model."""
    where: str
    """From which data, in a few words."""
    point: str
    """What an estimate without intervals is, in a few words; empty for one with them."""
    rows: tuple[Row, ...]
    vehicles: AssessedVehicles
    """The followers where their string stability is shown."""
    evaluation: Evaluation
    events: tuple[str, ...]
    """Collisions, reversing and divergence in the closed-loop simulation."""
    mean_time_gaps: FloatArray
    """(M,) in s."""
    findings: tuple[str, ...]
    weaknesses: tuple[str, ...]

    @property
    def info(self) -> SegmentInfo:
        """The first window, and the vehicles."""
        return self.infos[0]

    def row(self, follower: int) -> Row:
        """That of a follower, 0 for the first."""
        return self.rows[min(follower, len(self.rows) - 1)]


def describe(result: Result) -> Description:
    """Everything that views of a result restate."""
    estimate, info = result.estimate, result.info
    point, events = about_point(estimate), incidents(result.evaluation, info)
    made, method = name_of(estimate), name_of(estimate, with_model=False)
    followers, vehicles = range(info.followers), assessed_vehicles(result)
    places = [followers] if info.shares(estimate.case) else [[k] for k in followers]
    against = [against_model(vehicles, [info.vehicles[k + 1] for k in at]) for at in places]
    sizes = {size.vehicle: size for size in disturbance_sizes(info.vehicles, estimate)}
    rows = tuple(
        _row(result, trust, at, model, sizes.get(trust.vehicle))
        for trust, at, model in zip(result.trust, places, against, strict=True)
    )
    findings, weaknesses = (
        tuple(finding.sentence(info) for finding in findings)
        for findings in (result.findings, result.weaknesses)
    )
    return Description(
        estimate, result.infos, made, method, where(info, estimate.case, result.infos), point,
        rows, vehicles, result.evaluation, events, result.mean_time_gaps, findings, weaknesses,
    )  # fmt: skip


def view(
    of: Callable[Concatenate[Description, P], T],
) -> Callable[Concatenate[Description | Result, P], T]:
    """A function of a description that describes a result where it is given one."""

    @wraps(of)
    def viewed(what: Description | Result, /, *args: P.args, **kwargs: P.kwargs) -> T:
        return of(describe(what) if isinstance(what, Result) else what, *args, **kwargs)

    viewed.__annotations__ = {**of.__annotations__, "description": Description | Result}
    return viewed


def _row(
    result: Result, trust: Trust, places: Sequence[int], against: Iterable[Objection],
    disturbance: Finding | None,
) -> Row:  # fmt: skip
    estimate, first = result.estimate, places[0]
    model, speed = estimate.model, trust.speed
    warnings = (*_against(result, places), *against)
    gaps = {
        at: Value(estimate.time_gap(at, first), EXTRAPOLATED * (not estimate.is_driven(at, first)))
        for at in SPEEDS
    }
    notes = {name: FIXED for name, _ in estimate.spec.fixed}
    notes |= {n: UNDETERMINED for n in estimate.names if not estimate.is_determined(n, first)}
    spans = {name: estimate.span(name, first) for name in estimate.names}
    known, *windows = (
        (gap, {n: Value(at, notes.get(n, LEAST * is_least(model, n, at))) for n, at in of.items()})
        for gap, of in ((gaps[speed], spans), *_windows(estimate, first, speed))
    )
    gap = gaps[speed].span
    return Row(
        trust.vehicle, places, known, tuple(windows), gaps,
        tuple(estimate.gains_and_gap(k) for k in places),
        not isnan(gap.lower if estimate.posterior else gap.value), trust, warnings,
        disturbance.sentence(result.info) if disturbance else "",
    )  # fmt: skip


def _windows(
    estimate: Estimate, follower: int, speed: MetresPerSecond
) -> Iterator[tuple[Value, dict[str, Span]]]:
    """The time gap at a speed and the parameters of a follower that each window alone says."""
    known, sets, model = estimate.posterior, estimate.windows, estimate.model
    if sets is None:
        return
    parts = (sets, known.windows_lower, known.windows_upper) if known else (sets,)
    columns = [[value_of(model, part, name) for part in parts] for name in estimate.names]
    gaps = time_gap(model, sets, speed)
    columns.append([gaps, *(known.windows_gap if known else ())])
    for k in range(len(gaps)):
        *spans, gap = (
            Span(*[*(float(part[k, follower]) for part in column), nan, nan, nan, nan][:5])
            for column in columns
        )
        yield Value(gap), dict(zip(estimate.names, spans, strict=True))


def is_least(model: str, name: str, span: Quantity) -> bool:
    """Whether a lag or delay that has an interval is the least value that is sought."""
    if name not in ("lag", "delay") or not span.lower < span.upper:
        return False
    lowest = {p.name: p.lower for p in FOLLOWING[model].parameters}
    if FOLLOWING[model].is_linear:
        lowest |= {term: of.lower for term, of in EXTRA.items()}
    return span.value <= lowest[name] + 1e-9


def _against(result: Result, places: Sequence[int]) -> Iterator[Objection]:
    """What the data, and the followers and speeds, have against an estimate."""
    info, estimate = result.info, result.estimate
    numbers = {info.vehicles[k + 1] for k in places}
    found = [finding for part in result.infos for finding in part.findings]
    gaps = [f for f in found if isinstance(f, Inconsistency) and f.follower in numbers]
    if any(finding.is_contradiction for finding in gaps):
        said = "Do not trust it: the measured gap contradicts the speeds."
        yield Objection("gap contradicts speeds", said)
    if any(isinstance(finding, GapComputed) for finding in gaps):
        said = "The gap was computed from the speeds, from an assumed distance on."
        yield Objection("gap computed", said)
    large = (one for one in found if isinstance(one, ValuesOutOfRange) and one.is_in_another_unit)
    if any(numbers & {*one.followers} for one in large):
        said = "Do not trust it: measured values are too large; check their units."
        yield Objection("values too large", said)
    unlike = (one for one in result.findings if isinstance(one, HeterogeneousFollowers))
    yield from (Objection("cars differ", one.sentence(info)) for one in unlike)
    speed = estimate.stated_speed
    if not all(estimate.is_driven(speed, k) for k in places):
        said = f"No window holds {speed * 3.6:.0f} km/h: the model extrapolates."
        yield Objection("extrapolated", said)


def incidents(evaluation: Evaluation, about: Labelled) -> tuple[str, ...]:
    """Collisions, reversing and divergence in the closed-loop simulation, the window's first."""
    inside, outside = (
        [event.sentence(about) for event in events]
        for events in (evaluation.findings, evaluation.out_of_window_findings)
    )
    return (*inside, *(f"Outside the window, {said[0].lower()}{said[1:]}" for said in outside))


# What it is called


def name_of(estimate: Estimate, with_model: bool = True) -> str:
    """The title of an estimate's method, and in brackets what distinguishes it from others."""
    method = METHODS.get(estimate.method)
    if method is None:
        return estimate.method
    said = [method.variant(estimate.settings)] if method.variant else []
    said += [brief(estimate.model)] if with_model and estimate.model != PAPER else []
    said += ["stopped"] if estimate.outcome is Outcome.STOPPED else []
    return f"{method.title} ({', '.join(said)})" if said else method.title


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
