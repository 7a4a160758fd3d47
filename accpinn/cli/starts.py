"""`starts FILE`: the PiNN from several initial values and seeds, as the paper's Table I."""

import argparse
import sys
from dataclasses import replace
from typing import Any

import numpy as np
from tqdm import tqdm

from accpinn.cli.fit import add_segment_options, chosen_segment, describe_segment, parameter_rows
from accpinn.cli.output import print_json, show, table
from accpinn.errors import ConfigError
from accpinn.inference.multistart import MultistartResult, Trial, multistart, summarise
from accpinn.methods.pinn.config import STARTS, preset
from accpinn.methods.store import Store
from accpinn.segment.segment import Segment

MOST_SEEDS = 100


def add_options(parser: argparse.ArgumentParser) -> None:
    """Declare the command's options."""
    add_segment_options(parser)
    parser.add_argument("--preset", choices=["fast", "paper"], default="fast")
    parser.add_argument("--iterations", type=int, metavar="N", help="at most so many each")
    parser.add_argument("--seeds", type=int, default=1, metavar="N", help="as many seeds each (1)")
    parser.add_argument("--threads", type=int, metavar="N", help="processor threads for training")
    parser.add_argument("--no-cache", action="store_true", help="neither read nor keep results")
    parser.add_argument("--json", action="store_true", help="one JSON document")
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
    store = None if options.no_cache else Store()
    trials: list[Trial] = []
    asked = [(initial, seed) for seed in range(options.seeds) for initial in STARTS]
    for initial, seed in tqdm(asked, unit="training", file=sys.stderr):
        one = multistart(
            segment,
            options.case,
            config,
            initials=[initial],
            seeds=[seed],
            store=store,
            threads=options.threads,
        )
        trials.extend(one.trials)
    found = summarise(segment, tuple(trials))
    if options.json:
        print_json(_describe(segment, found))
    else:
        show(_text(segment, found))
    return 0


def _describe(segment: Segment, found: MultistartResult) -> dict[str, Any]:
    return {
        "segment": describe_segment(segment),
        "trials": [
            {
                "initial": list(trial.initial),
                "seed": trial.seed,
                "parameters": parameter_rows(segment, trial.fit.parameters),
                "surrogate_gap_mae": _gaps(trial),
                "outcome": trial.fit.outcome.name.lower(),
                "iterations": trial.fit.iterations,
                "seconds": trial.fit.seconds,
            }
            for trial in found.trials
        ],
        "spread_percent": [
            {"vehicle": vehicle, **dict(zip(("alpha", "beta", "tau"), row, strict=True))}
            for vehicle, row in zip(segment.vehicles[1:], found.spread.tolist(), strict=True)
        ],
        "notes": list(found.notes),
    }


def _gaps(trial: Trial) -> list[float] | None:
    return trial.surrogate.gap_mae.tolist() if trial.surrogate else None


def _text(segment: Segment, found: MultistartResult) -> str:
    head = ["vehicle", "from α, β, τ", "seed", "α (1/s²)", "β (1/s)", "τ (s)"]
    head += ["surrogate gap MAE (m)"]
    lines = []
    for k, label in enumerate(segment.labels[1:]):
        for trial in found.trials:
            law, gaps = trial.fit.parameters[k], _gaps(trial)
            start = ", ".join(f"{value:g}" for value in trial.initial)
            ends = [f"{law.alpha:.4f}", f"{law.beta:.4f}", f"{law.tau:.3f}"]
            lines.append([label, start, str(trial.seed), *ends, f"{gaps[k]:.3f}" if gaps else "-"])
        spread = [f"{value:.2g} %" if np.isfinite(value) else "-" for value in found.spread[k]]
        lines.append(["", "spread", "", *spread, ""])
    return "\n".join([table(head, lines), "", *segment.notes, *found.notes])
