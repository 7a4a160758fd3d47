"""`fit`, `compare` and `starts`: parameters estimated from windows of a recording.

`compare --models` judges which car-following model describes each car, in windows left out.
"""

import argparse
import json
import sys
from collections import Counter
from collections.abc import Iterable, Iterator
from pathlib import Path
from textwrap import fill
from typing import Any

from tqdm import tqdm

from accpinn.cli.options import (
    METHODS_HELP,
    MODEL,
    RUN,
    SEGMENT,
    THREADS,
    VARIANTS_HELP,
    WINDOWS,
    chosen_analysis,
    chosen_store,
    named_keys,
)
from accpinn.cli.output import interruptible, note, show_result
from accpinn.cli.recordings import JSON, option
from accpinn.errors import ConfigError
from accpinn.findings import joined
from accpinn.methods import TaskContext
from accpinn.methods.estimate import Outcome
from accpinn.methods.pinn.config import DEFAULT, FAST, PRESETS, STARTS
from accpinn.methods.pinn.training import start_loading
from accpinn.methods.registry import COMPARED, method_of, recommended_method, variant_key
from accpinn.model.registry import JUDGED, PAPER, following_model
from accpinn.results.documents import (
    describe_comparison,
    describe_fit,
    describe_starts,
    judgement_document,
    notes,
)
from accpinn.results.messages import incidents, messages
from accpinn.results.messages.estimate import about_estimate, cards
from accpinn.results.messages.summary import recommended_of
from accpinn.results.naming import about_point, name_of
from accpinn.results.progress import progress_bar
from accpinn.results.tables import Table
from accpinn.results.tables.estimates import (
    errors_table,
    judged_table,
    methods_table,
    model_form_table,
    model_parameters_table,
    parameter_table,
    starts_table,
    windows_table,
)
from accpinn.results.tables.stability import assessment_table
from accpinn.segment import SegmentInfo
from accpinn.segment.windows import AUTO
from accpinn.study.comparison import Refused, compare, spread_of, starts
from accpinn.study.judge import judge, subjects_of
from accpinn.study.result import Result
from accpinn.study.run import run
from accpinn.study.snapshot import check_texts, prepare_snapshot, save, writable_path
from accpinn.study.vehicles import assessed_vehicles

_SETTINGS = {"initial": "initial", "iterations": "iterations", "lbfgs": "lbfgs_iterations",
             "seed": "seed"}  # fmt: skip
"""Options that are settings of the PiNN, with the names of these."""
_KEPT = ("name", "note")
"""Options that only a snapshot has."""
MOST_SEEDS = 100
STARTS_HELP = fill(
    "The PiNN is trained from each initial (α, β, τ) of the paper's Table I, once a seed:"
    f" {len(STARTS)} trainings with one seed, as long as `fit` takes each. The table has a row a"
    " training; its last row is the spread of the estimates, in percent."
)


def _setting(text: str) -> tuple[str, Any]:
    """A setting's name and its value, which is JSON or a text."""
    name, sign, value = text.partition("=")
    if not sign:
        raise argparse.ArgumentTypeError(
            f'"{text[:40]}" sets nothing; write --settings width=40, once for each setting.'
        )
    try:
        return name.strip(), json.loads(value)
    except ValueError:
        return name.strip(), value


FIT_HELP, COMPARE_HELP = METHODS_HELP, VARIANTS_HELP
FIT_OPTIONS = (
    *SEGMENT,
    WINDOWS,
    *MODEL,
    option("--method", metavar="NAME", help="(pinn; simulation for a model that is no CTHP)"),
    option("--preset", choices=list(PRESETS),
           help=f"of the PiNN ({DEFAULT}); fast, paper: as published, biased"),
    option("--initial", metavar="A,B,T", help="of the search: α,β,τ (1,1,1), or the model's own"),
    option("--iterations", type=int, metavar="N", help="of the PiNN, at most"),
    option("--lbfgs", type=int, metavar="N", help="L-BFGS iterations that end the paper preset"),
    option("--seed", type=int, metavar="N", help="of the PiNN's random numbers (0)"),
    option("--settings", type=_setting, action="append", default=[], metavar="NAME=VALUE",
           help="any other of the PiNN's, once for each: " + ", ".join(
               name for name in FAST.to_json() if name not in ("preset", *_SETTINGS.values()))),
    *RUN,
    option("--out", metavar="SNAPSHOT", help="save the result, with the windows' data, in a file"),
    option("--name", default="", help="of the snapshot"),
    option("--note", default="", help="in the snapshot"),
)  # fmt: skip
COMPARE_OPTIONS = (
    *SEGMENT,
    WINDOWS,
    *MODEL,
    option("--methods", default="all", metavar="all | A,B",
           help="some of those below (all)"),
    option("--models", nargs="?", const="all", metavar="all | A,B",
           help="car-following models in place of methods, each judged in windows left out: all in"
           " car-following, or those given, or blocks of one"),
    THREADS,
    JSON,
)  # fmt: skip
STARTS_OPTIONS = (
    *SEGMENT,
    option("--preset", choices=list(PRESETS), default="fast", help="(fast)"),
    option("--iterations", type=int, metavar="N", help="of each training, at most"),
    option("--seeds", type=int, default=1, metavar="N", help="per start (1)"),
    *RUN,
)


