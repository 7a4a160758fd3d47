"""The options that name a recording, and the commands `info` and `download`.

`info` is called for one file after the other: nothing here imports the estimators.
"""

import argparse
import sys
from collections import Counter
from collections.abc import Callable
from dataclasses import asdict
from operator import methodcaller
from pathlib import Path
from typing import Any

import msgspec
from tqdm import tqdm

from accpinn.channels import fields
from accpinn.cli.output import interruptible, note, print_error, print_json, show, show_result
from accpinn.recordings import FLAGS, Recording, facts_of
from accpinn.recordings.files import opened, read
from accpinn.recordings.mapping import load_mapping, write_mapping
from accpinn.recordings.openacc import PUBLISHED_AT, Run, find
from accpinn.results.messages import messages
from accpinn.results.tables import Column, Table
from accpinn.storage import folder as folder_of

Option = Callable[[Any], object]
"""Adds an option, or several that exclude each other, to a parser."""


def option(*names: str, **settings: Any) -> Option:
    """An option with the arguments of `ArgumentParser.add_argument`."""
    return methodcaller("add_argument", *names, **settings)


JSON = option("--json", action="store_true", help="one JSON document")
RECORDING = (
    option("file", metavar="FILE",
           help="an OpenACC run, a table of pairs, or any table (csv, gz, xlsx, parquet, FCD xml)"),
    option("--trajectory", metavar="ID", help="which one of a table that holds several"),
    option("--mapping", metavar="JSON",
           help="which columns of any other table hold what (info --propose prints one)"),
)  # fmt: skip
"""The options that name a file, a run in it and its mapping."""
INFO_OPTIONS = (
    *RECORDING,
    option("--propose", action="store_true",
           help="print the mapping that the columns' names, units and values propose, as JSON;"
           " the reasons on standard error"),
    JSON,
)  # fmt: skip
DOWNLOAD_OPTIONS = (
    option("names", nargs="*", metavar="CAMPAIGN|FILE", help="runs of the catalogue (all)"),
    option("--to", metavar="FOLDER", help="where recordings are kept (ACCPINN_RECORDINGS)"),
    option("--list", action="store_true", help="show the catalogue, and what is there already"),
    option("--from", dest="base", default=PUBLISHED_AT, metavar="URL", help="of a mirror"),
    JSON,
)


def chosen_recording(options: argparse.Namespace) -> Recording:
    """The recording that the options name."""
    mapping = load_mapping(options.mapping) if options.mapping else None
    return read(options.file, trajectory=options.trajectory, mapping=mapping)


def run_info(options: argparse.Namespace) -> int:
    """Print a recording's facts, vehicles and findings; or the mapping that is proposed."""
    if options.propose:
        proposal = opened(options.file).proposal
        for choice in proposal.choices:
            role = f"{choice.role}{f' [{choice.unit}]' if choice.unit else ''}" or "not used"
            note(f"{choice.column}: {role}{f' ({choice.reason})' if choice.reason else ''}")
        for question in proposal.undecided:
            note(f"Open: {question}")
        show(write_mapping(proposal.mapping).decode())
        return 0
    recording = chosen_recording(options)
    document = {
        "source": recording.source,
        "sha256": recording.sha256,
        **facts_of(recording),
        "vehicles": [asdict(vehicle) for vehicle in recording.vehicles],
        "warnings": messages(recording.findings, recording),
        "findings": msgspec.to_builtins(recording.findings),
    }
    show_result(options, lambda: document, lambda: _recording_text(recording))
    return 0


def _recording_text(recording: Recording) -> str:
    vehicles = recording.vehicles
    modes = [", ".join(f"{name} {n}" for name, n in (v.modes or {}).items()) for v in vehicles]
    table = Table.of(
        f"{recording.source}: {recording.campaign or 'campaign unknown'},"
        f" {recording.date or 'date unknown'}, {recording.duration:g} s in"
        f" {recording.samples} samples of {recording.sample_time:g} s",
        [
            (Column("Vehicle"), [recording.label(vehicle.index) for vehicle in vehicles]),
            (Column("Present"), ["yes" if vehicle.present else "no" for vehicle in vehicles]),
            (Column("Missing", "%", 0), [100 * vehicle.missing_share for vehicle in vehicles]),
            (Column("Driver mode"), [mode or "not recorded" for mode in modes]),
        ],
    )
    flag, setting = recording.acc_flag, recording.distance_setting
    lines = [f"ACC flag of the file: {FLAGS.get(flag, flag)}"] if flag is not None else []
    lines += [f"Distance setting: {setting}"] if setting else []
    lines += [f"Note: {warning}" for warning in messages(recording.findings, recording)]
    return "\n".join([table.to_text(), "", *lines]).rstrip()


def run_download(options: argparse.Namespace) -> int:
    """Download runs, and print the state of each; 1 when one failed, 130 when interrupted."""
    runs = find(options.names)
    folder = Path(options.to) if options.to else folder_of("recordings")
    if options.list:
        return _list_runs(runs, folder, options.json)
    from accpinn.recordings.download import DownloadState, download  # not needed to read a file

    with (
        interruptible() as stopped,
        tqdm(total=len(runs), unit="run", file=sys.stderr, disable=options.json or None) as bar,
    ):
        ended = []
        for run in download(runs, folder, options.base, should_stop=stopped.is_set):
            ended.append(run)
            bar.update()
        status = 130 if stopped.is_set() else 0
    failed = [run for run in ended if run.state is DownloadState.FAILED]
    if options.json:
        rows = [
            {**fields(run.run, "campaign", "file"), "path": str(run.path),
             "state": run.state.value, "size": run.size, "reason": run.reason or None}
            for run in ended
        ]  # fmt: skip
        print_json({"folder": str(folder), "runs": rows})
    else:
        counts = Counter(run.state.value for run in ended)
        show(f"{folder}: {', '.join(f'{n} {state}' for state, n in counts.items())}")
    if failed:
        others = f" ({len(failed) - 1} more failed)" if len(failed) > 1 else ""
        print_error(f"{failed[0].reason}{others}")
    return status or bool(failed)


def _list_runs(runs: tuple[Run, ...], folder: Path, as_json: bool) -> int:
    downloaded = [run.path(folder).is_file() for run in runs]
    if as_json:
        rows = [
            fields(run, "campaign", "file", "sha256") | {"downloaded": is_downloaded}
            for run, is_downloaded in zip(runs, downloaded, strict=True)
        ]
        print_json({"folder": str(folder), "runs": rows})
        return 0
    table = Table.of(
        f"{len(runs)} runs, {sum(downloaded)} of them in {folder}",
        [
            (Column("Campaign"), [run.campaign for run in runs]),
            (Column("File"), [run.file for run in runs]),
            (Column("Downloaded"), ["yes" if is_there else "no" for is_there in downloaded]),
        ],
    )
    show(table.to_text())
    return 0
