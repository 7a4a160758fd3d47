"""`judge`: car-following models on many recordings, in windows left out of their fit."""

import argparse
import os
from collections.abc import Sequence
from pathlib import Path

from accpinn.cli.options import ALL, DASK, VARIANTS_HELP, named_keys
from accpinn.cli.output import interruptible, note, print_json, show
from accpinn.cli.recordings import JSON, option
from accpinn.errors import ConfigError
from accpinn.model.registry import FOLLOWING, JUDGED
from accpinn.recordings.mapping import load_mapping
from accpinn.results.messages.summary import which_model
from accpinn.results.progress import share_bar
from accpinn.results.publication import (
    FORMATS,
    judgements_document,
    write_judgements,
    written_table,
)
from accpinn.results.tables.models import models_table, pairs_table
from accpinn.storage import folder as folder_of
from accpinn.study.cluster import plain_scheduler
from accpinn.study.judge import candidate
from accpinn.study.judging import Judgements, JudgeProgress, judge_recordings
from accpinn.study.scripts import ENDING, Script

KEPT = "judgements"
"""Folder in the cache with the scores that are known."""
FEW = 5
"""Followers of which each has a sentence of its own; --json has that of all."""
MOST_FAILURES = 3
"""Reasons that are shown; --json and --out have all."""
JUDGE_HELP = VARIANTS_HELP.partition("\n\n")[0]
JUDGE_OPTIONS = (
    option("sources", nargs="+", metavar="RECORDING", help="files, and folders with all below"),
    option("--model", action="append", default=[], metavar="FILE.py|NAME",
           help="a further model or method, by its key or by a script that registers it, which is"
           " run, also by each worker; may be given several times"),
    option("--models", default=ALL, metavar="all|A,B",
           help=f"models, or methods of those below, beside it (all: {', '.join(JUDGED)}); there"
           f" are {', '.join(FOLLOWING)}"),
    option("--reference", metavar="NAME", help="what others are compared with (the first model)"),
    option("--out", metavar="FOLDER", help="write all tables there, with what they were made with"),
    option("--format", choices=[*FORMATS], help="of the printed table (text)"),
    *DASK,
    option("--no-cache", action="store_true", help="neither read nor keep scores"),
    JSON,
)  # fmt: skip


def run_judge(options: argparse.Namespace) -> int:
    """Judge the models, and print a row for each; 130 when interrupted, with what is done."""
    if options.json and options.format:
        raise ConfigError("format: --json prints everything; leave --format out.")
    if options.workers is not None and (options.workers < 1 or options.scheduler):
        raise ConfigError(
            f"workers: {options.workers} is not allowed; choose 1 or more, and none beside a"
            " scheduler."
        )
    if options.scheduler and (warning := plain_scheduler(options.scheduler)):
        note(f"Warning: {warning}")
    scripts = [Script.read(path) for path in options.model if path.endswith(ENDING)]
    further = [name for path in options.model if not path.endswith(ENDING) for name in [path]]
    further += [name for script in scripts for name in script.names()]
    keys = (*named_keys(options.models, JUDGED, str), *further)
    for key in keys:
        candidate(key)
    if options.reference and options.reference not in keys:
        raise ConfigError(
            f"reference: {options.reference[:40]} is not judged; choose {', '.join(keys)}."
        )
    workers = None if options.scheduler else options.workers or _workers(options.sources)
    with interruptible() as stopped, share_bar() as show_share:

        def show_progress(now: JudgeProgress) -> None:
            parts = [f"{now.done:.1f}/{now.files} files", f"{now.followers} followers"]
            parts.append(f"{now.finished} fits" + f", {now.kept} known before" * (now.kept > 0))
            show_share(now.done / max(1, now.files), ", ".join(parts))

        judgements = judge_recordings(
            options.sources,
            keys,
            mapping=load_mapping(options.mapping) if options.mapping else None,
            scripts=scripts,
            folder=None if options.no_cache else folder_of("cache") / KEPT,
            workers=workers,
            scheduler=options.scheduler,
            command=options.command_line,
            on_progress=show_progress,
            should_stop=stopped.is_set,
        )
    if options.out and judgements.cars:
        write_judgements(judgements, Path(options.out), options.reference)
    if options.json:
        print_json(judgements_document(judgements, options.reference))
    elif options.format not in (None, "text"):
        table = models_table(judgements, options.reference)
        show(written_table(table, options.format).rstrip("\n"))
    else:
        show(_text(judgements, options.reference))
    return 0 if judgements.is_whole else 130


def _workers(sources: Sequence[str]) -> int | None:
    """As many processes as processors; of one file none, as they would take longer to start."""
    is_one = len(sources) == 1 and Path(sources[0]).is_file()
    return None if is_one else os.cpu_count() or 1


def _text(judgements: Judgements, reference: str | None) -> str:
    """The tables, how certain they are, and what was not judged."""
    parts = [models_table(judgements, reference).to_text()]
    if len(judgements.keys) > 2:
        parts.append(pairs_table(judgements).to_text())
    lines = [*which_model(judgements.cars)] if len(judgements.cars) <= FEW else []
    if not judgements.is_whole:
        lines.append("Stopped; what is finished is kept, and the same call goes on from there.")
    places = [
        f"{f.file}{f', vehicle {f.vehicle}' if f.vehicle else ''}" for f in judgements.failures
    ]
    reasons = [
        reason if reason.startswith(file.file) else f"{place}: {reason}"
        for place, file in zip(places, judgements.failures, strict=True)
        for reason in [file.reason]
    ]
    lines += [f"Not judged: {reason}" for reason in reasons[:MOST_FAILURES]]
    if (more := len(reasons) - MOST_FAILURES) > 0:
        lines.append(f"Not judged: {more} more files and followers; --json has all.")
    return "\n\n".join([*parts, "\n".join(lines)]).rstrip()