def run_fit(options: argparse.Namespace) -> int:
    """Estimate, and print the result; 130 when a training was interrupted."""
    if options.out is not None:  # training takes long: refuse before it what could not be saved
        check_texts(options.name, options.note)
        writable_path(Path(options.out), "snapshot")
    elif idle := [name for name in _KEPT if getattr(options, name)]:
        raise ConfigError(f"{idle[0]}: only a snapshot has one; give --out, or leave it out.")
    if options.preset not in (None, DEFAULT):
        start_loading()  # while the recording is read
    settings = _settings(options)
    analysis, recording = chosen_analysis(options, options.method, options.preset, settings)
    with interruptible() as stopped, progress_bar() as show_progress:
        context = TaskContext(None, options.threads, show_progress, stopped.is_set)
        result = run(analysis, recording, store=chosen_store(options), context=context)
    try:  # before it is printed, as whoever reads that may close the pipe after the first line
        if options.out is not None:
            save(prepare_snapshot(result, options.name, options.note), options.out)
    finally:
        show_result(options, lambda: describe_fit(result), lambda: fit_text(result))
    if options.out is not None:
        note(f"Saved as {options.out}.")
    return 130 if result.estimate.outcome is Outcome.STOPPED else 0


def _settings(options: argparse.Namespace) -> dict[str, Any] | None:
    """The settings that the options name; None for a method without any.

    Raises:
        ConfigError: for one that is named twice, or that the method does not have.
    """
    given = [
        (setting, _initial(value, options.model) if name == "initial" else value)
        for name, setting in _SETTINGS.items()
        if (value := getattr(options, name)) is not None
    ]
    pairs = [*given, *options.settings]
    if twice := [name for name, count in Counter(n for n, _ in pairs).items() if count > 1]:
        raise ConfigError(f"settings: {twice[0]} is given twice; give it once.")
    recommended = recommended_method(options.model, options.preset)
    method = method_of(options.method or recommended).key
    if method_of(method).settings:
        return dict(pairs)
    for name, value in [*((n, getattr(options, n)) for n in _SETTINGS), *options.settings]:
        if value is not None:
            raise ConfigError(
                f"{name}: the method {method} has no such setting, only the PiNN; leave it out."
            )
    return None


def _initial(text: str, model: str | None) -> list[float]:
    """Initial α, β, τ, or these and the own parameters of a model that is no CTHP."""
    chosen = following_model(model or PAPER)
    names = ("α", "β", "τ") if chosen.is_linear else chosen.names
    try:
        values = [float(part) for _, part in zip(names, text.split(","), strict=True)]
    except ValueError:
        raise ConfigError(
            f'initial: "{text[:40]}" is not {",".join(names)}; write {len(names)} numbers.'
        ) from None
    return values if chosen.is_linear else [*STARTS[0].complete.tolist(), *values]


def fit_text(result: Result) -> str:
    """The result as sentences and tables."""
    estimate, info = result.estimate, result.info
    followers = range(1 if info.shares(estimate.case) else info.followers)
    tables = [parameter_table(result), errors_table(result)]
    if len(result.infos) > 1 and estimate.windows is not None:
        tables += [windows_table(result, k) for k in followers]
    cached = ", answered from the cache" if estimate.cached else ""
    count = f"{estimate.iterations} iterations in " if estimate.iterations else ""
    effort = f"{count}{estimate.seconds:.1f} s{cached}"
    first = [*_by_hand(info), *(f"{card.lead} {card.trust}" for card in cards(result))]
    # The sentence about the estimate stands below the table.
    printed = [*first, f"{name_of(estimate)}: {about_point(estimate)}."]
    lines = [f"{estimate.outcome.value} ({effort})", *incidents(result.evaluation, info)]
    lines += [f"Note: {note}" for note in notes(result) if note not in printed]
    return "\n".join([*first, "", tables[0].to_text(), about_estimate(result), "",
                      *_texts(tables[1:]), *lines])  # fmt: skip


def _by_hand(info: SegmentInfo) -> tuple[str, ...]:
    """The sentence that a driver controls followers, which heads the output."""
    return (hand.sentence(info),) if (hand := info.driven_by_hand) else ()


def _texts(tables: Iterable[Table]) -> Iterator[str]:
    """Tables as text, an empty line behind each."""
    for table in tables:
        yield from (table.to_text(), "")


