"""`compare FILE`: all methods on the same window, with intervals and errors of both kinds."""

import argparse
import sys
from collections.abc import Sequence
from typing import Any

import numpy as np
from tqdm import tqdm

from accpinn.cli.fit import add_segment_options, chosen_segment, describe_segment, parameter_rows
from accpinn.cli.output import print_json, show, table
from accpinn.evaluation.errors import TrackingErrors
from accpinn.inference.identifiability import identifiability_warnings
from accpinn.inference.model_adequacy import better, model_forms
from accpinn.methods.store import Store
from accpinn.segment.segment import Segment
from accpinn.study.comparison import (
    MethodFailure,
    MethodResult,
    compare,
    failures_among,
    parse_methods,
    results_among,
)


def add_options(parser: argparse.ArgumentParser) -> None:
    """Declare the command's options."""
    add_segment_options(parser)
    parser.add_argument("--methods", default="all", metavar="all | A,B", help="which (all)")
    parser.add_argument("--threads", type=int, metavar="N", help="processor threads for the PiNN")
    parser.add_argument("--no-cache", action="store_true", help="neither read nor keep results")
    parser.add_argument("--json", action="store_true", help="one JSON document")
    parser.set_defaults(run=run)


def run(options: argparse.Namespace) -> int:
    """Run the methods, and print a row for each."""
    methods = parse_methods(options.methods)
    recording, segment = chosen_segment(options)
    found = compare(
        segment,
        options.case,
        methods,
        store=None if options.no_cache else Store(),
        threads=options.threads,
        recording=recording,
    )
    results = list(tqdm(found, total=len(methods), unit="method", file=sys.stderr))
    rows, refused = list(results_among(results)), failures_among(results)
    if not rows:
        raise refused[0].fault
    if options.json:
        described = [_describe(segment, row) for row in rows]
        about = describe_segment(segment)
        warnings = _warnings(segment, rows[0])
        forms = _forms(segment)
        without = [{"method": one.method, "reason": one.reason} for one in refused]
        print_json(
            {
                "segment": about,
                "rows": described,
                "refused": without,
                "warnings": warnings,
                "forms": forms,
            }
        )
    else:
        show(_text(segment, rows, refused))
    return 0


def _describe(segment: Segment, row: MethodResult) -> dict[str, Any]:
    """A row as the command-line contract has it."""
    fit, uncertainty, worth = row.fit, row.uncertainty, row.evaluation
    return {
        "method": fit.method,
        "case": fit.case,
        "parameters": parameter_rows(segment, fit.parameters),
        "intervals": [
            {
                "vehicle": vehicle,
                "alpha": [uncertainty.lower[k, 0], uncertainty.upper[k, 0]],
                "beta": [uncertainty.lower[k, 1], uncertainty.upper[k, 1]],
                "tau": [uncertainty.lower[k, 2], uncertainty.upper[k, 2]],
                "probability_l2": uncertainty.probability_l2[k],
                "probability_linf": uncertainty.probability_linf[k],
                "probability_gapless": uncertainty.gapless[k],
                "peak_gain": [uncertainty.peak_gain.lower[k], uncertainty.peak_gain.upper[k]],
                "linf_gain": [uncertainty.linf_gain.lower[k], uncertainty.linf_gain.upper[k]],
                "crossover": [uncertainty.crossover.lower[k], uncertainty.crossover.upper[k]],
            }
            for k, vehicle in enumerate(segment.vehicles[1:])
        ],
        "level": uncertainty.level,
        "surrogate_mae": _errors(worth.surrogate),
        "closed_loop_mae": _errors(worth.closed_loop),
        "collisions": worth.collisions.tolist(),
        "incidents": list(worth.incidents),
        "holdout_mae": _errors(worth.held_out),
        "blocks_mae": [
            {
                "start": block.start,
                "duration": block.duration,
                "mae": _errors(block.errors),
                "incidents": list(block.incidents),
            }
            for block in worth.blocks
        ],
        "unseen_mae": _errors(worth.unseen),
        "unseen_seconds": worth.out_of_window_seconds,
        "whiteness": [
            {
                "deviation": worth.whiteness.deviation[k],
                "correlation": worth.whiteness.correlation[k],
                "memory": worth.whiteness.memory[k],
                "independent_samples": worth.whiteness.independent[k],
                "probability_white": worth.whiteness.probability[k],
            }
            for k in range(segment.followers)
        ],
        "seconds": fit.seconds,
        "cached": fit.cached,
        "outcome": fit.outcome.name.lower(),
        "notes": [*fit.notes, *uncertainty.notes],
    }


