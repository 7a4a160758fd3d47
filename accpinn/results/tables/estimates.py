"""Estimates as tables, in the manner of the paper's Tables I to III, and models side by side."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from itertools import product
from math import nan

import numpy as np

from accpinn.channels import GAP, LINF_GAIN, MAGNITUDE, PARAMETERS, SPEED
from accpinn.evaluation.closed_loop import TrackingErrors
from accpinn.findings import joined
from accpinn.inference.intervals import LEVEL, Uncertainty
from accpinn.inference.model_adequacy import ModelForm
from accpinn.methods.estimate import Fit, Outcome
from accpinn.methods.registry import METHODS
from accpinn.methods.state_space import EXTRA
from accpinn.model.cthp import Case, Parameters
from accpinn.model.registry import CTHPS, FOLLOWING, PAPER, value_of
from accpinn.results.tables import (
    Cell,
    Column,
    Filled,
    Marked,
    Range,
    Table,
    estimate_cells,
    percent_cells,
)
from accpinn.results.vehicles import ALL_OF_IT, by_hand, where
from accpinn.segment import SegmentInfo
from accpinn.stability import stability_at
from accpinn.study import differences
from accpinn.study.comparison import Spread
from accpinn.study.judge import Judgement, beyond, wins
from accpinn.study.result import Result
from accpinn.units import Quantity, MetresPerSecond

PARAMETER_COLUMNS = tuple(Column.of(quantity, key=quantity.key) for quantity in PARAMETERS)
TERM_COLUMNS = (
    Column("s₀", "m", 1, key="s0", may_be_held=True),
    Column("λ", "s", 2, key="lag", may_be_held=True),
    Column("d", "s", 2, key="delay", may_be_held=True),
)
"""Terms beside the CTHP, in the order of `cthp.TERMS`."""
OWN_DIGITS = 3
"""Decimals of the parameters of other models."""
GAP_MAE = "MAE of the space-gap"
EVERY_FOLLOWER = "Every follower"
"""The label of parameters that all followers share (Case I)."""
DRIVER = "Driver"
PROBABILITY = "Probability of string stability"
AGAINST = "Difference from the CTHP"
LEAST = "the least value that is sought: it may be less"
MODEL, LEFT_OUT = Column("Model", key="model"), "In windows left out"
TITLES = {key: method.title for key, method in METHODS.items()}
"""The name of a method wherever people read it."""


def name_of(fit: Fit, with_model: bool = True) -> str:
    """The title of a fit's method, and in brackets what distinguishes it from others of it."""
    method = METHODS.get(fit.method)
    if method is None:
        return fit.method
    said = [method.variant(fit.config)] if method.variant else []
    said += [_brief(fit.model)] if with_model and fit.model != PAPER else []
    said += ["stopped"] if fit.outcome is Outcome.STOPPED else []
    return f"{method.title} ({', '.join(said)})" if said else method.title


def _brief(key: str) -> str:
    """A model as a few words beside a method's name: a CTHP by the terms that it has beside."""
    model = FOLLOWING[key]
    beside = [parameter.symbol for parameter in model.parameters if parameter.name in model.terms]
    return f"with {joined(beside)}" if beside and model.is_cthp else model.title


def driver_cells(shares: Sequence[float]) -> Iterator[Filled]:
    """Who drives each follower in place of ACC, as a column; none where nobody does."""
    if shares:
        yield Column(DRIVER), [_driver(share) if share else None for share in shares]


def _driver(share: float) -> str:
    return "Human" if share > ALL_OF_IT else f"Human {100 * share:.0f} %"


