"""Results as JSON documents: of the commands, the parameter card, a batch's groups, judged models.

A result, its estimate and its followers are described once for all of them.
"""

from collections.abc import Iterable, Sequence
from dataclasses import asdict
from typing import TYPE_CHECKING, Any

import msgspec

from accpinn.channels import by_key, fields
from accpinn.evaluation.closed_loop import ClosedLoop, TrackingErrors
from accpinn.findings import Finding, Labelled
from accpinn.inference.gain_check import GainCheck
from accpinn.inference.intervals import LEVEL, Uncertainty
from accpinn.inference.model_adequacy import ModelForm
from accpinn.methods.estimate import SPEEDS, Span
from accpinn.methods.joint_likelihood import disturbance_sizes
from accpinn.methods.registry import variant_name
from accpinn.methods.simulation import LEVEL as MODEL_LEVEL
from accpinn.model.cthp import Parameters
from accpinn.model.registry import FOLLOWING, PAPER, value_of
from accpinn.recordings.openacc import make_and_model
from accpinn.results.messages import incidents, messages
from accpinn.results.messages.summary import recommended_of
from accpinn.results.naming import about_point, name_of
from accpinn.results.tables.estimates import gains_and_own_columns
from accpinn.segment import SegmentInfo
from accpinn.stability import stability_at
from accpinn.study.comparison import Refused, Spread
from accpinn.study.description import describe
from accpinn.study.judge import Judgement, ModelScore, wins
from accpinn.study.next_drive import NextDrive
from accpinn.study.result import Result
from accpinn.study.snapshot import ATTRIBUTION_TEXT
from accpinn.units import MetresPerSecond, Quantity

if TYPE_CHECKING:  # loads pandas, which few commands need
    from accpinn.study.groups import Groups

CARD_FORMAT = "accpinn parameter card 3"


def describe_fit(result: Result) -> dict[str, Any]:
    """The result as the command-line contract has it.

    Over several windows, samples and durations are sums, errors and time gaps are means. The key
    "answer" is there for an estimate with a posterior, with the same parameters.
    """
    estimate, info = result.estimate, result.info
    samples = [part.samples for part in result.infos]
    duration = round(sum(part.window.duration for part in result.infos), 6)
    document = {
        **_described(result),
        "segment": _segment(info) | {"duration": duration, "samples": sum(samples)},
        **({"answer": answer_document(result)} if result.posterior else {}),
        "measured_gain": [check_document(check, info) for check in result.gain_checks],
        "unconstrained": _parameters(info, estimate.unconstrained),
        "active_bounds": estimate.active_bounds,
        "mae": _errors(result.evaluation.surrogate),
        "closed_loop_mae": _errors(result.evaluation.closed_loop),
        "incidents": incidents(result.evaluation, result.info),
        "mean_time_gap": result.mean_time_gaps.tolist(),
        "outcome_sentence": estimate.outcome.value,
        "notes": notes(result),
        "warnings": tuple(dict.fromkeys(messages(result.warnings, info))),
    }
    if len(result.infos) > 1:
        document["windows"] = [_window(result, k) for k in range(len(result.infos))]
    return document


def describe_comparison(
    results: tuple[Result, ...], refused: tuple[Refused, ...]
) -> dict[str, Any]:
    """The comparison as the command-line contract has it.

    The key "answer" is there where a row has a posterior.
    """
    first, info, recommended = results[0], results[0].info, recommended_of(results)
    return {
        "segment": _segment(info),
        **({"answer": answer_document(recommended)} if recommended else {}),
        "windows": [fields(part.window, "start", "duration") for part in first.infos],
        "rows": [_row(row) for row in results],
        "refused": [{"method": row.method, "reason": str(row.fault)} for row in refused],
        "warnings": messages(recommended.weaknesses, info) if recommended else (),
        "forms": [
            _form(form, vehicle, k)
            for form in first.adequacy.forms
            for k, vehicle in enumerate(info.vehicles[1:])
        ],
    }


def describe_starts(results: Sequence[Result], spread: Spread) -> dict[str, Any]:
    """Trainings from several initial values."""
    info = results[0].info
    surrogates = [result.evaluation.surrogate for result in results]
    return {
        "segment": _segment(info),
        "trials": [
            _described(result)
            | {
                "initial": result.estimate.settings["initial"],
                "surrogate_gap_mae": errors and errors.gap_mae.tolist(),
            }
            for result, errors in zip(results, surrogates, strict=True)
        ],
        "spread_percent": _of_followers(info, map(by_key, spread.percent.tolist())),
        "notes": messages(spread.findings, info),
    }


