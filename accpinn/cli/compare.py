"""`compare FILE`: all methods on the same window, with intervals and errors of both kinds."""

import argparse
import sys
from typing import Any

from tqdm import tqdm

from accpinn.cli.options import (
    PARAMETER_NAMES,
    add_method_help,
    add_run_options,
    add_segment_options,
    chosen_context,
    chosen_segment,
    describe_errors,
    describe_parameters,
    describe_segment,
    fields,
)
from accpinn.cli.output import print_json, show
from accpinn.inference.identifiability import identifiability_warnings
from accpinn.inference.intervals import Uncertainty
from accpinn.inference.model_adequacy import better_forms, model_forms
from accpinn.model.published import ParameterSet
from accpinn.results.messages import messages
from accpinn.results.tables.estimates import intervals_table, methods_table, model_form_table
from accpinn.results.tables.stability import stability_interval_table
from accpinn.segment.segment import Segment
from accpinn.study.comparison import (
    MethodFailure,
    MethodResult,
    compare,
    failures_among,
    parse_methods,
    results_among,
)

WHITENESS = {
    "deviation": "deviation",
    "correlation": "correlation",
    "memory": "memory",
    "independent_samples": "independent",
    "probability_white": "probability",
}
"""Keys of the document, and the attributes they hold."""


def add_options(parser: argparse.ArgumentParser) -> None:
    """Declare the command's options."""
    add_segment_options(parser)
    add_method_help(parser)
    parser.add_argument(
        "--methods", default="all", metavar="all | A,B", help="some of those below (all)"
    )
    add_run_options(parser)
    parser.set_defaults(run=run)


def run(options: argparse.Namespace) -> int:
    """Run the methods, and print a row for each."""
    methods = parse_methods(options.methods)
    recording, segment = chosen_segment(options)
    context = chosen_context(options)
    found = compare(segment, options.case, methods, recording=recording, context=context)
    outcomes = list(tqdm(found, total=len(methods), unit="method", file=sys.stderr))
    results, failures = results_among(outcomes), failures_among(outcomes)
    if not results:
        raise failures[0].fault
    if options.json:
        print_json(_describe(segment, results, failures))
    else:
        show(_text(segment, results, failures))
    return 0


def _describe(
    segment: Segment, results: tuple[MethodResult, ...], failures: tuple[MethodFailure, ...]
) -> dict[str, Any]:
    """The comparison as the command-line contract has it."""
    return {
        "segment": describe_segment(segment),
        "rows": [_describe_result(segment, result) for result in results],
        "refused": [{"method": one.method, "reason": str(one.fault)} for one in failures],
        "warnings": _warnings(segment, results[0]),
        "forms": [
            {
                "form": form.form,
                "vehicle": vehicle,
                **dict(zip(PARAMETER_NAMES, form.parameters.values[k], strict=True)),
                "extra": form.extra[k],
                "explained": form.explained[k],
                "explained_unseen": form.holdout[k],
            }
            for form in model_forms(segment)
            for k, vehicle in enumerate(segment.vehicles[1:])
        ],
    }


def _describe_result(segment: Segment, result: MethodResult) -> dict[str, Any]:
    fit, evaluation = result.fit, result.evaluation
    return {
        **fields(fit, "method", "case", "seconds", "cached"),
        "parameters": describe_parameters(segment, fit.parameters),
        "intervals": _describe_intervals(segment, result.uncertainty),
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
        "notes": list(messages((*fit.findings, *result.uncertainty.findings), segment)),
    }


def _describe_intervals(segment: Segment, uncertainty: Uncertainty) -> list[dict[str, Any]]:
    ends = zip(uncertainty.lower.values.tolist(), uncertainty.upper.values.tolist(), strict=True)
    gains = {name: getattr(uncertainty, name) for name in ("peak_gain", "linf_gain", "crossover")}
    return [
        {
            "vehicle": vehicle,
            **{name: list(pair) for name, *pair in zip(PARAMETER_NAMES, *rows, strict=True)},
            "probability_l2": uncertainty.probability_l2[k],
            "probability_linf": uncertainty.probability_linf[k],
            "probability_gapless": uncertainty.no_gap_control[k],
            **{name: [one.lower[k], one.upper[k]] for name, one in gains.items()},
        }
        for k, (vehicle, rows) in enumerate(zip(segment.vehicles[1:], ends, strict=True))
    ]


def _text(
    segment: Segment, results: tuple[MethodResult, ...], failures: tuple[MethodFailure, ...]
) -> str:
    info, uncertainty = segment.info, results[0].uncertainty
    followers = ParameterSet(info.source, info.labels[1:], results[0].fit.parameters)
    forms, each = model_forms(segment), range(segment.followers)
    tables = [
        *(methods_table(info, results, k) for k in each),
        intervals_table(info, uncertainty),
        stability_interval_table(followers, uncertainty),
        *(model_form_table(info, forms, k) for k in each),
    ]
    said = [
        *(f"{one.method} has no result: {one.fault}" for one in failures),
        *messages(segment.findings, segment),
        *_warnings(segment, results[0]),
        *(
            f"{result.fit.method}: {sentence}"
            for result in results
            for sentence in messages(result.evaluation.all_findings, segment)
        ),
        *messages(results[0].evaluation.whiteness.findings, segment),
        *messages(better_forms(segment.vehicles, forms), segment),
    ]
    return "\n\n".join([*(table.to_text() for table in tables), "\n".join(said)])


def _warnings(segment: Segment, result: MethodResult) -> list[str]:
    """On identifiability; the same for all methods."""
    found = identifiability_warnings(segment, result.uncertainty, result.fit.case)
    return list(messages(found, segment))