def parameter_table(result: Result, with_intervals: bool = True) -> Table:
    """One row a vehicle, leader first: parameters, mean time gap, errors of both kinds.

    Parameters that all followers share (Case I) have a row of their own, the second. The leader of
    the closed-loop simulation is given, so it has no error. Intervals come with the probability of
    string stability.
    """
    info, fit, evaluation = result.info, result.fit, result.evaluation
    numbers, followers = row_vehicles(info, fit.case), info.vehicles[1:]
    known = result.uncertainty if with_intervals else None
    estimated = [*parameter_cells(fit.parameters, "Quantity" if known else "", fit.model, known)]
    estimated += probability_cells(known) if known else ()
    parts: list[tuple[Sequence[int], Iterable[Filled]]] = [
        (followers, driver_cells(by_hand(info))),
        (parameter_rows(info, fit.case), estimated),
        (followers, [(Column("Mean time gap", "s", 2), result.mean_time_gaps.tolist())]),
    ]
    for group, errors, digits, driving in (
        ("Surrogate fit, MAE", evaluation.surrogate, 3, info.vehicles),
        ("Closed-loop simulation, MAE", evaluation.closed_loop, 2, followers),
    ):
        gaps, speeds = (errors.gap_mae, errors.speed_mae[-len(driving) :]) if errors else ((), ())
        parts.append((followers, [(Column("p", "m", digits, group), gaps)]))
        parts.append((driving, [(Column("v", "m/s", 3, group), speeds)]))
    columns: list[Filled] = [(Column("Vehicle"), row_labels(info, numbers))]
    for vehicles, filled in parts:
        for column, cells in filled:
            known_cells = dict(zip(vehicles, cells, strict=False))
            columns.append((column, [known_cells.get(number) for number in numbers]))
    return Table.of(f"{name_of(fit)}, {where(info, fit.case, result.infos)}", columns)


def row_vehicles(info: SegmentInfo, case: Case) -> tuple[int, ...]:
    """The vehicle of each row of `parameter_table`; 0 for what all followers share."""
    leader, *followers = info.vehicles
    return (leader, *((0,) if info.shares(case) else ()), *followers)


def parameter_rows(info: SegmentInfo, case: Case) -> tuple[int, ...]:
    """The vehicle of each set of parameters: the followers, or 0 alone for all that share one."""
    return (0,) if info.shares(case) else info.vehicles[1:]


def row_labels(info: SegmentInfo, numbers: Sequence[int]) -> tuple[str, ...]:
    """The labels of vehicles; 0 stands for all followers."""
    return tuple(info.label(number) if number else EVERY_FOLLOWER for number in numbers)


def columns_of(model: str) -> dict[str, Column]:
    """The parameters of a model by name, α, β and τ first.

    Those of a model that is no CTHP stand behind the linearisation at the median speed.
    """
    following, columns = FOLLOWING[model], (*PARAMETER_COLUMNS, *TERM_COLUMNS)
    if following.is_cthp:
        return {column.key: column for column in columns if column.key in following.names}
    own = {
        p.name: Column(p.symbol, p.unit, OWN_DIGITS, following.title, key=p.name, may_be_held=True)
        for p in following.parameters
    }
    return {column.key: column for column in PARAMETER_COLUMNS} | own


def shown_columns(parameters: Parameters, model: str = PAPER) -> Iterator[tuple[int, Column]]:
    """The columns of (K,) sets, with their places in `Parameters.everything`.

    They are α, β and τ, and of s₀, λ and d those that a set has: τ alone says little beside an s₀.
    A model that is no CTHP has the s₀ of its linearisation, and then its own parameters.
    """
    own = () if model in CTHPS else [*columns_of(model).values()][len(PARAMETER_COLUMNS) :]
    yield from enumerate(PARAMETER_COLUMNS)
    for at, column in enumerate(TERM_COLUMNS[: 1 if own else None], len(PARAMETER_COLUMNS)):
        if np.nan_to_num(parameters.complete[:, at]).any():
            yield at, replace(column, key="linearised_s0") if own else column
    yield from enumerate(own, 6)


def parameter_cells(
    parameters: Parameters,
    group: str = "",
    model: str = PAPER,
    known: Uncertainty | None = None,
    is_brief: bool = False,
) -> Iterator[Filled]:
    """The parameters of (K,) vehicles, α, β and τ first, with intervals where these are known."""
    for at, column in shown_columns(parameters, model):
        values, is_term = parameters.everything[:, at], len(PARAMETER_COLUMNS) <= at < 6
        cells: Sequence[Cell] = [None if is_term and v == 0 else v for v in values]
        shown = replace(column, group=group, key="") if group else column
        if known:
            ends = (known.lower.everything[:, at], known.upper.everything[:, at])
            cells, level = estimate_cells(values, *ends), f"{100 * known.level:.0f} % interval"
            heading = f"{column.group or group} ({level})" if group else column.group
            shown = replace(column, group=heading)
        yield replace(shown, is_brief=is_brief), cells


def probability_cells(uncertainty: Uncertainty) -> Iterator[Filled]:
    """The probability of string stability by both norms."""
    yield Column.chance("L₂", PROBABILITY), percent_cells(uncertainty.probability_l2)
    yield Column.chance("L∞", PROBABILITY), percent_cells(uncertainty.probability_linf)


