"""`fit`, `compare` and `starts`: parameters estimated from a window of a recording."""

import argparse
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import replace
from functools import partial
from pathlib import Path
from textwrap import fill
from typing import Any

import numpy as np
from tqdm import tqdm

from accpinn.channels import PARAMETER_KEYS, by_key
from accpinn.cli.options import (
    add_model_options,
    add_run_options,
    add_segment_options,
    add_windows_option,
    chosen_analysis,
    chosen_store,
    describe_errors,
    describe_intervals,
    describe_parameters,
    describe_segment,
    fields,
    incidents,
    of_followers,
)
from accpinn.cli.output import interruptible, note, show_result
from accpinn.cli.windows import (
    check_windows_options,
    chosen_windows,
    describe_windows,
    windows_tables,
)
from accpinn.errors import ConfigError
from accpinn.evaluation.closed_loop import TrackingErrors, closed_loop_errors, surrogate_errors
from accpinn.findings import Finding
from accpinn.inference.identifiability import identifiability_warnings, narrower_intervals
from accpinn.inference.intervals import LEVEL, Uncertainty
from accpinn.inference.model_adequacy import ModelForm
from accpinn.methods.fit import Fit, OnProgress, Outcome, Progress
from accpinn.methods.maximum_likelihood import KEY, disturbance_sizes
from accpinn.methods.method import TaskContext
from accpinn.methods.pinn.config import DEFAULT, PRESETS, STARTS, PinnConfig, preset
from accpinn.methods.pinn.training import start_loading
from accpinn.methods.registry import METHODS, usual_method
from accpinn.model.cthp import Parameters
from accpinn.model.models import MODELS, PAPER, terms_of
from accpinn.model.published import ParameterSet
from accpinn.model.registry import following_model
from accpinn.results.export import answer_document, check_document
from accpinn.results.judged import judged
from accpinn.results.messages import messages
from accpinn.results.messages.answer import cards
from accpinn.results.tables.answer import answer_table
from accpinn.results.tables.estimates import (
    intervals_table,
    methods_table,
    model_form_table,
    parameter_table,
    starts_table,
)
from accpinn.results.tables.stability import verdict_table
from accpinn.segment.quality import assess_quality
from accpinn.segment.segment import Segment
from accpinn.study.comparison import (
    Refused,
    Spread,
    compare,
    parse_methods,
    refused_among,
    results_among,
    spread_of,
    starts,
)
from accpinn.study.result import Result
from accpinn.study.run import run
from accpinn.study.snapshot import check_texts, named, save, writable_path
from accpinn.units import Seconds

_SETTINGS = ("preset", "initial", "iterations", "lbfgs", "seed", "threads")
"""Options that only a method with settings has."""
WHITENESS = {
    "deviation": "deviation",
    "correlation": "correlation",
    "memory": "memory",
    "independent_samples": "independent",
    "probability_white": "probability",
}
"""Keys of the document, and the attributes they hold."""
MOST_SEEDS = 100
STARTS_HELP = fill(
    "The PiNN is trained from each initial (α, β, τ) of the paper's Table I, once a seed:"
    f" {len(STARTS)} trainings with one seed, as long as `fit` takes each. The table has a row a"
    " training; its last row is the spread of the estimates, in percent."
)


def add_fit_options(parser: argparse.ArgumentParser) -> None:
    """Declare the options of `fit`."""
    add_segment_options(parser)
    add_windows_option(parser)
    add_model_options(parser)
    add_method_help(parser)
    option = parser.add_argument
    option(
        "--method", choices=list(METHODS), metavar="NAME",
        help="(pinn; simulation for a model that its preset cannot estimate)",
    )  # fmt: skip
    option("--preset", choices=list(PRESETS), help=f"of the PiNN ({DEFAULT}); fast, paper: biased")
    option("--initial", metavar="A,B,T", help="of the search: α,β,τ (1,1,1), or the model's own")
    option("--iterations", type=int, metavar="N", help="of the PiNN, at most")
    option("--lbfgs", type=int, metavar="N", help="L-BFGS iterations that end the paper preset")
    option("--seed", type=int, metavar="N", help="of the PiNN's random numbers (0)")
    add_run_options(parser)
    option(
        "--intervals", action="store_true",
        help="90 %% intervals, and what lies outside: a second; maximum likelihood has them",
    )  # fmt: skip
    option("--out", metavar="SNAPSHOT", help="save the result in this file")
    option("--with-data", action="store_true", help="speeds and gaps in the snapshot, too")
    option("--name", default="", help="of the snapshot")
    option("--note", default="", help="in the snapshot")


