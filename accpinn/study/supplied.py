"""The study that comes with the program: the cars of the published recordings that were at hand.

    python -m accpinn.study.supplied RECORDINGS .. sample_data/openacc_study

computes it again: a batch by the recommended method, of which the figures are kept. They are rows
of parameters, intervals and counts, and `KEPT` draws of each posterior, from which groups are made;
no recorded series is among them. It is read as any other study.
"""

import json
import sqlite3
import sys
from collections.abc import Sequence
from contextlib import closing
from dataclasses import asdict, dataclass
from datetime import UTC, datetime
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from accpinn import __version__
from accpinn.errors import AccpinnError
from accpinn.inference.coordinates import coordinates_of
from accpinn.methods.registry import recommended_method
from accpinn.storage import shipped, write_whole
from accpinn.study.batch import batch
from accpinn.study.studies import FILE, read_request

FOLDER, ABOUT = "openacc_study", "about.json"
"""Its place in the folder of samples, and the file there that says how it was made."""
KEPT = 100
"""Draws of each posterior. An end of a group's interval moves by a twentieth of its width, as it
does from one sampling to the next."""
SOURCE = "OpenACC"
"""Stands for the places of the recordings on the machine where it was computed."""
PAGE_BYTES = 1024
"""Size of a page of the SQLite file; larger ones leave much room empty."""


@dataclass(frozen=True)
class About:
    """Origin of a supplied study."""

    date: str
    """Day of its computation, as 2026-11-29."""
    version: str
    """Version of the program that computed it."""
    draws: int
    """Draws of each posterior that were kept."""


def supplied_study() -> Path | None:
    """The folder of the study; None where it is not installed."""
    folder = shipped("sample_data") / FOLDER
    return folder if (folder / FILE).is_file() else None


def read_about(folder: Path) -> About:
    """Origin of the study in a folder."""
    return About(**json.loads((folder / ABOUT).read_text(encoding="utf-8")))


def keep_figures(study: Path, folder: Path) -> None:
    """Write a study's figures to a folder, in the form of a study.

    What a batch would go on by is left out: the windows of files, and where these lie.

    Raises:
        StudyError: where there is no study.
    """
    request = read_request(study)
    assert request is not None  # a batch keeps it first
    width = coordinates_of(request.model).count
    folder.mkdir(parents=True, exist_ok=True)
    with closing(sqlite3.connect(":memory:")) as database:
        database.execute(f"pragma page_size = {PAGE_BYTES}")
        with closing(sqlite3.connect(study / FILE)) as source:
            database.executescript("\n".join(source.iterdump()))
            (version,) = source.execute("pragma user_version").fetchone()
        database.execute(f"pragma user_version = {version}")
        database.execute("delete from files")
        database.execute("update refused set path = file")
        database.execute(
            "update request set document = json_set(document, '$.sources', json(?),"
            " '$.workers', null)",
            (json.dumps([SOURCE]),),
        )
        for place, rows in database.execute("select rowid, rows from answers").fetchall():
            present = [{k: v for k, v in row.items() if v is not None} for row in json.loads(rows)]
            text = json.dumps(present, ensure_ascii=False, separators=(",", ":"))
            database.execute("update answers set rows = ? where rowid = ?", (text, place))
        for place, raw in database.execute("select rowid, draws from posteriors").fetchall():
            every = np.frombuffer(raw, "<f8").reshape(-1, width)
            some = every[np.linspace(0, len(every) - 1, min(len(every), KEPT)).astype(int)]
            # Of three digits, far fewer than their spread is known to, the file packs well.
            short = some.astype(np.float16).astype("<f8").tobytes()
            database.execute("update posteriors set draws = ? where rowid = ?", (short, place))
        database.commit()
        database.execute("vacuum")
        write_whole(folder / FILE, database.serialize())
    about = About(datetime.now(UTC).date().isoformat(), __version__, KEPT)
    write_whole(folder / ABOUT, (json.dumps(asdict(about), indent=2) + "\n").encode())


def main(arguments: Sequence[str]) -> int:
    """Compute the study from recordings, and keep its figures in the folder named last."""
    if len(arguments) < 2:
        print(f"usage: python -m {__spec__.name} RECORDINGS .. FOLDER", file=sys.stderr)
        return 2
    *sources, folder = arguments
    try:
        with TemporaryDirectory() as temporary:
            study = Path(temporary) / "study"
            done = batch(sources, study, methods=(recommended_method(),), workers=1)
            keep_figures(study, Path(folder))
    except AccpinnError as fault:
        print(f"error: {fault}", file=sys.stderr)
        return 1
    print(f"{folder}: {done.rows} rows of {done.windows} windows in {done.recordings} recordings.")
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
