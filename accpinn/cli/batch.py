"""`batch` and `table`: many recordings by several methods, and what they say by groups."""

import argparse
import math
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from tqdm import tqdm

from accpinn.channels import by_key
from accpinn.cli.estimation import add_method_help, interruptible
from accpinn.cli.options import fields
from accpinn.cli.output import note, print_json, show, show_result
from accpinn.cli.recording import add_json_option
from accpinn.errors import ConfigError
from accpinn.inference.intervals import LEVEL
from accpinn.methods.maximum_likelihood import KEY
from accpinn.recordings.mapping import load_mapping
from accpinn.results.tables.groups import group_table, pooled_table
from accpinn.results.tables.table import Table
from accpinn.segment.cut import DURATION
from accpinn.study.batch import batch
from accpinn.study.batch_progress import BatchProgress, BatchSummary
from accpinn.study.comparison import parse_methods
from accpinn.study.groups import BY, GROUPABLE, Groups, Share, Typical, group, read_study
from accpinn.study.journal import FAILURES, JOURNAL, RESULTS, damaged_lines, read_pooled

ALL = "all"
KEYS = (
    "recordings", "refused", "windows", "followers", "rows", "failed", "reused", "seconds",
    "stopped", "unknown_names",
)  # fmt: skip


def add_batch_options(parser: argparse.ArgumentParser) -> None:
    """Declare the options of `batch`."""
    option = parser.add_argument
    option("sources", nargs="+", metavar="FOLDER|FILE", help="recordings; folders with all below")
    option("--out", required=True, metavar="STUDY", help="folder of the results; is continued")
    option(
        "--window",
        default=f"{DURATION:g}",
        metavar="S|all",
        help=f"longest window in s; all: whole stretches ({DURATION:g})",
    )
    option("--methods", default=ALL, metavar="all|A,B", help="some of those below (all)")
    option("--case", choices=["I", "II"], default="II", help="I: one set for all followers (II)")
    option("--workers", type=int, metavar="N", help="processes on this machine (one a processor)")
    option("--scheduler", metavar="URL", help="of dask, as tcp://host:8786, in their place")
    option("--mapping", metavar="JSON", help="columns, units and sample time of other tables")
    add_json_option(parser)
    add_method_help(parser)


def run_batch(options: argparse.Namespace) -> int:
    """Run what is missing, and print what the batch has come to; 130 when interrupted."""
    mapping = load_mapping(options.mapping) if options.mapping else None
    with interruptible() as stopped, _progress_bar() as show_progress:
        found = batch(
            options.sources,
            options.out,
            window=_seconds(options.window),
            methods=parse_methods(options.methods),
            case=options.case,
            workers=options.workers,
            scheduler=options.scheduler,
            mapping=mapping,
            on_progress=show_progress,
            should_stop=stopped.is_set,
        )
    show_result(options, _describe_batch, _batch_text, found, options.out)
    return 130 if found.stopped else 0


def _damage(lines: int) -> str:
    many = "1 line of {} is damaged" if lines == 1 else f"{lines} lines of {{}} are damaged"
    return many.format(JOURNAL)


def _seconds(text: str) -> float:
    if text == ALL:
        return math.inf
    try:
        return float(text)
    except ValueError:
        raise ConfigError(f'window: "{text[:40]}" is no length in s; write 300 or all.') from None


@contextmanager
def _progress_bar() -> Iterator[Any]:
    """On standard error: share of all work, files or vehicles, windows, rows, time left."""
    form = "{l_bar}{bar}|{postfix}"
    with tqdm(total=1.0, file=sys.stderr, bar_format=form, mininterval=0.2) as bar:

        def show_progress(now: BatchProgress) -> None:
            bar.n = now.share
            parts = [f"{now.done:.1f}/{now.files} files", f"{now.windows} windows"]
            parts += [f"{now.rows} rows", f"{now.failed} failed"]
            if now.vehicles:
                parts.append(f"vehicles pooled {now.pooled}/{now.vehicles}")
            if now.seconds_left:
                parts.append(f"{tqdm.format_interval(now.seconds_left)} left")
            bar.set_postfix_str(", ".join(parts), refresh=True)

        yield show_progress