def run_fit(options: argparse.Namespace) -> int:
    """Estimate, and print the result; 130 when a training was interrupted."""
    options.method = options.method or usual_method(options.model, options.preset)
    settings = _settings(options)
    if options.windows:
        check_windows_options(options)
    if options.out is not None:  # training takes long; what would spoil its keeping is said first
        check_texts(options.name, options.note)
        writable_path(Path(options.out), "snapshot")
    if settings:
        start_loading()  # while the recording is read
    windows = partial(chosen_windows, options) if options.windows else None
    analysis, recording = chosen_analysis(options, options.method, settings, windows)
    with interruptible() as stopped, _progress_bar() as show_progress:
        context = TaskContext(None, options.threads, show_progress, stopped.is_set)
        result = run(analysis, recording, store=chosen_store(options), context=context)
    # The likelihood has ended where intervals begin, and a snapshot holds them anyway.
    asked = options.intervals or options.out is not None or options.method == KEY
    with_intervals = asked and result.fit.outcome is not Outcome.STOPPED
    show_result(options, describe_fit, fit_text, result, with_intervals)
    if options.out is not None:
        about = {name: getattr(options, name) for name in ("name", "note", "with_data")}
        saved = save(named(result, **about), options.out)
        note(f"Saved as {saved}.")
    return 130 if result.fit.outcome is Outcome.STOPPED else 0


def _settings(options: argparse.Namespace) -> PinnConfig | None:
    """The PiNN's settings; checked for any method, used by a method that has settings."""
    initial = options.initial
    given = {
        "initial": None if initial is None else _initial(initial, options.model),
        "iterations": options.iterations,
        "lbfgs_iterations": options.lbfgs,
        "seed": options.seed,
    }
    changes = {name: value for name, value in given.items() if value is not None}
    settings = preset(options.preset or DEFAULT, **changes)
    if METHODS[options.method].settings:
        return settings
    idle = [f"--{name}" for name in _SETTINGS if getattr(options, name) is not None]
    if idle:
        note(f"Note: {', '.join(idle)} has no effect: only the PiNN has such a setting.")
    return None


def _initial(text: str, model: str | None) -> Parameters:
    """Initial α, β, τ, or the own parameters of a model that is no CTHP."""
    chosen = following_model(model or PAPER)
    is_cthp = chosen.key in MODELS
    names = ("α", "β", "τ") if is_cthp else chosen.names
    try:
        values = [float(part) for _, part in zip(names, text.split(","), strict=True)]
    except ValueError:
        raise ConfigError(
            f'initial: "{text[:40]}" is not {",".join(names)}; write {len(names)} numbers.'
        ) from None
    return Parameters(*values) if is_cthp else Parameters(*STARTS[0].complete, *values)


@contextmanager
def _progress_bar() -> Iterator[OnProgress]:
    """A bar on standard error where that is a terminal: iterations, time left, Ψ, parameters."""
    with ExitStack() as opened:
        bar: tqdm[Any] | None = None

        def show_progress(now: Progress) -> None:
            nonlocal bar
            bar = bar or opened.enter_context(
                tqdm(total=now.iterations, initial=now.iteration, unit="it", file=sys.stderr,
                     mininterval=0.2, disable=None)
            )  # fmt: skip
            first = now.parameters[0]
            values = f"α={first.alpha:.4f} β={first.beta:.4f} τ={first.tau:.3f}"
            said = now.phase if now.is_part else f"Ψ={now.total:.3g}"
            bar.set_postfix_str(f"{said} {values}", refresh=False)
            bar.update(now.iteration - bar.n)

        yield show_progress


