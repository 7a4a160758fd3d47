"""`batch` and `table`: many recordings by several methods, and their results by groups."""

import argparse
import math

from tqdm import tqdm

from accpinn.channels import fields
from accpinn.cli.options import ALL, CASE, DASK, VARIANTS_HELP, chosen_model, named_keys
from accpinn.cli.output import interruptible, note, print_json, show, show_result
from accpinn.cli.recordings import JSON, option
from accpinn.errors import ConfigError
from accpinn.inference.intervals import LEVEL
from accpinn.methods.registry import COMPARED, variant_key
from accpinn.model.registry import BEST, FOLLOWING
from accpinn.recordings.mapping import load_mapping
from accpinn.results.database import counted, group_table, summary_line
from accpinn.results.documents import groups_document
from accpinn.results.progress import share_bar
from accpinn.results.tables import Table
from accpinn.segment.cut import DURATION
from accpinn.study.batch import BatchProgress, batch
from accpinn.study.cluster import plain_scheduler
from accpinn.study.groups import BY, GROUPABLE, group, read_study
from accpinn.study.scripts import model_key
from accpinn.study.studies import FAILURES

KEYS = (
    "recordings", "refused", "windows", "followers", "rows", "failed", "reused", "seconds",
    "stopped", "namesakes", "unknown_names",
)  # fmt: skip

FORMATS = {"text": Table.to_text, "csv": Table.to_csv, "latex": Table.to_latex}
BATCH_HELP = VARIANTS_HELP
BATCH_OPTIONS = (
    option("sources", nargs="+", metavar="FOLDER|FILE", help="recordings; folders with all below"),
    option("--out", required=True, metavar="STUDY", help="folder of the results; is continued"),
    option("--window", default=f"{DURATION:g}", metavar="S|all",
           help=f"longest window in s; all: whole stretches ({DURATION:g})"),
    option("--methods", default=ALL, metavar="all|A,B", help="some of those below (all)"),
    CASE,
    option("--model", default=BEST, metavar="NAME",
           help=f"of the methods that can estimate it ({BEST}): {', '.join(FOLLOWING)}; or a script"
           " ending in .py that registers one, which each worker runs"),
    *DASK,
    JSON,
)  # fmt: skip
TABLE_OPTIONS = (
    option("study", metavar="STUDY", help="the folder that batch wrote to"),
    option("--by", default=",".join(BY), metavar="A,B", help=f"of {', '.join(GROUPABLE)}"),
    option("--wide", action="store_true", help="all columns, beyond the width of a terminal"),
    option("--level", type=float, default=LEVEL, metavar="P", help=f"of intervals ({LEVEL:g})"),
    option("--format", choices=[*FORMATS], help="(text)"),
    option(
        "--model",
        type=chosen_model,
        metavar="FILE.py",
        help="the script that registers the model of the batch",
    ),
    JSON,
)


def run_batch(options: argparse.Namespace) -> int:
    """Run the missing estimates, and print the counts of the batch; 130 when interrupted."""
    mapping = load_mapping(options.mapping) if options.mapping else None
    model_key(options.model)  # its script may register methods, too
    try:
        window = math.inf if options.window == ALL else float(options.window)
    except ValueError:
        raise ConfigError(
            f'window: "{options.window[:40]}" is no length in s; write 300 or all.'
        ) from None
    if options.scheduler and (warning := plain_scheduler(options.scheduler)):
        note(f"Warning: {warning}")
    with interruptible() as stopped, share_bar() as show_share:

        def show_progress(now: BatchProgress) -> None:
            parts = [f"{now.done:.1f}/{now.files} files", f"{now.finished} windows"]
            parts += [f"{now.rows} rows", f"{now.failed} failed"]
            if now.seconds_left:
                parts.append(f"{tqdm.format_interval(now.seconds_left)} left")
            show_share(now.share, ", ".join(parts))

        summary = batch(
            options.sources,
            options.out,
            window=window,
            methods=named_keys(options.methods, COMPARED, variant_key),
            case=options.case,
            model=options.model,
            workers=options.workers,
            scheduler=options.scheduler,
            mapping=mapping,
            on_progress=show_progress,
            should_stop=stopped.is_set,
        )
    show_result(options, lambda: fields(summary, *KEYS), lambda: _batch_text(summary, options.out))
    if summary.stopped:
        return 130
    return 1 if summary.refused and not summary.recordings else 0


def _batch_text(summary: BatchProgress, out: str) -> str:
    lines = [f"{out}: {summary_line(summary)}"]
    if summary.refused or summary.failed:
        lines.append(
            f"Note: {counted(summary.refused, 'file')} could not be read and"
            f" {counted(summary.failed, 'estimate')} failed; {FAILURES} says why."
        )
    if summary.unknown_names:
        listed = ", ".join(summary.unknown_names)
        lines.append(f"Note: make and model stand as in the header for {listed}.")
    return "\n".join(lines)


def run_table(options: argparse.Namespace) -> int:
    """Group the estimates, and print the table."""
    if options.json and (options.wide or options.format):
        raise ConfigError("format: --json prints everything; leave --format and --wide out.")
    by = tuple(dict.fromkeys(part.strip() for part in options.by.split(",") if part.strip()))
    grouped = group(read_study(options.study), by, options.level)
    if not grouped.groups:
        note(f"Note: no window of {options.study} has a result yet; {FAILURES} says what failed.")
    if options.json:
        print_json(groups_document(grouped))
    else:
        form = options.format or "text"
        is_wide = options.wide or form != "text"
        show(FORMATS[form](group_table(grouped, is_wide)).rstrip("\n"))
    return 0