def run_compare(options: argparse.Namespace) -> int:
    """Run the methods, and print a row for each, with errors of both kinds."""
    if options.models:
        return run_judge(options)
    methods = named_keys(options.methods, COMPARED, variant_key)
    analysis, recording = chosen_analysis(options)
    compared = compare(analysis, recording, methods, context=TaskContext(threads=options.threads))
    outcomes = list(
        tqdm(compared, total=len(methods), unit="method", file=sys.stderr, disable=None)
    )
    results = tuple(outcome for outcome in outcomes if isinstance(outcome, Result))
    refused = tuple(outcome for outcome in outcomes if isinstance(outcome, Refused))
    if not results:
        raise refused[0].fault
    rows = results, refused
    show_result(options, lambda: describe_comparison(*rows), lambda: _comparison_text(*rows))
    return 0


def _comparison_text(results: tuple[Result, ...], refused: tuple[Refused, ...]) -> str:
    best = recommended_of(results)
    first, info = best or results[0], results[0].info
    followers, forms = range(info.followers), first.adequacy.forms
    recommended = [parameter_table(best).to_text(), about_estimate(best), ""] if best else []
    subject = assessed_vehicles(first)
    tables = [
        *(methods_table(results, k, best) for k in followers),
        *([assessment_table(subject)] if subject.has_report else ()),
        *(model_form_table(info, forms, k) for k in followers if forms),
    ]
    points = [(name_of(r.estimate), about_point(r.estimate)) for r in results]
    lines = [
        *(f"{name}: {point}." for name, point in points if point),
        *(f"{row.method} has no result: {row.fault}" for row in refused),
        *messages((*info.findings, *first.weaknesses), info),
        *(
            f"{result.estimate.method}: {sentence}"
            for result in results
            for sentence in incidents(result.evaluation, info)
        ),
        *messages(first.adequacy.findings, info),
    ]
    return "\n".join([*_by_hand(info), *recommended, *_texts(tables), *lines])


def run_judge(options: argparse.Namespace) -> int:
    """Judge the models, and print a row for each; 130 when interrupted, with those that are done.

    Every window in car-following is left out in turn, unless windows are given: then those, or
    blocks of a few.
    """
    models = named_keys(options.models, JUDGED, lambda key: following_model(key).key)
    usual = dict[str, Any](exclude=(), fixed=[], model=None, methods="all", case="II")
    if idle := [n for n, default in usual.items() if (getattr(options, n) or default) != default]:
        listed = joined([f"--{name.replace('_', '-')}" for name in idle])
        raise ConfigError(
            "models: each is judged on whole windows of single cars, all parameters free; leave"
            f" {listed} out."
        )
    analysis, recording = chosen_analysis(options)
    is_given = options.windows not in (None, AUTO)
    is_given |= options.start is not None or options.duration is not None
    subjects = subjects_of(recording, analysis.vehicles, analysis.windows if is_given else ())
    with interruptible() as stopped:
        rounds = judge(subjects, models, stopped.is_set)
        bar = tqdm(rounds, total=len(models), unit="model", file=sys.stderr, disable=None)
        *_, judged = ((), *bar)
    source = recording.source
    parts = [source]
    for car in judged:
        parts.append(judged_table(car, car.speeds[1]).to_text())
        parts.append(model_parameters_table(car).to_text())
        parts.append("\n".join(messages(car.findings, car.info)))
    if judged:
        show_result(
            options,
            lambda: {"source": source, "vehicles": [*map(judgement_document, judged)]},
            lambda: "\n\n".join(parts),
        )
    return 130 if stopped.is_set() else 0


def run_starts(options: argparse.Namespace) -> int:
    """Train the PiNN from every start of the paper's Table I, and print where each ends."""
    if not 1 <= options.seeds <= MOST_SEEDS:
        raise ConfigError(
            f"seeds: {options.seeds} is not allowed; choose 1 to {MOST_SEEDS}, each of which is"
            f" {len(STARTS)} trainings."
        )
    settings = {} if options.iterations is None else {"iterations": options.iterations}
    analysis, recording = chosen_analysis(options, "pinn", options.preset, settings)
    analyses = list(starts(analysis, seeds=range(options.seeds)))
    context, store = TaskContext(threads=options.threads), chosen_store(options)
    bar = tqdm(analyses, unit="training", file=sys.stderr, disable=None)
    results = [run(start, recording, store=store, context=context) for start in bar]
    spread, info = spread_of(results), results[0].info
    tables = (starts_table(results, spread, k) for k in range(info.followers))
    sentences = messages((*info.findings, *spread.findings), info)
    show_result(
        options,
        lambda: describe_starts(results, spread),
        lambda: "\n".join([*_texts(tables), *sentences]),
    )
    return 0