def _errors(errors: TrackingErrors | None) -> dict[str, list[float]] | None:
    if errors is None:
        return None
    return {"v": errors.speed_mae.tolist(), "p": errors.gap_mae.tolist()}


def _text(segment: Segment, rows: list[MethodResult], refused: Sequence[MethodFailure]) -> str:
    head = ["method", "vehicle", "α (1/s²)", "β (1/s)", "τ (s)"]
    head += ["surrogate gap MAE (m)", "closed loop (m)", "held out (m)"]
    head += ["rest of the recording (m)", "seconds"]
    lines = []
    for row in rows:
        for k, (label, law) in enumerate(zip(segment.labels[1:], row.fit.parameters, strict=True)):
            lines.append(
                [
                    row.fit.method if k == 0 else "",
                    label,
                    f"{law.alpha:.4f}",
                    f"{law.beta:.4f}",
                    f"{law.tau:.3f}",
                    _gap(row.evaluation.surrogate, k, 3),
                    _gap(row.evaluation.closed_loop, k, 2),
                    _gap(row.evaluation.held_out, k, 2),
                    _gap(row.evaluation.unseen, k, 2),
                    f"{row.fit.seconds:.2f}" if k == 0 else "",
                ]
            )
    uncertainty = rows[0].uncertainty
    lines_of_doubt = []
    for k, label in enumerate(segment.labels[1:]):
        ends = [
            f"{symbol} {low:.4f} to {high:.4f}" if np.isfinite(high) else f"{symbol} from {low:.4f}"
            for symbol, low, high in zip(
                "αβτ", uncertainty.lower[k], uncertainty.upper[k], strict=True
            )
        ]
        lines_of_doubt.append(
            f"{label}: {', '.join(ends)} ({100 * uncertainty.level:.0f} % intervals);"
            f" share of such laws that is L2 stable {uncertainty.probability_l2[k]:.2f}, L∞ stable"
            f" {uncertainty.probability_linf[k]:.2f}, without gap control"
            f" {uncertainty.gapless[k]:.2f}"
        )
    said = [
        *(f"{one.method} has no row: {one.reason}" for one in refused),
        *segment.notes,
        *_warnings(segment, rows[0]),
        *_incidents(rows),
        *rows[0].evaluation.whiteness.sentences,
        *better(segment.labels[1:], model_forms(segment)),
    ]
    return "\n".join([table(head, lines), "", *lines_of_doubt, "", *said])


def _warnings(segment: Segment, row: MethodResult) -> list[str]:
    """What the data cannot tell; the same for all methods."""
    return list(identifiability_warnings(segment, row.uncertainty, row.fit.case))


def _forms(segment: Segment) -> list[dict[str, Any]]:
    """What the parameters would be if the law had one term more."""
    return [
        {
            "form": found.form,
            "vehicle": vehicle,
            **dict(zip(("alpha", "beta", "tau"), found.parameters[k], strict=True)),
            "extra": found.extra[k],
            "explained": found.explained[k],
            "explained_unseen": found.unseen[k],
        }
        for found in model_forms(segment)
        for k, vehicle in enumerate(segment.vehicles[1:])
    ]


def _incidents(rows: list[MethodResult]) -> list[str]:
    return [
        f"{row.fit.method}: {incident}" for row in rows for incident in row.evaluation.incidents
    ]


def _gap(errors: TrackingErrors | None, follower: int, digits: int) -> str:
    known = errors is not None and np.isfinite(errors.gap_mae[follower])
    return f"{errors.gap_mae[follower]:.{digits}f}" if errors and known else "-"