def describe_fit(result: Result, with_intervals: bool) -> dict[str, Any]:
    """The result as the command-line contract has it; with intervals, and what lies outside.

    Over several windows, samples and durations are sums, errors and time gaps are means.
    """
    fit, segment = result.fit, result.segments[0]
    uncertainty = result.uncertainty if with_intervals else None
    samples = [info.samples for info in result.infos]
    gaps = [assess_quality(segment).mean_time_gap for segment in result.segments]
    document = {
        **fields(fit, "method", "case", "loss", "network_weights", "iterations"),
        **fields(fit, "seconds", "cached"),
        "preset": fit.config.get("preset"),
        "seed": fit.config.get("seed"),
        "segment": describe_segment(segment)
        | {
            "duration": round(sum(info.window.duration for info in result.infos), 6),
            "samples": sum(samples),
        },
        "model": fit.model,
        "parameters": describe_parameters(segment, fit.parameters, fit.model),
        "answer": answer_document(result.info, result.answer),
        "measured_gain": [check_document(c, result.info) for c in result.gain_checks],
        "unconstrained": describe_parameters(segment, fit.unconstrained),
        "active_bounds": fit.active_bounds,
        "mae": _mean_errors(result, surrogate_errors),
        "closed_loop_mae": _mean_errors(result, closed_loop_errors),
        "incidents": _incidents(result),
        "mean_time_gap": np.average(gaps, axis=0, weights=samples).tolist(),
        "outcome": fit.outcome.name.lower(),
        "outcome_sentence": fit.outcome.value,
        "intervals": uncertainty and describe_intervals(segment, uncertainty, fit.model),
        "level": uncertainty and uncertainty.level,
        "notes": _notes(result, uncertainty),
    }
    return document | {"windows": describe_windows(result)} if result.windows else document


def _mean_errors(
    result: Result, errors_of: Callable[[Segment, Fit], TrackingErrors | None]
) -> dict[str, list[float]] | None:
    """Mean absolute errors over the samples of all windows; None where a window has none."""
    pairs = zip(result.segments, result.fits, strict=True)
    errors = [describe_errors(errors_of(segment, fit)) for segment, fit in pairs]
    known = [row for row in errors if row]
    if len(known) < len(errors):
        return None
    samples = [info.samples for info in result.infos]
    return {
        key: np.average([row[key] for row in known], axis=0, weights=samples).tolist()
        for key in known[0]
    }


def _incidents(result: Result) -> list[str]:
    pairs = zip(result.segments, result.fits, strict=True)
    return [sentence for segment, fit in pairs for sentence in incidents(segment, fit)]


def fit_text(result: Result, with_intervals: bool) -> str:
    """The result as tables and sentences; with intervals, and what lies outside."""
    fit = result.fit
    uncertainty = result.uncertainty if with_intervals else None
    alone = () if result.windows else (parameter_table(result, with_intervals),)
    tables = [*(alone or windows_tables(result))]
    cached = ", answered from the cache" if fit.cached else ""
    effort = f"{fit.iterations} iterations in {fit.seconds:.1f} s{cached}"
    said = [f"{fit.outcome.value} ({effort})", *_incidents(result)]
    notes = [f"Note: {note}" for note in _notes(result, uncertainty)]
    tables.insert(0, answer_table(result.info, result.answer))
    first = [" ".join(card) for card in cards(result.info, result.answer, judged(result))]
    text = "\n\n".join(table.to_text() for table in tables)
    return "\n".join([*first, "", text, "", *said, *notes])


def _notes(result: Result, uncertainty: Uncertainty | None) -> tuple[str, ...]:
    """What was done to the data, each sentence once, then what the estimate shows."""
    fit = result.fit
    done = [said for info in result.infos for said in messages(info.findings, info)]
    findings: list[Finding] = [] if result.windows else [*result.quality.findings]
    findings += fit.findings
    findings += () if result.windows else disturbance_sizes(result.info.vehicles, fit)
    findings += uncertainty.findings if uncertainty else ()
    findings += [*result.answer.findings, *result.gain_checks]
    return tuple(dict.fromkeys([*done, *messages(findings, result.info)]))


