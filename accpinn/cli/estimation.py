"""`fit`, `compare` and `starts`: parameters estimated from a window of a recording.

`compare --models` asks which car-following model describes each car, in windows left out.
"""

import argparse
import sys
from collections.abc import Iterable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import replace
from pathlib import Path
from textwrap import fill
from typing import Any

from tqdm import tqdm

from accpinn.cli.options import (
    METHODS_HELP,
    MODEL,
    RUN,
    SEGMENT,
    WINDOWS,
    chosen_analysis,
    chosen_store,
    named_keys,
)
from accpinn.cli.output import interruptible, note, show_result
from accpinn.cli.recordings import option
from accpinn.errors import ConfigError
from accpinn.findings import joined
from accpinn.methods import TaskContext
from accpinn.methods.estimate import OnProgress, Outcome, Progress
from accpinn.methods.maximum_likelihood import KEY
from accpinn.methods.pinn.config import DEFAULT, PRESETS, STARTS, PinnConfig, preset
from accpinn.methods.pinn.training import start_loading
from accpinn.methods.registry import METHODS, method_of, usual_method
from accpinn.model.cthp import Parameters
from accpinn.model.registry import CTHPS, JUDGED, PAPER, following_model
from accpinn.recordings import Window
from accpinn.results.documents import (
    describe_comparison,
    describe_fit,
    describe_starts,
    judgement_document,
    notes,
)
from accpinn.results.messages import incidents, messages
from accpinn.results.messages.answer import about_answer, cards, papers_estimate
from accpinn.results.tables import Table
from accpinn.results.tables.answer import answer_table, own_windows_table
from accpinn.results.tables.estimates import (
    intervals_table,
    judged_table,
    methods_table,
    model_form_table,
    model_parameters_table,
    name_of,
    parameter_table,
    starts_table,
)
from accpinn.results.tables.stability import known_table
from accpinn.results.vehicles import known_vehicles
from accpinn.segment import SegmentInfo
from accpinn.segment.cut import DURATION
from accpinn.study.comparison import Refused, Spread, answered, compare, spread_of, starts
from accpinn.study.judge import Judgement, judge, subjects_of
from accpinn.study.plan import AUTO
from accpinn.study.result import Result
from accpinn.study.run import run
from accpinn.study.snapshot import check_texts, named, save, writable_path

_SETTINGS = ("preset", "initial", "iterations", "lbfgs", "seed", "threads")
"""Options that only a method with settings has."""
_KEPT = ("name", "note", "with_data")
"""Options that only a snapshot has."""
MOST_SEEDS = 100
STARTS_HELP = fill(
    "The PiNN is trained from each initial (α, β, τ) of the paper's Table I, once a seed:"
    f" {len(STARTS)} trainings with one seed, as long as `fit` takes each. The table has a row a"
    " training; its last row is the spread of the estimates, in percent."
)