def comparison_table(
    result: Result, estimates: Mapping[str, tuple[Parameters, Uncertainty | None]]
) -> Table:
    """One row a follower and method, or the truth; one for all followers in Case I.

    Estimates are (M,) by method, from the result's windows; where an uncertainty is known, its
    intervals limit the digits to those that they support.
    """
    numbers = parameter_rows(result.info, result.fit.case)
    rows = [*product(range(len(numbers)), estimates.values())]
    labels, names = row_labels(result.info, numbers), [*estimates]
    filled: list[Filled] = [
        (Column("Vehicle"), [label for label in labels for _ in names]),
        (Column("Method"), names * len(numbers)),
    ]
    sets = Parameters.of([found.complete[k] for k, (found, _) in rows])
    for at, column in shown_columns(sets):
        cells: list[Cell] = []
        for k, (found, known) in rows:
            parts = (found, known.lower, known.upper) if known else (found,)
            value, *ends = (float(part.complete[k, at]) for part in parts)
            is_there = value or at < len(PARAMETER_COLUMNS)
            cells.append((Quantity(value, *ends) if ends else value) if is_there else None)
        filled.append((replace(column, is_brief=True), cells))
    return Table.of(f"Estimates side by side, {where(result.info, windows=result.infos)}", filled)


def intervals_table(result: Result) -> Table:
    """One row a follower, or one for all that share their parameters.

    The columns are the estimates that the intervals are about, those of maximum likelihood or of a
    model that is no CTHP by simulation, and the probability of string stability.
    """
    info, uncertainty = result.info, result.uncertainty
    numbers, centre = parameter_rows(info, result.fit.case), uncertainty.centre
    kind = "Closed-loop simulation" if centre.own.size else "Maximum likelihood"
    estimates = parameter_cells(centre, kind, known=uncertainty)
    filled = (*estimates, *probability_cells(uncertainty))
    model = FOLLOWING[result.fit.model].title
    return Table.of(
        f"Uncertainty under the {model}, {where(info, windows=result.infos)}",
        [
            (Column("Follower"), row_labels(info, numbers)),
            *((column, [*cells][: len(numbers)]) for column, cells in filled),
        ],
    )


def _error_cells(
    results: Sequence[Result], follower: int, *kinds: tuple[str, str, int]
) -> Iterator[Filled]:
    """The MAE of a follower's space-gap by attribute of the evaluation, title and digits."""
    for kind, title, digits in kinds:
        errors = [getattr(result.evaluation, kind) for result in results]
        cells = [float(error.gap_mae[follower]) if error else None for error in errors]
        yield Column(title, "m", digits, GAP_MAE), cells


SURROGATE, CLOSED_LOOP = ("surrogate", "Surrogate fit", 3), ("closed_loop", "Closed loop", 2)
UNSEEN = (("holdout", "Hold-out", 2), ("out_of_window", "Outside the window", 2))


def methods_table(
    info: SegmentInfo,
    results: Sequence[Result],
    follower: int,
    answered: tuple[Parameters, float | None] | None = None,
    model: str = PAPER,
) -> Table:
    """One row a method, for one follower (0 for the first).

    What was answered by a model is the first row: the parameters of that follower, and the mean
    absolute error of its space-gap in closed loop.
    """
    sets = [result.fit.parameters[follower] for result in results]
    kinds = (SURROGATE, CLOSED_LOOP, *UNSEEN)
    errors = [*_error_cells(results, follower, *kinds)]
    collisions = [result.evaluation.collision_times(info.vehicles)[follower] for result in results]
    filled: list[Filled] = [
        (Column("Method"), [name_of(result.fit, with_model=False) for result in results]),
        (MODEL, [_brief(result.fit.model) for result in results]),
        *errors,
        (Column("Collides at", "s", 1), collisions),
        (Column("Time", "s", 2, least=True), [result.fit.seconds for result in results]),
    ]
    if answered:
        own, error = answered
        beside = (error if kind is CLOSED_LOOP else None for kind in kinds)
        first = ("Answer", _brief(model), *beside, None, None)
        filled = [
            (column, [cell, *cells]) for cell, (column, cells) in zip(first, filled, strict=True)
        ]
        sets.insert(0, own)
    filled[2:2] = parameter_cells(Parameters.stack(sets))
    return Table.of(f"{info.labels[follower + 1]}, {where(info)}", filled)


