"""An estimate as a table, and estimates, models and windows side by side.

Intervals stand where an estimate has a posterior; without one its values stand alone.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from math import isnan, nan

import numpy as np

from accpinn.channels import GAP, LINF_GAIN, MAGNITUDE, PARAMETERS, SPEED
from accpinn.errors import ConfigError
from accpinn.evaluation.closed_loop import TrackingErrors
from accpinn.findings import joined
from accpinn.inference.intervals import LEVEL, Uncertainty
from accpinn.inference.model_adequacy import ModelForm
from accpinn.methods.estimate import SPEEDS, Estimate, Span
from accpinn.methods.registry import title_of as title_of
from accpinn.model.cthp import Parameters
from accpinn.model.registry import FOLLOWING, PAPER, TITLES, gains_and_gap, value_of
from accpinn.results import marks
from accpinn.results.naming import brief, name_of
from accpinn.results.tables import (
    Cell,
    Column,
    Filled,
    Marked,
    Range,
    Table,
    interval_cells,
)
from accpinn.segment import SegmentInfo
from accpinn.stability import stability_at
from accpinn.study import differences
from accpinn.study.comparison import Spread
from accpinn.study.description import (
    FIXED,
    LEAST,
    UNDETERMINED,
    Description,
    Value,
    is_least,
    view,
)
from accpinn.study.judge import Judgement, beyond, wins
from accpinn.study.result import Result
from accpinn.study.vehicles import ALL_OF_IT, by_hand, where
from accpinn.units import MetresPerSecond, Quantity

PARAMETER_COLUMNS = tuple(Column.of(quantity, key=quantity.key) for quantity in PARAMETERS)
TERM_COLUMNS = (
    Column("s₀", "m", 1, key="s0", may_be_fixed=True),
    Column("λ", "s", 2, key="lag", may_be_fixed=True),
    Column("d", "s", 2, key="delay", may_be_fixed=True),
)
"""Terms beside the CTHP, in the order of `cthp.TERMS`."""
OWN_DIGITS = 3
"""Decimals of the parameters of other models."""
GAP_MAE = "MAE of the space-gap"
EVERY_FOLLOWER = "Every follower"
"""The label of parameters that all followers share (Case I)."""
ALL_WINDOWS = "All windows"
"""The label of the estimate below those of single windows."""
DRIVER = "Driver"
AGAINST = "Difference from the CTHP"
MODEL, LEFT_OUT = Column("Model", key="model"), "In windows left out"
COMPARED = ("α", "β", "time gap")
"""By what estimates under different models are compared; the time gap is at the median speed."""


# The parameters of one estimate


def tables_of(description: Description) -> dict[str, Table]:
    """Every table of one estimate by its name; those of single windows are numbered by rows."""
    tables = {"parameters": parameter_table(description), "errors": errors_table(description)}
    for k, follower in enumerate(description.followers):
        if len(follower.windows) > 1:
            tables[f"windows_{k + 1}"] = windows_table(description, k)
    return tables


@view
def parameter_table(description: Description) -> Table:
    """One row a follower, or one for all that share their parameters.

    The columns are time gaps in equilibrium and the model's parameters; where there is a posterior
    they have intervals, and the last column is that of the time gap in a further window.

    Examples:
        >>> import accpinn
        >>> result = accpinn.fit(accpinn.sample("motorway"), vehicles="1-2", method="splines")
        >>> accpinn.parameter_table(result).to_frame().alpha.round(2).tolist()
        [0.09]
    """
    followers, estimate = description.followers, description.estimate
    level, last = estimate.level, estimate.stated_speed
    interval = f" ({100 * level:.0f} % interval)" if level else ""
    gaps, parameters = f"Time gap{interval}", f"Parameters{interval}"
    at_median = Column("at median speed", "s", 2, gaps, key="time_gap_at_median_speed_s")
    filled: list[Filled] = [
        (Column("Follower"), [row_label(description.info, each.number) for each in followers]),
        *((gap_column(speed, gaps, "at"), [cell_of(each.time_gaps[speed]) for each in followers])
          for speed in SPEEDS),
        (at_median, [cell_of(Value(each.at_median[0][2])) for each in followers]),
        *((replace(column, group=parameters),
           [cell_of(each.values.parameters[name]) for each in followers])
          for name, column in columns_of(estimate.model).items()),
    ]  # fmt: skip
    if level:
        ends = [each.values.time_gap.span for each in followers]
        column = gap_column(last, f"Further window ({100 * level:.0f} %)", key="further_")
        filled.append((column, [Range(span.further_lower, span.further_upper) for span in ends]))
    return Table.of(
        f"{estimate.spec.in_words} by {name_of(estimate, with_model=False)}, {_where(description)}",
        filled,
    )


def gap_column(
    speed: MetresPerSecond, group: str = "", title: str = "Time gap at", key: str = ""
) -> Column:
    """The time gap in equilibrium at a speed; ``key`` goes before its name in CSV files."""
    at = f"{speed * 3.6:.0f}"
    return Column(f"{title} {at} km/h", "s", 2, group, key=f"{key}time_gap_at_{at}_kmh_s")


def cell_of(value: Value) -> Cell:
    """A value with its interval, or alone where there is none; marked where that is to be known."""
    span, note = value.span, value.note
    if note == UNDETERMINED:
        return UNDETERMINED
    if note == FIXED:
        return Quantity(span.value, span.value, span.value)
    cell = span.value if isnan(span.lower) else span
    if isnan(span.value) or not note:
        return cell
    return Marked(cell, note, (marks.LEAST if note == LEAST else marks.EXTRAPOLATED).glyph)


@view
def windows_table(description: Description, follower: int) -> Table:
    """One row a window: what it alone says of one follower (0 for the first); below, all of them.

    It is for an estimate that has its windows' own values.
    """
    described, estimate = description.follower(follower), description.estimate
    interval = f" ({100 * estimate.level:.0f} % interval)" if estimate.level else ""
    every = [*described.windows, described.values]
    filled: list[Filled] = [
        (Column("Window"), [*(str(part.window) for part in description.infos), ALL_WINDOWS]),
        (gap_column(estimate.stated_speed), [cell_of(values.time_gap) for values in every]),
        *((replace(column, group=f"Parameters{interval}"),
           [cell_of(values.parameters[name]) for values in every])
          for name, column in columns_of(estimate.model).items()),
    ]  # fmt: skip
    label = row_label(description.info, described.number)
    caption = f"{label}: {estimate.spec.in_words}, each window alone, and all"
    return Table.of(caption, filled)


@view
def errors_table(description: Description) -> Table:
    """One row a vehicle, leader first: who drives, mean time gap, and errors of both kinds.

    The leader of the closed-loop simulation is given, so it has no error.
    """
    evaluation, hand = description.result.evaluation, by_hand(description.info)
    columns: list[Filled] = [(Column("Vehicle"), description.info.labels)]
    columns += [(c, [None, *cells]) for c, cells in driver_cells(hand)]
    columns.append(
        (Column("Mean time gap", "s", 2), [None, *description.result.mean_time_gaps.tolist()])
    )
    absent = description.info.followers * [None]
    for group, errors, digits in (
        ("Surrogate fit, MAE", evaluation.surrogate, 3),
        ("Closed-loop simulation, MAE", evaluation.closed_loop, 2),
    ):
        leader = errors.speed_mae[0] if errors and errors is evaluation.surrogate else None
        gaps, speeds = (errors.gap_mae, errors.speed_mae[1:]) if errors else (absent, absent)
        columns.append((Column("p", "m", digits, group), [None, *gaps]))
        columns.append((Column("v", "m/s", 3, group), [leader, *speeds]))
    return Table.of(f"{name_of(description.estimate)}, {_where(description)}", columns)


def _where(description: Description) -> str:
    """From which data, in a few words."""
    return where(description.info, description.estimate.case, description.infos)


def driver_cells(shares: Sequence[float]) -> Iterator[Filled]:
    """Who drives each follower in place of ACC, as a column; none where nobody does."""
    if shares:
        yield Column(DRIVER), [_driver(share) if share else None for share in shares]


def _driver(share: float) -> str:
    return "Human" if share > ALL_OF_IT else f"Human {100 * share:.0f} %"


def row_label(info: SegmentInfo, number: int) -> str:
    """The label of a vehicle; 0 stands for all followers."""
    return info.label(number) if number else EVERY_FOLLOWER


# Columns of parameters


def columns_of(model: str) -> dict[str, Column]:
    """A model's own parameters by name, in its own order: those of a CTHP α, β, τ and its terms."""
    following = FOLLOWING[model]
    if following.is_linear:
        columns = {column.key: column for column in (*PARAMETER_COLUMNS, *TERM_COLUMNS)}
        return {name: columns[name] for name in following.names}
    return {
        p.name: Column(p.symbol, p.unit, OWN_DIGITS, following.title, key=p.name, may_be_fixed=True)
        for p in following.parameters
    }