def add_compare_options(parser: argparse.ArgumentParser) -> None:
    """Declare the options of `compare`."""
    add_segment_options(parser)
    add_model_options(parser)
    add_method_help(parser)
    parser.add_argument(
        "--methods", default="all", metavar="all | A,B", help="some of those below (all)"
    )
    parser.add_argument(
        "--models", nargs="?", const="all", metavar="all | A,B",
        help="car-following models in place of methods, each judged in windows left out: all in"
        " car-following, or blocks of the one given",
    )  # fmt: skip
    add_run_options(parser)


def add_method_help(parser: argparse.ArgumentParser) -> None:
    """Explain the methods below the options."""
    lines = [f"  {key:<16} {method.summary}" for key, method in METHODS.items()]
    parser.epilog = "\n".join(["methods:", *lines, "", parser.epilog or ""])


def run_compare(options: argparse.Namespace) -> int:
    """Run the methods, and print a row for each, with intervals and errors of both kinds."""
    if options.models:
        from accpinn.cli.models import run_judge  # not needed for methods

        return run_judge(options)
    methods = parse_methods(options.methods)
    analysis, recording = chosen_analysis(options)
    compared = compare(analysis, recording, methods, context=TaskContext(threads=options.threads))
    outcomes = list(
        tqdm(compared, total=len(methods), unit="method", file=sys.stderr, disable=None)
    )
    results, refused = results_among(outcomes), refused_among(outcomes)
    if not results:
        raise refused[0].fault
    show_result(
        options, _describe_comparison, _comparison_text, results, refused, recording.duration
    )
    return 0


def _describe_comparison(
    results: tuple[Result, ...], refused: tuple[Refused, ...], duration: Seconds
) -> dict[str, Any]:
    """The comparison as the command-line contract has it."""
    adequacy, segment = results[0].adequacy, results[0].segments[0]
    return {
        "segment": describe_segment(segment),
        "answer": answer_document(results[0].info, results[0].answer),
        "rows": [_describe_result(segment, result) for result in results],
        "refused": [{"method": one.method, "reason": str(one.fault)} for one in refused],
        "warnings": _warnings(segment, results[0], duration),
        "forms": [
            {
                "form": form.form,
                "vehicle": vehicle,
                **by_key(form.parameters.values[k]),
                **{term: getattr(form.parameters, term)[k] for term in terms_of(form.form)},
                "aic": form.aic[k],
                "log_likelihood_ratio": form.likelihood_ratio[k],
                "holdout": form.holdout[k],
                "intervals": _describe_form_intervals(form, k),
            }
            for form in adequacy.forms
            for k, vehicle in enumerate(segment.vehicles[1:])
        ],
    }


def _describe_form_intervals(form: ModelForm, k: int) -> dict[str, Any]:
    """Both ends of the intervals of a model's parameters."""
    names = (*PARAMETER_KEYS, *terms_of(form.form))
    ends = {name: [getattr(form.lower, name)[k], getattr(form.upper, name)[k]] for name in names}
    return {**ends, "level": LEVEL}


def _describe_result(segment: Segment, result: Result) -> dict[str, Any]:
    fit, evaluation = result.fit, result.evaluation
    return {
        **fields(fit, "method", "case", "model", "seconds", "cached"),
        "parameters": describe_parameters(segment, fit.parameters, fit.model),
        "intervals": describe_intervals(segment, result.uncertainty, fit.model),
        "level": result.uncertainty.level,
        "surrogate_mae": describe_errors(evaluation.surrogate),
        "closed_loop_mae": describe_errors(evaluation.closed_loop),
        "collisions": evaluation.collision_times(segment.vehicles).tolist(),
        "incidents": messages(evaluation.all_findings, segment),
        "holdout_mae": describe_errors(evaluation.holdout),
        "blocks_mae": [
            {
                **fields(block.window, "start", "duration"),
                "mae": describe_errors(block.errors),
                "incidents": messages(block.findings, segment),
            }
            for block in evaluation.blocks
        ],
        "unseen_mae": describe_errors(evaluation.out_of_window),
        "unseen_seconds": evaluation.out_of_window_seconds,
        "whiteness": [
            {key: getattr(evaluation.whiteness, name)[k] for key, name in WHITENESS.items()}
            for k in range(segment.followers)
        ],
        "outcome": fit.outcome.name.lower(),
        "notes": messages((*fit.findings, *result.uncertainty.findings), segment),
    }