def _describe_batch(found: BatchSummary, _out: str) -> dict[str, Any]:
    """The batch as the command-line contract has it."""
    return fields(found, *KEYS)


def _batch_text(found: BatchSummary, out: str) -> str:
    lines = [
        f"{out}: {found.recordings} recordings, {found.windows} windows,"
        f" {found.followers} followers, {found.rows} rows in {RESULTS}"
        f" ({found.reused} of them known before), {found.seconds:.1f} s"
    ]
    if found.refused or found.failed:
        lines.append(
            f"Note: {found.refused} files could not be read and {found.failed} estimates failed;"
            f" {FAILURES} says why."
        )
    if damaged := damaged_lines(Path(out)):
        lines.append(f"Note: {_damage(damaged)}; what was there is computed again.")
    if found.unknown_names:
        listed = ", ".join(found.unknown_names)
        lines.append(f"Note: make and model stand as in the header for {listed}.")
    if found.stopped:
        lines.append("Note: stopped before the end; the same call goes on from here.")
    return "\n".join(lines)


def add_table_options(parser: argparse.ArgumentParser) -> None:
    """Declare the options of `table`."""
    option = parser.add_argument
    option("study", metavar="STUDY", help="the folder that batch wrote to")
    option("--by", default=",".join(BY), metavar="A,B", help=f"of {', '.join(GROUPABLE)}")
    option("--method", metavar="NAME", help=f"whose estimates ({KEY}, where it has some)")
    option("--level", type=float, default=LEVEL, metavar="P", help=f"of intervals ({LEVEL:g})")
    option("--pooled", action="store_true", help="each vehicle's windows with one setting together")
    option("--format", choices=[*FORMATS], default="text", help="(text)")
    add_json_option(parser)


def run_table(options: argparse.Namespace) -> int:
    """Group the rows, and print the table."""
    if options.pooled:
        for name, usual in (("by", ",".join(BY)), ("method", None), ("level", LEVEL)):
            if getattr(options, name) != usual:
                raise ConfigError(
                    f"{name}: --pooled has one row a vehicle and setting, by {KEY}, with intervals"
                    f" of {100 * LEVEL:g} %; leave --{name} out."
                )
        read_study(options.study)  # refuses what is no batch
        rows = list(read_pooled(Path(options.study)))
        if options.json:
            print_json({"vehicles": rows})
        else:
            show(FORMATS[options.format](pooled_table(rows, LEVEL)).rstrip("\n"))
        return 0
    if damaged := damaged_lines(Path(options.study)):
        note(f"Note: {_damage(damaged)}; batch computes again what was there.")
    by = tuple(dict.fromkeys(part.strip() for part in options.by.split(",") if part.strip()))
    found = group(read_study(options.study), by, options.method, options.level)
    if options.json:
        print_json(_describe_groups(found))
    else:
        show(FORMATS[options.format](group_table(found)).rstrip("\n"))
    return 0


FORMATS = {"text": Table.to_text, "csv": Table.to_csv, "latex": Table.to_latex}


def _describe_groups(found: Groups) -> dict[str, Any]:
    return {
        "by": list(found.by),
        "method": found.method,
        "level": found.level,
        "groups": [
            {
                **dict(zip(found.by, one.values, strict=True)),
                **fields(one, "windows", "vehicles"),
                **by_key(map(_describe_typical, one.parameters)),
                "mean_time_gap": {
                    "median": one.mean_time_gap.value,
                    "quartiles": [one.mean_time_gap.low, one.mean_time_gap.high],
                },
                "l2_stable": _describe_share(one.l2_stable),
                "linf_stable": _describe_share(one.linf_stable),
            }
            for one in found.groups
        ],
    }


def _describe_share(share: Share) -> dict[str, float]:
    return {"share": share.value, "low": share.low, "high": share.high}


def _describe_typical(typical: Typical) -> dict[str, Any]:
    between = typical.between
    return {
        **fields(typical, "median", "low", "high"),
        "windows": between.windows,
        "deviation": between.deviation,
        "deviation_interval": [between.lower, between.upper],
        "i_squared": between.i_squared,
        "further_window": list(between.further),
    }