def gains_and_own_columns(model: str) -> dict[str, Column]:
    """α, β and τ, of another model than a CTHP those of its linearisation; then its own."""
    return {column.key: column for column in PARAMETER_COLUMNS} | columns_of(model)


def shown_columns(parameters: Parameters, model: str = PAPER) -> Iterator[tuple[int, Column]]:
    """The columns of (K,) sets, with their places in `Parameters.everything`.

    They are α, β and τ, and of s₀, λ and d those that a set has: τ alone says little beside an s₀.
    A model that is no CTHP has the s₀ of its linearisation, and then its own parameters.
    """
    own_columns = [] if FOLLOWING[model].is_linear else [*columns_of(model).values()]
    yield from enumerate(PARAMETER_COLUMNS)
    for at, column in enumerate(TERM_COLUMNS[: 1 if own_columns else None], len(PARAMETER_COLUMNS)):
        if np.nan_to_num(parameters.complete[:, at]).any():
            yield at, replace(column, key="linearised_s0") if own_columns else column
    yield from enumerate(own_columns, 6)


def parameter_cells(
    parameters: Parameters,
    group: str = "",
    model: str = PAPER,
    uncertainty: Uncertainty | None = None,
    is_brief: bool = False,
) -> Iterator[Filled]:
    """The parameters of (K,) vehicles, α, β and τ first, with intervals where these are known."""
    for at, column in shown_columns(parameters, model):
        values, is_term = parameters.everything[:, at], len(PARAMETER_COLUMNS) <= at < 6
        cells: Sequence[Cell] = [None if is_term and v == 0 else v for v in values]
        shown = replace(column, group=group, key="") if group else column
        if uncertainty:
            ends = (uncertainty.lower.everything[:, at], uncertainty.upper.everything[:, at])
            cells = interval_cells(values, *ends)
            level = f"{100 * uncertainty.level:.0f} % interval"
            heading = f"{column.group or group} ({level})" if group else column.group
            shown = replace(column, group=heading)
        yield replace(shown, is_brief=is_brief), cells