def starts_table(results: Sequence[Result], spread: Spread, follower: int) -> Table:
    """One row a training of one follower (0 for the first), and the spread in the last."""
    info, fits = results[0].info, [result.fit for result in results]
    starts = [", ".join(f"{value:g}" for value in fit.config["initial"]) for fit in fits]
    filled: list[Filled] = [
        (Column("Start (α, β, τ)"), starts),
        *parameter_cells(Parameters.stack(fit.parameters[follower] for fit in fits), "Learned"),
        *_error_cells(results, follower, SURROGATE, CLOSED_LOOP),
        (Column("Iterations", "", 0), [float(fit.iterations) for fit in fits]),
        (Column("Time", "s", 1), [fit.seconds for fit in fits]),
    ]
    table = Table.of(f"{info.labels[follower + 1]}, {where(info)}", filled)
    if len(results) < 2:
        return table
    percent = [f"{v:.2f} %" if np.isfinite(v) else None for v in spread.percent[follower]]
    blank = (len(table.columns) - 1 - len(percent)) * (None,)
    return replace(table, rows=(*table.rows, ("Spread", *percent, *blank)))


def marked_at_least(model: str, name: str, *parts: Parameters) -> Cell:
    """A parameter of one vehicle from its value, lower and upper end.

    A lag or delay at the least that is sought has a mark.
    """
    cell = Quantity(*(float(value_of(model, part, name)) for part in parts))
    if name not in ("lag", "delay") or not cell.lower < cell.upper:
        return cell
    if model in CTHPS:
        least = EXTRA["lag" if name == "lag" else "delay"].lower
    else:
        least = next(p.lower for p in FOLLOWING[model].parameters if p.name == name)
    return Marked(cell, LEAST, "†") if cell.value <= least + 1e-9 else cell


def with_legend(caption: str, filled: Sequence[Filled]) -> Table:
    """A table whose caption says what "†" means, where a cell has it."""
    cells = (cell for _, column in filled for cell in column)
    is_marked = any(isinstance(cell, Marked) and cell.why == LEAST for cell in cells)
    return Table.of(f"{caption} (†: {LEAST})" if is_marked else caption, filled)


def model_form_table(info: SegmentInfo, forms: Sequence[ModelForm], follower: int) -> Table:
    """One row a model, for one follower (0 for the first): estimates and intervals."""
    group = f"Quantity ({100 * LEVEL:.0f} % interval)"
    filled: list[Filled] = [(Column("Model"), [FOLLOWING[form.form].title for form in forms])]
    parts = [(f.form, [of[follower] for of in (f.parameters, f.lower, f.upper)]) for f in forms]
    for column in (*PARAMETER_COLUMNS, *TERM_COLUMNS):
        name = column.key
        cells = [marked_at_least(form, name, *sets) if name in FOLLOWING[form].names else None
                 for form, sets in parts]  # fmt: skip
        filled.append((replace(column, group=group), cells))
    filled += [
        (Column("Log-likelihood", "", 1, AGAINST), [f.likelihood_ratio[follower] for f in forms]),
        (Column("Held-out log density", "", 1, AGAINST), [f.holdout[follower] for f in forms]),
    ]
    return with_legend(f"{info.labels[follower + 1]}, {where(info)}", filled)


def earlier_table(earlier: Sequence[Result], now: Mapping[str, Result], vehicle: int) -> Table:
    """One row an earlier result that has the vehicle, by its number in the file, as a follower.

    Differences are shown from the present result of the same method, where there is one.
    """
    followers = ((result, result.info.vehicles[1:]) for result in earlier)
    rows = [(row, numbers.index(vehicle)) for row, numbers in followers if vehicle in numbers]
    then = [result.parameters[k] for result, k in rows]
    filled: list[Filled] = [
        (Column("Earlier fit", prose=True), [earlier_title(result) for result, _ in rows]),
        *parameter_cells(Parameters.stack(then)),
        (Column("Closed loop", "m", 2, GAP_MAE), [_gap_error(*row) for row in rows]),
    ]
    if now:
        change = np.full((len(rows), 3), nan)
        differs: list[str | None] = [None] * len(rows)
        for at, ((row, _), before) in enumerate(zip(rows, then, strict=True)):
            present = now.get(row.fit.method)
            if present and vehicle in present.info.vehicles[1:]:
                k = present.info.vehicles.index(vehicle) - 1
                change[at] = present.parameters[k].values - before.values
                asked = differences(row.analysis, present.analysis)
                differs[at] = "; ".join(asked) or "nothing"
        filled += parameter_cells(Parameters.of(change), "Δ, now minus then")
        filled += [(Column("Differs now in", prose=True), differs)]
    return Table.of("", filled)