def _described(result: Result) -> dict[str, Any]:
    """What every document says of a result."""
    estimate, info, uncertainty = result.estimate, result.info, result.uncertainty
    return {
        **fields(estimate, "method", "case", "model", "loss", "network_weights", "iterations",
                 "seconds", "cached"),
        "fixed": dict(estimate.spec.fixed),
        **{name: estimate.settings.get(name) for name in ("preset", "seed")},
        "parameters": _parameters(info, estimate.parameters, estimate.model),
        "intervals": uncertainty and _intervals(info, uncertainty, estimate.model),
        "level": estimate.level,
        "outcome": estimate.outcome.name.lower(),
    }  # fmt: skip


def _window(result: Result, k: int) -> dict[str, Any]:
    """What one of several windows says by itself, where that is known, and the errors there."""
    segment, estimate, posterior = result.segments[k], result.estimate, result.posterior
    values: dict[str, Any] = {"parameters": None, "intervals": None}
    if estimate.windows is not None:
        values["parameters"] = _parameters(result.info, estimate.windows[k], estimate.model)
    if posterior:
        ends = _ends(posterior.windows_lower[k], posterior.windows_upper[k], estimate.model)
        values["intervals"] = _of_followers(result.info, ends)
    driven = ClosedLoop.of(segment, estimate)
    return {
        **fields(segment.window, "start", "duration"),
        **fields(segment, "source", "samples"),
        **fields(estimate, "model", "level"),
        **values,
        "fit": {
            "closed_loop_mae": _errors(driven.errors),
            "incidents": messages(driven.findings, segment),
        },
    }


def _row(result: Result) -> dict[str, Any]:
    """One method of a comparison, under its name there."""
    info, evaluation, estimate = result.info, result.evaluation, result.estimate
    return {
        **_described(result),
        "method": variant_name(estimate.method, estimate.settings),
        "caution": about_point(estimate) or None,
        "surrogate_mae": _errors(evaluation.surrogate),
        "closed_loop_mae": _errors(evaluation.closed_loop),
        "collisions": evaluation.collision_times(info.vehicles).tolist(),
        "incidents": incidents(evaluation, info),
        "holdout_mae": _errors(evaluation.holdout),
        "blocks_mae": [
            {
                **fields(block.window, "start", "duration"),
                "mae": _errors(block.errors),
                "incidents": messages(block.findings, info),
            }
            for block in evaluation.blocks
        ],
        "unseen_mae": _errors(evaluation.out_of_window),
        "unseen_seconds": evaluation.out_of_window_seconds,
        "notes": messages(result.findings, info),
    }


def _form(form: ModelForm, vehicle: int, k: int) -> dict[str, Any]:
    """One form of the model for one follower."""
    return {
        "form": form.form,
        "vehicle": vehicle,
        **_values(form.parameters, form.form)[k],
        "aic": form.aic[k],
        "log_likelihood_ratio": form.likelihood_ratio[k],
        "holdout": form.holdout[k],
        "intervals": _ends(form.lower, form.upper, form.form)[k] | {"level": LEVEL},
    }


# The estimate, and what rests on it


def parameter_card(snapshot: Result) -> dict[str, Any]:
    """The parameters of a snapshot, with intervals where there are, provenance and attribution.

    Examples:
        >>> import accpinn
        >>> result = accpinn.fit(accpinn.sample("motorway"), vehicles="1-2", method="splines")
        >>> sorted(accpinn.parameter_card(result))[:2]
        ['about', 'attribution']
    """
    info, estimate, posterior = snapshot.info, snapshot.estimate, snapshot.posterior
    return {
        "format": CARD_FORMAT,
        "model": _model(estimate.model),
        "fixed": dict(estimate.spec.fixed),
        "level": estimate.level,
        "interval_method": posterior and posterior.method,
        "about": about_point(estimate) or None,
        "vehicles": _of_followers(info, [_card(snapshot, k) for k in range(info.followers)]),
        **({"answer": answer_document(snapshot)} if posterior else {}),
        "provenance": {
            **fields(info, "source", "sha256"),
            "windows": [fields(part.window, "start", "duration") for part in snapshot.infos],
            "vehicles": list(info.vehicles),
            **{key: snapshot.facts.get(key) for key in ("campaign", "date", "distance_setting")},
            **fields(estimate, "method", "case", "settings"),
            "outcome": estimate.outcome.name.lower(),
            "snapshot": snapshot.id,
            "created": snapshot.created,
            "accpinn": snapshot.origin.accpinn,
        },
        "attribution": ATTRIBUTION_TEXT,
    }


def _model(key: str) -> dict[str, Any]:
    """A model for readers of a card: its name, its equations, and the units of its parameters."""
    model = FOLLOWING[key]
    return {
        "key": key,
        "name": model.title,
        "equations": ["dp/dt = Δv", model.equation],
        "parameters": [
            fields(parameter, "name", "symbol", "unit") for parameter in model.parameters
        ],
    }


