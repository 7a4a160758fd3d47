"""`starts FILE`: the PiNN from several initial values and seeds, as the paper's Table I."""

import argparse
import sys
from dataclasses import replace
from textwrap import fill
from typing import Any

from tqdm import tqdm

from accpinn.cli.options import (
    PARAMETER_NAMES,
    add_run_options,
    add_segment_options,
    chosen_context,
    chosen_segment,
    describe_parameters,
    describe_segment,
    fields,
)
from accpinn.cli.output import print_json, show
from accpinn.errors import ConfigError
from accpinn.inference.multistart import MultistartResult, multistart, summarise
from accpinn.methods.pinn.config import STARTS, preset
from accpinn.results.messages import messages
from accpinn.results.tables.estimates import multistart_table
from accpinn.segment.segment import Segment

MOST_SEEDS = 100
ABOUT = fill(
    "The PiNN is trained from each initial (α, β, τ) of the paper's Table I, once a seed:"
    f" {len(STARTS)} trainings with one seed, as long as `fit` takes each. The table has a row a"
    " training; its last row is the spread of the estimates, in percent."
)


def add_options(parser: argparse.ArgumentParser) -> None:
    """Declare the command's options."""
    add_segment_options(parser)
    parser.epilog = f"{ABOUT}\n\n{parser.epilog}"
    parser.add_argument("--preset", choices=["fast", "paper"], default="fast", help="(fast)")
    parser.add_argument("--iterations", type=int, metavar="N", help="of each training, at most")
    parser.add_argument("--seeds", type=int, default=1, metavar="N", help="per start (1)")
    add_run_options(parser)
    parser.set_defaults(run=run)


def run(options: argparse.Namespace) -> int:
    """Train from every start, and print where each ends."""
    if not 1 <= options.seeds <= MOST_SEEDS:
        raise ConfigError(
            f"seeds: {options.seeds} is not allowed; choose 1 to {MOST_SEEDS}, each of which is"
            f" {len(STARTS)} trainings."
        )
    config = preset(options.preset)
    if options.iterations is not None:
        config = replace(config, iterations=options.iterations)
    _, segment = chosen_segment(options)
    trials = multistart(
        segment, options.case, config, seeds=range(options.seeds), context=chosen_context(options)
    )
    total = options.seeds * len(STARTS)
    found = summarise(segment, list(tqdm(trials, total=total, unit="training", file=sys.stderr)))
    if options.json:
        print_json(_describe(segment, found))
    else:
        tables = [multistart_table(segment.info, found, k) for k in range(segment.followers)]
        show("\n\n".join(table.to_text() for table in tables))
        show("\n".join(["", *messages((*segment.findings, *found.findings), segment)]))
    return 0


def _describe(segment: Segment, found: MultistartResult) -> dict[str, Any]:
    return {
        "segment": describe_segment(segment),
        "trials": [
            {
                "initial": trial.initial.values.tolist(),
                "seed": trial.seed,
                "parameters": describe_parameters(segment, trial.fit.parameters),
                "surrogate_gap_mae": trial.surrogate and trial.surrogate.gap_mae.tolist(),
                "outcome": trial.fit.outcome.name.lower(),
                **fields(trial.fit, "iterations", "seconds"),
            }
            for trial in found.trials
        ],
        "spread_percent": [
            {"vehicle": vehicle, **dict(zip(PARAMETER_NAMES, row, strict=True))}
            for vehicle, row in zip(segment.vehicles[1:], found.spread.tolist(), strict=True)
        ],
        "notes": list(messages(found.findings, segment)),
    }