FIT_HELP = COMPARE_HELP = METHODS_HELP
FIT_OPTIONS = (
    *SEGMENT,
    WINDOWS,
    *MODEL,
    option("--method", choices=list(METHODS), metavar="NAME",
           help="(pinn; simulation for a model that its preset cannot estimate)"),
    option("--preset", choices=list(PRESETS), help=f"of the PiNN ({DEFAULT}); fast, paper: biased"),
    option("--initial", metavar="A,B,T", help="of the search: α,β,τ (1,1,1), or the model's own"),
    option("--iterations", type=int, metavar="N", help="of the PiNN, at most"),
    option("--lbfgs", type=int, metavar="N", help="L-BFGS iterations that end the paper preset"),
    option("--seed", type=int, metavar="N", help="of the PiNN's random numbers (0)"),
    *RUN,
    option("--intervals", action="store_true",
           help="print 90 %% intervals of the method's estimates, and what lies outside; with"
           " --out and for maximum likelihood they are printed anyway"),
    option("--out", metavar="SNAPSHOT", help="save the result, with its intervals, in this file"),
    option("--with-data", action="store_true", help="speeds and gaps in the snapshot, too"),
    option("--name", default="", help="of the snapshot"),
    option("--note", default="", help="in the snapshot"),
)  # fmt: skip
COMPARE_OPTIONS = (
    *SEGMENT,
    WINDOWS,
    *MODEL,
    option("--methods", default="all", metavar="all | A,B",
           help="some of those below, on the first window (all)"),
    option("--models", nargs="?", const="all", metavar="all | A,B",
           help="car-following models in place of methods, each judged in windows left out: all in"
           " car-following, or those given, or blocks of one"),
    *RUN,
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
    options.method = options.method or usual_method(options.model, options.preset)
    settings = _settings(options)
    if options.out is not None:  # training takes long; what would spoil its keeping is said first
        check_texts(options.name, options.note)
        writable_path(Path(options.out), "snapshot")
    elif idle := [name for name in _KEPT if getattr(options, name)]:
        listed = ", ".join(f"--{name.replace('_', '-')}" for name in idle)
        note(f"Note: {listed} has no effect without --out.")
    if settings and settings.preset != "calibrated":
        start_loading()  # while the recording is read
    analysis, recording = chosen_analysis(options, options.method, settings)
    with interruptible() as stopped, _progress_bar() as show_progress:
        context = TaskContext(None, options.threads, show_progress, stopped.is_set)
        result = run(analysis, recording, store=chosen_store(options), context=context)
    # The likelihood has ended where intervals begin, and a snapshot holds them anyway.
    asked = options.intervals or options.out is not None or options.method == KEY
    with_intervals = asked and result.fit.outcome is not Outcome.STOPPED
    try:  # before it is printed, as whoever reads that may close the pipe after the first line
        if options.out is not None:
            about = {name: getattr(options, name) for name in _KEPT}
            save(named(result, **about), options.out)
    finally:
        show_result(
            options,
            lambda: describe_fit(result, with_intervals),
            lambda: fit_text(result, with_intervals),
        )
    if options.out is not None:
        note(f"Saved as {options.out}.")
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
    is_cthp = chosen.key in CTHPS
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
            bar.set_postfix_str(f"Ψ={now.total:.3g} {values}", refresh=False)
            bar.update(now.iteration - bar.n)

        yield show_progress


def fit_text(result: Result, with_intervals: bool) -> str:
    """The result as tables and sentences; with intervals, and what lies outside."""
    fit, info, answer, is_joint = result.fit, result.info, result.answer, len(result.infos) > 1
    followers = range(1 if fit.case == "I" else info.followers) if is_joint else ()
    tables = [
        parameter_table(result, with_intervals or is_joint),
        *(own_windows_table(result.infos, answer, k) for k in followers),
    ]
    cached = ", answered from the cache" if fit.cached else ""
    count = f"{fit.iterations} iterations in " if fit.iterations else ""
    effort = f"{count}{fit.seconds:.1f} s{cached}"
    told = [f"{card.lead} {card.trust}" for card in cards(info, answer, known_vehicles(result))]
    first = [*_by_hand(info), *told]
    said = [f"{fit.outcome.value} ({effort})", *incidents(result.evaluation, result.info)]
    said += [f"Note: {note}" for note in notes(result, with_intervals) if note not in first]
    return "\n".join([*first, "", *_answer_texts(result), *_texts(tables), *said])


def _by_hand(info: SegmentInfo) -> tuple[str, ...]:
    """What comes before all else: that a driver controls followers."""
    return (hand.sentence(info),) if (hand := info.driven_by_hand) else ()


def _answer_texts(result: Result) -> tuple[str, ...]:
    """The answer's table, what it means, and an empty line."""
    table = answer_table(result.info, result.answer, result.fit.case)
    return table.to_text(), about_answer(result.answer), ""


def _texts(tables: Iterable[Table]) -> Iterator[str]:
    """Tables as text, an empty line behind each."""
    for table in tables:
        yield from (table.to_text(), "")


def run_compare(options: argparse.Namespace) -> int:
    """Run the methods, and print a row for each, with intervals and errors of both kinds."""
    if options.models:
        return run_judge(options)
    methods = named_keys(options.methods, METHODS, method_of)
    analysis, recording = chosen_analysis(options)
    compared = compare(analysis, recording, methods, context=TaskContext(threads=options.threads))
    outcomes = list(
        tqdm(compared, total=len(methods), unit="method", file=sys.stderr, disable=None)
    )
    results = tuple(outcome for outcome in outcomes if isinstance(outcome, Result))
    refused = tuple(outcome for outcome in outcomes if isinstance(outcome, Refused))
    if not results:
        raise refused[0].fault
    whole = answered(results[0], analysis, recording)
    found = whole, results, refused
    show_result(options, lambda: describe_comparison(*found), lambda: _comparison_text(*found))
    return 0


def _comparison_text(
    whole: Result, results: tuple[Result, ...], refused: tuple[Refused, ...]
) -> str:
    first, info = results[0], results[0].info
    each, forms, answer = range(info.followers), first.adequacy.forms, _answer_texts(whole)
    subject, models = known_vehicles(whole), {r.fit.model: r for r in reversed(results)}
    tables = [
        *(methods_table(info, results, k) for k in each),
        *map(intervals_table, reversed(models.values())),
        *([known_table(subject)] if subject.has_report else ()),
        *(model_form_table(info, forms, k) for k in each if forms),
    ]
    said = [
        *(f"{name_of(r.fit)}: {said}." for r in results if (said := papers_estimate(r.fit))),
        *(f"{row.method} has no result: {row.fault}" for row in refused),
        *messages((*info.findings, *first.weaknesses), info),
        *(
            f"{result.fit.method}: {sentence}"
            for result in results
            for sentence in incidents(result.evaluation, info)
        ),
        *messages((*first.evaluation.whiteness.findings, *first.adequacy.findings), info),
    ]
    return "\n".join([*_by_hand(info), *answer, *_texts(tables), *said])


def run_judge(options: argparse.Namespace) -> int:
    """Judge the models, and print a row for each; 130 when interrupted, with those that are done.

    Every window in car-following is left out in turn, unless windows are given: then those, or
    blocks of a few.
    """
    models = named_keys(options.models, JUDGED, following_model)
    usual = dict[str, Any](leave_out=(), hold=[], model=None, methods="all", case="II")
    if idle := [n for n, default in usual.items() if (getattr(options, n) or default) != default]:
        listed = joined([f"--{name.replace('_', '-')}" for name in idle])
        raise ConfigError(
            "models: each is judged on whole windows of single cars, all parameters free; leave"
            f" {listed} out."
        )
    asked, recording = chosen_analysis(options)
    one = Window(options.start, options.start + options.duration)
    is_usual = options.windows in (None, AUTO) and one == Window(0.0, DURATION)
    subjects = subjects_of(recording, asked.vehicles, () if is_usual else asked.windows)
    with interruptible() as stopped:
        rounds = judge(subjects, models, stopped.is_set)
        bar = tqdm(rounds, total=len(models), unit="model", file=sys.stderr, disable=None)
        *_, judged = ((), *bar)
    if judged:
        source = recording.source
        show_result(
            options,
            lambda: {"source": source, "vehicles": [*map(judgement_document, judged)]},
            lambda: _judged_text(source, judged),
        )
    return 130 if stopped.is_set() else 0


def _judged_text(source: str, judged: tuple[Judgement, ...]) -> str:
    parts = []
    for car in judged:
        tables = judged_table(car, car.speeds[1]), model_parameters_table(car)
        parts += [table.to_text() for table in tables]
        parts.append("\n".join(messages(car.findings, car.info)))
    return "\n\n".join([source, *parts])


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
    found = results, spread_of(results)
    show_result(options, lambda: describe_starts(*found), lambda: _starts_text(*found))
    return 0


def _starts_text(results: Sequence[Result], spread: Spread) -> str:
    info = results[0].info
    tables = (starts_table(results, spread, k) for k in range(info.followers))
    return "\n".join([*_texts(tables), *messages((*info.findings, *spread.findings), info)])