def _card(snapshot: Result, k: int) -> dict[str, Any]:
    uncertainty, estimate = snapshot.uncertainty, snapshot.estimate
    make, model = make_and_model(snapshot.info.names[k + 1])
    sets = {"value": estimate.parameters}
    sets |= {"low": uncertainty.lower, "high": uncertainty.upper} if uncertainty else {}
    return {
        "make": make,
        "model": model,
        **{
            p.name: {key: float(estimate.values(part, p.name)[k]) for key, part in sets.items()}
            | {"unit": p.unit}
            for p in estimate.following.parameters
        },
        "probability_l2_stable": uncertainty and float(uncertainty.probability_l2[k]),
        "probability_linf_stable": uncertainty and float(uncertainty.probability_linf[k]),
    }


def answer_document(result: Result) -> list[dict[str, Any]]:
    """An estimate with a posterior as every document has it, one entry a follower."""
    description, posterior, rows = describe(result), result.posterior, []
    assert posterior is not None  # as the caller knows
    for k, speed in enumerate(result.estimate.speeds.tolist()):
        follower = description.follower(k)
        trusted = msgspec.structs.asdict(follower.trust)
        del trusted["vehicle"]
        trusted["reproduced"] = follower.trust.is_reproduced
        trusted["in_words"] = follower.trust.in_words
        gaps = {f"{at * 3.6:.0f}": gap.span for at, gap in follower.time_gaps.items()}
        rows.append(
            {
                "model": result.estimate.model,
                **_spans(
                    {name: value.span for name, value in follower.values.parameters.items()},
                    gaps | {"median": follower.at_median[follower.places.index(k)][2]},
                ),
                "median_speed": speed,
                "windows": len(description.infos),
                "windows_differ_p": float(posterior.differ[k]),
                "trust": trusted,
                "level": posterior.level,
            }
        )
    return _of_followers(description.info, rows)


def _quantity(of: Quantity) -> dict[str, float]:
    return {"value": of.value, "low": of.lower, "high": of.upper}


def _spans(parameters: dict[str, Span], gaps: dict[str, Span]) -> dict[str, Any]:
    """Values and intervals of parameters by name and of time gaps by speed."""
    document: dict[str, Any] = {}
    for prefix, named, spans in (("", "parameters", parameters), ("time_gap_", "time_gap", gaps)):
        document[named] = {key: span.value for key, span in spans.items()}
        document[f"{prefix}intervals"] = {key: [s.lower, s.upper] for key, s in spans.items()}
        document[f"{prefix}further_window"] = {
            key: [s.further_lower, s.further_upper] for key, s in spans.items()
        }
    return document


def groups_document(grouped: "Groups") -> dict[str, Any]:
    """The groups of a batch."""
    return {
        "by": list(grouped.by),
        "model": grouped.model,
        "level": grouped.level,
        "groups": [
            {
                **dict(zip(grouped.by, group.values, strict=True)),
                "windows": group.windows,
                "vehicles": group.vehicles,
                **_spans(
                    {name: group.span(name) for name in group.names},
                    {f"{speed * 3.6:.0f}": group.time_gap(speed) for speed in SPEEDS},
                ),
                **{name: {key: _quantity(spread) for key, spread in getattr(group, name).items()}
                   for name in ("between_windows", "between_vehicles")},
                "mean_time_gap": {
                    "median": group.mean_time_gap.value,
                    "quartiles": [group.mean_time_gap.lower, group.mean_time_gap.upper],
                },
                "margin_l2": _quantity(group.margin),
                "l2_stable": _quantity(group.l2_stable),
                "linf_stable": _quantity(group.linf_stable),
            }
            for group in grouped.groups
        ],
    }  # fmt: skip


def drive_document(proposed: NextDrive) -> dict[str, Any]:
    """A drive that is proposed, and the half widths of intervals now and after it."""
    return {
        "vehicle": proposed.vehicle,
        "name": proposed.name,
        "kind": proposed.kind,
        "level": proposed.level,
        "gain": proposed.gain,
        "motorway_gain": proposed.motorway_gain,
        "smallest_gap": proposed.smallest_gap,
        "limits": asdict(proposed.limits),
        "half_widths": [asdict(row) for row in proposed.narrowing],
        "offered": [{"kind": kind, "gain": gain} for kind, gain in proposed.offered],
        "time": proposed.time.round(1).tolist(),
        "speed": proposed.speed.round(3).tolist(),
    }


def check_document(check: GainCheck, about: Labelled) -> dict[str, Any]:
    """How far the estimate's gain is from the measured one."""
    return {**msgspec.structs.asdict(check), "sentence": check.sentence(about)}


