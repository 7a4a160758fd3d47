"""Folders of tables that can be published, with what they were made with."""

import html
import json
from pathlib import Path
from typing import TYPE_CHECKING, Any

import msgspec

from accpinn.errors import RecordingError
from accpinn.model.registry import fingerprint
from accpinn.results.database import guarded
from accpinn.results.documents import judgement_document
from accpinn.results.tables import STYLE, Table
from accpinn.results.tables.models import models_table, pairs_table
from accpinn.storage import reported, write_whole
from accpinn.study.judge import candidate
from accpinn.study.judging import Judgements

if TYPE_CHECKING:
    from pandas import DataFrame

MADE = "made_with.json"
FORMATS = {
    "text": Table.to_text, "csv": Table.to_csv, "markdown": Table.to_markdown,
    "latex": Table.to_latex, "html": Table.to_html,
}  # fmt: skip
"""How a table is written, by the format's name."""
ENDINGS = {"csv": "csv", "markdown": "md", "latex": "tex", "html": "html"}
PROTOCOL = (
    "Each follower is by itself behind the measured vehicle ahead. Of its windows in car-following"
    " under ACC one is left out; the model is fitted to the others of the same recording together"
    " by closed-loop simulation (a method estimates its usual model from them) and drives in the"
    " one left out from its first measured state on, with only the speed ahead given. Errors are"
    " of the space-gap. |H| is that of the fit to all windows, beside Welch's estimate."
)
"""How models are judged, for whoever reads the tables."""


def made_document(judgements: Judgements) -> dict[str, Any]:
    """What judgements were made with: program, date, command, models, recordings and windows."""
    made, recordings = judgements.made, dict[str, dict[str, Any]]()
    for car in judgements.cars:
        facts = judgements.facts.get(car.info.sha256, {})
        entry = recordings.setdefault(
            car.info.sha256,
            {
                "file": car.info.source,
                "sha256": car.info.sha256,
                "campaign": facts.get("campaign"),
                "date": facts.get("date"),
                "distance_setting": facts.get("distance_setting"),
                "followers": [],
            },
        )
        entry["followers"].append(
            {
                "vehicle": car.info.vehicles[1],
                "name": car.info.names[1],
                "windows": [[window.start, window.end] for window in car.windows],
            }
        )
    return {
        "created": made.created,
        "command": made.command or None,
        "protocol": PROTOCOL,
        "origin": msgspec.to_builtins(made.origin),
        "scripts": [{"name": name, "sha256": digest} for name, digest in made.scripts.items()],
        "models": [
            {
                "key": key,
                "title": candidate(key).title,
                "formula": candidate(key).model.formula or None,
                "fingerprint": fingerprint(candidate(key).model.key) or None,
            }
            for key in judgements.keys
        ],
        "recordings": list(recordings.values()),
        "is_whole": judgements.is_whole,
    }


def judgements_document(judgements: Judgements, reference: str | None = None) -> dict[str, Any]:
    """The models over all vehicles and in pairs, each follower, what failed and how it was made."""
    return {
        "reference": reference or next(iter(judgements.keys), None),
        "vehicles": len(judgements.vehicles),
        "windows": judgements.windows,
        "models": [
            {**msgspec.to_builtins(row), "title": candidate(row.key).title}
            for row in judgements.summary(reference)
        ],
        "pairs": [
            {"model": key, "other": other, "difference": mean, "error": error, "is_clear": clear}
            for k, key in enumerate(judgements.keys)
            for other in judgements.keys[:k]
            for mean, error, clear in [judgements.difference(key, other)]
        ],
        "followers": [
            {"file": car.info.source, **judgement_document(car)} for car in judgements.cars
        ],
        "failures": [failure._asdict() for failure in judgements.failures],
        "made_with": made_document(judgements),
    }


def write_judgements(
    judgements: Judgements, folder: Path, reference: str | None = None
) -> tuple[str, ...]:
    """Write the tables of models and pairs in every format, each follower and window, and `MADE`.

    Returns the names of the files.

    Raises:
        RecordingError: where the folder cannot be written.
    """
    tables = {"models": models_table(judgements, reference), "pairs": pairs_table(judgements)}
    files = {
        f"{name}.{ending}": written_table(table, form)
        for name, table in tables.items()
        for form, ending in ENDINGS.items()
    }
    followers = judgements.to_frame()
    followers["parameters"] = followers["parameters"].map(json.dumps)
    files["followers.csv"] = csv_text(followers)
    files["windows.csv"] = csv_text(judgements.to_frame("windows"))
    files[MADE] = json.dumps(made_document(judgements), ensure_ascii=False, indent=2) + "\n"
    write_folder(folder, {name: text.encode() for name, text in files.items()})
    return tuple(files)


def write_folder(folder: Path, files: dict[str, bytes]) -> None:
    """Write files to a folder, which is made where there is none; each in one step.

    Raises:
        RecordingError: where it cannot be written.
    """
    with reported(lambda reason: RecordingError(f"{folder}: it cannot be written ({reason}).")):
        folder.mkdir(parents=True, exist_ok=True)
        for name, content in files.items():
            write_whole(folder / name, content)


def written_table(table: Table, form: str) -> str:
    """A table as a file of one of `FORMATS`."""
    text = FORMATS[form](table)
    if form == "html":
        title = html.escape(table.caption)
        return f'<!doctype html>\n<meta charset="utf-8">\n<title>{title}</title>\n{STYLE}\n{text}\n'
    return text if text.endswith("\n") else f"{text}\n"


def csv_text(frame: "DataFrame") -> str:
    """A frame as CSV in which no text is a formula."""
    return str(guarded(frame).to_csv(index=False, lineterminator="\n"))