def _gap_error(result: Result, k: int) -> float:
    """The closed-loop MAE of a follower's space-gap in m; nan where it was not computed."""
    errors = result.parts.evaluation and result.parts.evaluation.closed_loop
    return float(errors.gap_mae[k]) if errors else nan


def earlier_title(result: Result) -> str:
    """Method, file and window in a few words."""
    return f"{name_of(result.fit)}, {where(result.info, result.fit.case)}"


def validation_table(
    infos: Sequence[SegmentInfo],
    errors: TrackingErrors | None,
    other: SegmentInfo,
    validated: TrackingErrors | None,
) -> Table:
    """A row a follower: MAE of space-gap and speed in closed loop, where learned and on another.

    The first window of ``infos`` names the followers.
    """
    info, learned = infos[0], joined([str(part.window) for part in infos[:2]])
    learned = learned if len(infos) < 3 else f"{len(infos)} windows"
    source = "" if info.source == other.source else f"{other.source}, "
    filled: list[Filled] = [(Column("Follower"), info.labels[1:])]
    for group, key, known in (
        (f"Learned from: {learned}", "learned", errors),
        (f"Validation: {source}{other.window}", "validation", validated),
    ):
        absent = info.followers * [None]
        gaps, speeds = (known.gap_mae, known.speed_mae[1:]) if known else (absent, absent)
        filled.append((Column.of(GAP, group, f"{key}_mae_p_m"), gaps))
        filled.append((Column.of(SPEED, group, f"{key}_mae_v_m_per_s"), speeds))
    return Table.of("Validation: error of the closed-loop simulation, MAE", filled)


def judged_table(judged: Judgement, speed: MetresPerSecond) -> Table:
    """A row a model, the best first: errors in windows left out, |H|, and stability at a speed.

    The range beyond the best is one standard error about the mean of the ratios.
    """
    ranked, windows = judged.ranked, len(judged.windows)
    keys = (score.model.key for score in judged.scores)
    shares = dict(zip(keys, wins([judged]), strict=True))
    ends = [np.round(beyond(score, ranked[0])[1:]) + 0.0 for score in ranked[1:]]  # no -0
    vehicles = [stability_at(s.model, s.theta, speed) for s in ranked]
    at = f"At {3.6 * speed:.0f} km/h"
    return Table.of(
        f"{judged.info.labels[1]}: models in {windows} windows left out",
        [
            (MODEL, [score.model.title for score in ranked]),
            (Column("Gap RMSE", "m", 2, LEFT_OUT), [s.typical_rmse for s in ranked]),
            (Column("Beyond the best", "%", 0, LEFT_OUT), [None, *(Range(*pair) for pair in ends)]),
            (
                Column("Best in", group=LEFT_OUT),
                [f"{windows * shares[s.model.key]:.0f} of {windows}" for s in ranked],
            ),
            (
                Column("Collides in", group=LEFT_OUT),
                [f"{s.collided.sum()} of {windows}" for s in ranked],
            ),
            (Column("|H| off", "dB", 1), [score.gain_error for score in ranked]),
            (
                Column("Peak", "dB", MAGNITUDE.digits, at),
                [v.peak.db if v else None for v in vehicles],
            ),
            (Column("L₂", group=at), [v.l2.word if v else None for v in vehicles]),
            (
                Column.of(LINF_GAIN, at, key="linf_gain"),
                [v.linf_gain if v else None for v in vehicles],
            ),
        ],
    )


def model_parameters_table(judged: Judgement) -> Table:
    """A row a parameter of each model, with its interval, and whether the data determine it."""
    rows = [
        (score, parameter, k)
        for score in judged.ranked
        for k, parameter in enumerate(score.model.parameters)
    ]
    values = np.array([(s.theta[k], s.lower[k], s.upper[k]) for s, _, k in rows])
    known = ["the data" if s.determined[k] else "other cars" for s, _, k in rows]
    return Table.of(
        f"{judged.info.labels[1]}: parameters by closed-loop simulation of all windows",
        [
            (MODEL, [score.model.title for score, _, _ in rows]),
            (Column("Parameter"), [parameter.symbol for _, parameter, _ in rows]),
            (Column("Value", digits=4), estimate_cells(*values.T)),
            (Column("Unit"), [parameter.unit for _, parameter, _ in rows]),
            (Column("Known from"), known),
        ],
    )