def judgement_document(judged: Judgement) -> dict[str, Any]:
    """The models of one follower with their parameters, errors and stability."""
    low, speed, high = judged.speeds
    return {
        "vehicle": judged.info.vehicles[1],
        "name": judged.info.names[1],
        "windows": [[window.start, window.duration] for window in judged.windows],
        "speeds": {"low": low, "median": speed, "high": high},
        "models": [
            _score_document(score, speed, share)
            for score, share in zip(judged.scores, wins([judged]), strict=True)
        ],
        "best": judged.ranked[0].key,
        "clear": judged.is_clear,
        "sentences": messages(judged.findings, judged.info),
    }


def _score_document(score: ModelScore, speed: MetresPerSecond, share: float) -> dict[str, Any]:
    model, vehicle = score.model, stability_at(score.model, score.theta, speed)
    named = zip(model.names, score.theta, score.lower, score.upper, score.determined, strict=True)
    return {
        "model": score.key,
        "title": score.title,
        "parameters": {
            name: {"value": value, "interval": [low, high], "determined": bool(is_determined)}
            for name, value, low, high, is_determined in named
        },
        "level": MODEL_LEVEL,
        "gap_rmse": score.rmse.tolist(),
        "gap_mae": score.mae.tolist(),
        "time_gap_rmse": score.time_gap_rmse.tolist(),
        "collided": score.collided.tolist(),
        "wins": float(share),
        "gain_error": score.gain_error,
        "stability": vehicle
        and {
            "speed": speed,
            "peak_db": vehicle.peak.db,
            "l2_stable": vehicle.l2.stable,
            "linf_gain": vehicle.linf_gain,
        },
    }


# Parts of a document


def _segment(info: SegmentInfo) -> dict[str, Any]:
    """Which data a result rests on."""
    return {
        **fields(info.window, "start", "duration"),
        **fields(info, "source", "samples", "vehicles", "names"),
        "left_out": {"regimes": info.excluded_regimes, "share": info.excluded_share},
    }


def _of_followers(info: SegmentInfo, rows: Iterable[dict[str, Any]]) -> list[dict[str, Any]]:
    """One entry a follower: its number and name, then what its row has."""
    named = zip(info.vehicles[1:], info.names[1:], rows, strict=True)
    return [{"vehicle": vehicle, "name": name, **row} for vehicle, name, row in named]


def _values(parameters: Parameters, model: str) -> list[dict[str, float]]:
    """The parameters of each follower by name.

    A model that is no CTHP has its own parameters, and α, β and τ of its linearisation.
    """
    names = gains_and_own_columns(model)
    columns = {name: value_of(model, parameters, name).tolist() for name in names}
    return [dict(zip(columns, row, strict=True)) for row in zip(*columns.values(), strict=True)]


def _ends(lower: Parameters, upper: Parameters, model: str) -> list[dict[str, list[float]]]:
    """Both ends of the interval of each parameter by name, for each follower."""
    pairs = zip(_values(lower, model), _values(upper, model), strict=True)
    return [{name: [low[name], high[name]] for name in low} for low, high in pairs]


def _parameters(
    info: SegmentInfo, parameters: Parameters | None, model: str = PAPER
) -> list[dict[str, Any]]:
    """One entry a follower; none without parameters."""
    return _of_followers(info, _values(parameters, model)) if parameters else []


def _intervals(info: SegmentInfo, uncertainty: Uncertainty, model: str) -> list[dict[str, Any]]:
    """Both ends of the parameters and of what follows from them, one entry a follower."""
    gains = {name: getattr(uncertainty, name) for name in ("peak_gain", "linf_gain", "crossover")}
    rows = (
        ends
        | {
            "probability_l2": uncertainty.probability_l2[k],
            "probability_linf": uncertainty.probability_linf[k],
        }
        | {name: [gain.lower[k], gain.upper[k]] for name, gain in gains.items()}
        for k, ends in enumerate(_ends(uncertainty.lower, uncertainty.upper, model))
    )
    return _of_followers(info, rows)


def _errors(errors: TrackingErrors | None) -> dict[str, list[float]] | None:
    """Mean absolute errors of speeds (M+1) in m/s and gaps (M) in m."""
    return {"v": errors.speed_mae.tolist(), "p": errors.gap_mae.tolist()} if errors else None


# Sentences of a document, and of the text in its place


def notes(result: Result) -> tuple[str, ...]:
    """What was done to the data, each sentence once, then what the estimate shows."""
    estimate, info = result.estimate, result.info
    done = [sentence for part in result.infos for sentence in messages(part.findings, part)]
    if label := about_point(estimate):
        done.append(f"{name_of(estimate)}: {label}.")
    findings: list[Finding] = [finding for q in result.qualities for finding in q.findings]
    findings += [*result.findings, *disturbance_sizes(info.vehicles, estimate)]
    findings += result.gain_checks
    return tuple(dict.fromkeys([*done, *messages(findings, info)]))