# Estimates side by side


def outside_interval(recommended: Estimate, other: Estimate, follower: int) -> tuple[str, ...]:
    """Which of `COMPARED` lie outside the recommended estimate's intervals, of one follower.

    The follower is 0 for the first. Nothing lies outside where no interval is known.
    """
    speed = float(recommended.speeds[follower])
    values = gains_and_gap(other.model, other.parameters[follower], speed).tolist()
    spans = recommended.gains_and_gap(follower)
    return tuple(
        symbol
        for symbol, value, span in zip(COMPARED, values, spans, strict=True)
        if not (isnan(span.lower) or span.lower <= value <= span.upper)
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
UNSEEN = (("holdout", "Hold-out", 2), ("out_of_window", "Outside the windows", 2))


def methods_table(
    results: Sequence[Result], follower: int, recommended: Result | None = None
) -> Table:
    """One row a method, for one follower (0 for the first).

    The recommended estimate, which has a posterior, is the first row, with its intervals; of all
    others it is said whether they lie inside these. Estimates of one model stand together.

    Examples:
        >>> import accpinn
        >>> recording = accpinn.sample("motorway")
        >>> methods = ("least-squares", "splines")
        >>> results = list(accpinn.compare(recording, vehicles="1-2", methods=methods))
        >>> len(accpinn.methods_table(results, follower=0).rows)
        2
    """
    rows = _compared_rows(results, follower, recommended)
    estimates = [result.estimate for result in rows]
    uncertainty = recommended.uncertainty if recommended else None
    filled: list[Filled] = [
        (Column("Method"), [name_of(estimate, with_model=False) for estimate in estimates]),
        (MODEL, [brief(estimate.model) for estimate in estimates]),
        _compared_gaps(estimates, follower, uncertainty is not None),
    ]
    sets = Parameters.stack(estimate.parameters[follower] for estimate in estimates)
    for at, (column, cells) in zip(dict(shown_columns(sets)), parameter_cells(sets), strict=True):
        shown = [*cells]
        if uncertainty and shown[0] is not None:
            ends = (
                part.everything[follower, at] for part in (uncertainty.lower, uncertainty.upper)
            )
            shown[0] = Quantity(float(sets.everything[0, at]), *map(float, ends))
        filled.append((column, shown))
    if recommended:
        filled.append(_inside(recommended, estimates, follower))
    return Table.of(_compared_caption(rows, follower), [*filled, *_compared_errors(rows, follower)])


def compared_table(
    results: Sequence[Result], follower: int, recommended: Result | None = None
) -> Table:
    """The rows of `methods_table` without errors, each model's parameters in columns of their own.

    τ of one model is not τ of another, so numbers that mean different things share no column.
    """
    rows = _compared_rows(results, follower, recommended)
    estimates = [result.estimate for result in rows]
    filled: list[Filled] = [
        (Column("Method"), [name_of(estimate, with_model=False) for estimate in estimates]),
        _compared_gaps(estimates, follower, recommended is not None),
    ]
    for model in dict.fromkeys(estimate.model for estimate in estimates):
        for name, column in columns_of(model).items():
            spans = [e.span(name, follower) if e.model == model else None for e in estimates]
            cells: list[Cell] = [span.value if span else None for span in spans]
            if recommended and spans[0]:
                cells[0] = cell_of(Value(spans[0]))
            title = "Paper's model" if model == PAPER else TITLES[model]
            filled.append((replace(column, group=title, key=f"{model}_{column.key}"), cells))
    if recommended:
        filled.append(_inside(recommended, estimates, follower))
    return Table.of(_compared_caption(rows, follower), filled)


def compared_errors_table(
    results: Sequence[Result], follower: int, recommended: Result | None = None
) -> Table:
    """The errors and times of the same rows."""
    rows = _compared_rows(results, follower, recommended)
    names = [name_of(row.estimate, with_model=False) for row in rows]
    models = [brief(row.estimate.model) for row in rows]
    return Table.of(
        _compared_caption(rows, follower),
        [(Column("Method"), names), (MODEL, models), *_compared_errors(rows, follower)],
    )


def _compared_rows(
    results: Sequence[Result], follower: int, recommended: Result | None
) -> list[Result]:
    """The recommended estimate, those of its model, and then those of others."""
    if not results and recommended is None:
        raise ConfigError("results: none is given; choose what accpinn.compare yields, in a list.")
    key = recommended.analysis.key if recommended else ""
    others = [result for result in results if result.analysis.key != key]
    rows = [recommended, *others] if recommended else others
    if not 0 <= follower < (followers := rows[0].info.followers):
        raise ConfigError(
            f"follower: {follower} is not there; choose 0 to {followers - 1}, the first is 0."
        )
    models = [*dict.fromkeys(row.estimate.model for row in rows)]
    return sorted(rows, key=lambda row: models.index(row.estimate.model))


def _compared_caption(rows: Sequence[Result], follower: int) -> str:
    info = rows[0].info
    return f"{info.labels[follower + 1]}, {where(info, windows=rows[0].infos)}"


def _compared_gaps(estimates: Sequence[Estimate], follower: int, with_interval: bool) -> Filled:
    """The time gap, which means the same under every model."""
    speed = estimates[0].stated_speed
    gaps: list[Cell] = [estimate.time_gap(speed, follower).value for estimate in estimates]
    if with_interval:
        gaps[0] = cell_of(Value(estimates[0].time_gap(speed, follower)))
    return gap_column(speed), gaps


def _inside(recommended: Result, estimates: Sequence[Estimate], follower: int) -> Filled:
    """Whether the rows below the recommended estimate lie inside its intervals."""
    away = [outside_interval(recommended.estimate, each, follower) for each in estimates]
    words = [f"no: {joined(symbols)}" if symbols else "yes" for symbols in away[1:]]
    return Column("Inside the interval", key="inside"), [None, *words]


def _compared_errors(rows: Sequence[Result], follower: int) -> Iterator[Filled]:
    """The errors of each method, and how long it took."""
    collisions = [row.evaluation.collision_times(row.info.vehicles)[follower] for row in rows]
    yield from _error_cells(rows, follower, SURROGATE, CLOSED_LOOP, *UNSEEN)
    yield Column("Collides at", "s", 1), collisions
    yield Column("Time", "s", 2, least=True), [row.estimate.seconds for row in rows]


def starts_table(results: Sequence[Result], spread: Spread, follower: int) -> Table:
    """One row a training of one follower (0 for the first), and the spread in the last."""
    info, estimates = results[0].info, [result.estimate for result in results]
    starts = [", ".join(f"{value:g}" for value in each.settings["initial"]) for each in estimates]
    sets = Parameters.stack(each.parameters[follower] for each in estimates)
    filled: list[Filled] = [
        (Column("Start (α, β, τ)"), starts),
        *parameter_cells(sets, "Learned"),
        *_error_cells(results, follower, SURROGATE, CLOSED_LOOP),
        (Column("Iterations", "", 0), [float(each.iterations) for each in estimates]),
        (Column("Time", "s", 1), [each.seconds for each in estimates]),
    ]
    table = Table.of(
        f"{info.labels[follower + 1]}, {where(info, windows=results[0].infos)}", filled
    )
    if len(results) < 2:
        return table
    percent = [f"{v:.2f} %" if np.isfinite(v) else None for v in spread.percent[follower]]
    blank = (len(table.columns) - 1 - len(percent)) * (None,)
    return replace(table, rows=(*table.rows, ("Spread", *percent, *blank)))


def model_form_table(info: SegmentInfo, forms: Sequence[ModelForm], follower: int) -> Table:
    """One row a model, for one follower (0 for the first): estimates and intervals."""
    group = f"Parameters ({100 * LEVEL:.0f} % interval)"
    filled: list[Filled] = [(Column("Model"), [FOLLOWING[form.form].title for form in forms])]
    for column in (*PARAMETER_COLUMNS, *TERM_COLUMNS):
        name, cells = column.key, list[Cell]()
        for form in forms:
            sets = (form.parameters, form.lower, form.upper)
            of = [float(value_of(form.form, part[follower], name)) for part in sets]
            span = Span(*[*of, nan, nan])
            value = Value(span, LEAST * is_least(form.form, name, span))
            cells.append(cell_of(value) if name in FOLLOWING[form.form].names else None)
        filled.append((replace(column, group=group), cells))
    filled += [
        (Column("Log-likelihood", "", 1, AGAINST), [f.likelihood_ratio[follower] for f in forms]),
        (Column("Held-out log density", "", 1, AGAINST), [f.holdout[follower] for f in forms]),
    ]
    return Table.of(f"{info.labels[follower + 1]}, {where(info)}", filled)


def earlier_table(earlier: Sequence[Result], now: Mapping[str, Result], vehicle: int) -> Table:
    """One row an earlier result that has the vehicle, by its number in the file, as a follower.

    Differences are shown from the present result of the same method, where there is one.
    """
    followers = ((result, result.info.vehicles[1:]) for result in earlier)
    rows = [(row, numbers.index(vehicle)) for row, numbers in followers if vehicle in numbers]
    then = [result.parameters[k] for result, k in rows]
    filled: list[Filled] = [
        (Column("Earlier estimate", prose=True), [earlier_title(result) for result, _ in rows]),
        *parameter_cells(Parameters.stack(then)),
        (Column("Closed loop", "m", 2, GAP_MAE), [_gap_error(*row) for row in rows]),
    ]
    if now:
        change = np.full((len(rows), 3), nan)
        differs: list[str | None] = [None] * len(rows)
        for at, ((row, _), before) in enumerate(zip(rows, then, strict=True)):
            present = now.get(row.analysis.method)
            if present and vehicle in present.info.vehicles[1:]:
                k = present.info.vehicles.index(vehicle) - 1
                change[at] = present.parameters[k].values - before.values
                changes = differences(row.analysis, present.analysis)
                differs[at] = "; ".join(changes) or "nothing"
        filled += parameter_cells(Parameters.of(change), "Δ, now minus then")
        filled += [(Column("Differs now in", prose=True), differs)]
    return Table.of("", filled)


def _gap_error(result: Result, k: int) -> float:
    """The closed-loop MAE of a follower's space-gap in m; nan where it cannot be simulated."""
    errors = result.evaluation.closed_loop
    return float(errors.gap_mae[k]) if errors else nan


def earlier_title(result: Result) -> str:
    """Method, file and windows in a few words."""
    estimate = result.estimate
    return f"{name_of(estimate)}, {where(result.info, estimate.case, result.infos)}"


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
    for group, key, tracking in (
        (f"Learned from: {learned}", "learned", errors),
        (f"Validation: {source}{other.window}", "validation", validated),
    ):
        absent = info.followers * [None]
        gaps, speeds = (tracking.gap_mae, tracking.speed_mae[1:]) if tracking else (absent, absent)
        filled.append((Column.of(GAP, group, f"{key}_mae_p_m"), gaps))
        filled.append((Column.of(SPEED, group, f"{key}_mae_v_m_per_s"), speeds))
    return Table.of("Validation: error of the closed-loop simulation, MAE", filled)


def judged_table(judged: Judgement, speed: MetresPerSecond) -> Table:
    """A row a model, the best first: errors in windows left out, |H|, and stability at a speed.

    The range beyond the best is one standard error about the mean of the ratios.
    """
    ranked, windows = judged.ranked, len(judged.windows)
    keys = (score.key for score in judged.scores)
    shares = dict(zip(keys, wins([judged]), strict=True))
    ends = [np.round(beyond(score, ranked[0])[1:]) + 0.0 for score in ranked[1:]]  # no -0
    vehicles = [stability_at(s.model, s.theta, speed) for s in ranked]
    at = f"At {3.6 * speed:.0f} km/h"
    return Table.of(
        f"{judged.info.labels[1]}: models in {windows} windows left out",
        [
            (MODEL, [score.title for score in ranked]),
            (Column("Gap RMSE", "m", 2, LEFT_OUT), [s.typical_rmse for s in ranked]),
            (Column("Beyond the best", "%", 0, LEFT_OUT), [None, *(Range(*pair) for pair in ends)]),
            (
                Column("Best in", group=LEFT_OUT),
                [f"{windows * shares[s.key]:.0f} of {windows}" for s in ranked],
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
    """A row a parameter of each model, with its interval where the data determine it."""
    rows = [
        (score, parameter, k)
        for score in judged.ranked
        for k, parameter in enumerate(score.model.parameters)
    ]
    cells: list[Cell] = [
        Quantity(float(s.theta[k]), float(s.lower[k]), float(s.upper[k]))
        if s.determined[k]
        else UNDETERMINED
        for s, _, k in rows
    ]
    return Table.of(
        f"{judged.info.labels[1]}: parameters by closed-loop simulation of all windows",
        [
            (MODEL, [score.title for score, _, _ in rows]),
            (Column("Parameter"), [parameter.symbol for _, parameter, _ in rows]),
            (Column("Value", digits=4), cells),
            (Column("Unit"), [parameter.unit for _, parameter, _ in rows]),
        ],
    )