def _comparison_text(
    results: tuple[Result, ...], refused: tuple[Refused, ...], duration: Seconds
) -> str:
    info, segment, uncertainty = results[0].info, results[0].segments[0], results[0].uncertainty
    followers = ParameterSet(info.source, info.labels[1:], results[0].fit.parameters)
    stability, adequacy = results[0].stability, results[0].adequacy
    each = range(segment.followers)
    tables = [
        answer_table(info, results[0].answer),
        *(methods_table(info, results, k) for k in each),
        intervals_table(info, uncertainty),
        *([verdict_table(followers, stability, uncertainty)] if stability else ()),
        *(model_form_table(info, adequacy.forms, k) for k in each if adequacy.forms),
    ]
    said = [
        *(f"{one.method} has no result: {one.fault}" for one in refused),
        *messages(segment.findings, segment),
        *_warnings(segment, results[0], duration),
        *(
            f"{result.fit.method}: {sentence}"
            for result in results
            for sentence in messages(result.evaluation.all_findings, segment)
        ),
        *messages(results[0].evaluation.whiteness.findings, segment),
        *messages(adequacy.findings, segment),
    ]
    return "\n\n".join([*(table.to_text() for table in tables), "\n".join(said)])


def _warnings(segment: Segment, result: Result, duration: Seconds) -> tuple[str, ...]:
    """On identifiability, and what would improve it; the same for all methods."""
    warnings = identifiability_warnings(segment, result.uncertainty, result.fit.case)
    cure = narrower_intervals(segment.info, result.uncertainty, warnings, duration)
    return messages((*warnings, *cure), segment)


def add_starts_options(parser: argparse.ArgumentParser) -> None:
    """Declare the options of `starts`."""
    add_segment_options(parser)
    parser.epilog = f"{STARTS_HELP}\n\n{parser.epilog}"
    parser.add_argument("--preset", choices=list(PRESETS), default="fast", help="(fast)")
    parser.add_argument("--iterations", type=int, metavar="N", help="of each training, at most")
    parser.add_argument("--seeds", type=int, default=1, metavar="N", help="per start (1)")
    add_run_options(parser)


def run_starts(options: argparse.Namespace) -> int:
    """Train the PiNN from every start of the paper's Table I, and print where each ends."""
    if not 1 <= options.seeds <= MOST_SEEDS:
        raise ConfigError(
            f"seeds: {options.seeds} is not allowed; choose 1 to {MOST_SEEDS}, each of which is"
            f" {len(STARTS)} trainings."
        )
    config = preset(options.preset)
    if options.iterations is not None:
        config = replace(config, iterations=options.iterations)
    analysis, recording = chosen_analysis(options, "pinn", config)
    asked = list(starts(analysis, seeds=range(options.seeds)))
    context, store = TaskContext(threads=options.threads), chosen_store(options)
    bar = tqdm(asked, unit="training", file=sys.stderr, disable=None)
    results = [run(start, recording, store=store, context=context) for start in bar]
    show_result(options, _describe_starts, _starts_text, results, spread_of(results))
    return 0


def _describe_starts(results: Sequence[Result], spread: Spread) -> dict[str, Any]:
    segment = results[0].segments[0]
    return {
        "segment": describe_segment(segment),
        "trials": [
            {
                "initial": result.fit.config["initial"],
                "seed": result.fit.config["seed"],
                "parameters": describe_parameters(segment, result.parameters),
                "surrogate_gap_mae": errors and errors.gap_mae.tolist(),
                "outcome": result.fit.outcome.name.lower(),
                **fields(result.fit, "iterations", "seconds"),
            }
            for result in results
            for errors in [result.evaluation.surrogate]
        ],
        "spread_percent": of_followers(segment, spread.percent.tolist()),
        "notes": messages(spread.findings, segment),
    }


def _starts_text(results: Sequence[Result], spread: Spread) -> str:
    info = results[0].info
    tables = [starts_table(results, spread, k) for k in range(info.followers)]
    said = messages((*info.findings, *spread.findings), info)
    return "\n".join(["\n\n".join(table.to_text() for table in tables), "", *said])
