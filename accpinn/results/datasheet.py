"""A data set of parameters as files: tables, SUMO types, and the sheet that says what they are."""

import io
import json
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from accpinn import __version__
from accpinn.model.cthp import Parameters
from accpinn.model.registry import BEST, FOLLOWING, IDM
from accpinn.recordings.openacc import catalogue
from accpinn.results.database import OPENACC, label_of
from accpinn.results.export import sumo_types
from accpinn.results.publication import MADE, csv_text, made_document, write_folder
from accpinn.results.tables import Column, Table, markdown
from accpinn.storage import packaged_rows
from accpinn.study.dataset import Dataset
from accpinn.study.groups import BY, Groups
from accpinn.study.rows import COLUMNS

if TYPE_CHECKING:
    from pandas import DataFrame

SHEET = "README.md"
LICENCE = "https://creativecommons.org/licenses/by/4.0/"
UNKNOWN_LICENCE = (
    "{count} of the recordings are none of the published runs of OpenACC ({named}): whose they are,"
    " and under which licence, has to be stated here before this data set is passed on."
)
MOST_NAMED = 5
ENDS = {
    "_low": "lower end of the interval of {name}",
    "_high": "upper end of the interval of {name}",
}


@dataclass(frozen=True)
class Described:
    """A column of the table of parameters."""

    name: str
    unit: str
    meaning: str


def columns_of(frame: "DataFrame") -> tuple[Described, ...]:
    """What each column of the table of parameters is, in its order."""
    known = {column.name: column for column in _known()}
    described = []
    for name in frame.columns:
        if name in known:
            described.append(known[name])
            continue
        end = next(end for end in ENDS if name.endswith(end))
        bare = known[name.removesuffix(end)]
        described.append(Described(name, bare.unit, ENDS[end].format(name=bare.name)))
    return tuple(described)


def _known() -> Iterator[Described]:
    """The columns but for the ends of intervals; a parameter that two models have stands once."""
    parameters: dict[str, dict[str, str]] = {}
    for following in FOLLOWING.values():
        for p in following.parameters:
            entry = {"name": p.name, "unit": p.unit, "symbol": p.symbol, "title": ""}
            entry = parameters.setdefault(p.name, entry)
            title = following.title.split(" with ")[0].split(" behind ")[0]
            if title not in entry["title"].split(", "):
                entry["title"] = ", ".join(filter(None, (entry["title"], title)))
    for cells in packaged_rows("results", "dataset.csv"):
        for entry in parameters.values() if "{name}" in cells["name"] else [{}]:
            yield Described(**{key: cell.format(**entry) for key, cell in cells.items()})


def write_dataset(dataset: Dataset, folder: Path) -> tuple[str, ...]:
    """Write a data set to its folder; returns the names of the files.

    Raises:
        RecordingError: where it cannot be written.
    """
    table, made = dataset.to_frame(), made_document(dataset.judgements)
    described = columns_of(table)
    meanings = {part.name: (part.unit, part.meaning) for part in described}
    of_rows = {column.name: (column.unit, column.meaning) for column in COLUMNS}
    files = {
        "parameters.csv": csv_text(table).encode(),
        "parameters.parquet": parquet(table, meanings),
        "windows.csv": csv_text(dataset.rows).encode(),
        "windows.parquet": parquet(dataset.rows, of_rows),
        "held_out.csv": csv_text(dataset.judgements.to_frame("windows")).encode(),
        "recordings.csv": csv_text(_recordings(dataset)).encode(),
        "failures.csv": csv_text(_failures(dataset)).encode(),
        **{
            f"sumo_{model}.add.xml": types_of(grouped).encode()
            for model, grouped in dataset.groups.items()
        },
        MADE: (json.dumps(made, ensure_ascii=False, indent=2) + "\n").encode(),
        SHEET: data_sheet(dataset, described).encode(),
    }
    write_folder(folder, files)
    return tuple(files)


def parquet(frame: "DataFrame", meanings: dict[str, tuple[str, str]]) -> bytes:
    """A frame as Parquet, with unit and meaning in the description of each column."""
    import pyarrow as pa  # takes a third of a second
    from pyarrow import parquet

    table = pa.Table.from_pandas(frame, preserve_index=False)
    fields = [
        field.with_metadata(dict(zip(("unit", "meaning"), meanings[field.name], strict=True)))
        for field in table.schema
    ]
    file = io.BytesIO()
    parquet.write_table(table.cast(pa.schema(fields)), file)
    return file.getvalue()


def types_of(grouped: Groups) -> str:
    """The typical parameters of each group as vehicle types of SUMO."""
    known = [g for g in grouped.groups if np.isfinite(g.typical.complete).all()]
    names = tuple(label_of(group.values).replace(" · ", " ") for group in known)
    speeds = np.array([group.median_speed for group in known])
    if not known:
        return "<additional />\n"
    sets = Parameters.of(np.stack([group.typical.everything for group in known]))
    return sumo_types(names, sets, None, speeds, grouped.model)


def _recordings(dataset: Dataset) -> "DataFrame":
    from pandas import DataFrame

    used = dataset.rows.groupby("sha256")["start"].nunique()
    return DataFrame(
        {
            "campaign": facts.get("campaign"),
            "file": file,
            "sha256": digest,
            "date": facts.get("date"),
            "distance_setting": facts.get("distance_setting"),
            "duration": facts.get("duration"),
            "windows": int(used.get(digest, 0)),
            "is_openacc": _is_published(facts.get("campaign"), file),
        }
        for facts, file, digest in dataset.recordings
    )


def _failures(dataset: Dataset) -> "DataFrame":
    from pandas import DataFrame

    every = (*dataset.failures, *dataset.judgements.failures)
    return DataFrame([failure._asdict() for failure in dict.fromkeys(every)])


def _is_published(campaign: Any, file: str) -> bool:
    return any(file == run.file and campaign == run.campaign for run in catalogue())


def overview(dataset: Dataset) -> Table:
    """One row a group: the recommended model's figures beside what was measured."""
    grouped, frame = dataset.groups[BEST], dataset.to_frame()
    error = "held_out_gap_rmse"
    by_model = {model: rows.set_index(list(BY)) for model, rows in frame.groupby("following_model")}
    others = by_model[IDM.key][error].to_dict()
    rows = [
        (label_of(key), float(row.windows), row.time_gap_at_100_kmh_s, row.margin_l2, row[error],
         others.get(key), row.measured_peak)
        for key, row in by_model[BEST].iterrows()
        if isinstance(key, tuple)
    ]  # fmt: skip
    columns = (
        Column("Car and setting"), Column("Windows", digits=0),
        Column("Time gap at 100 km/h", "s", 2), Column("Margin L₂", "s", 2),
        Column("Held out", "m", 2), Column("Held out, IDM", "m", 2),
        Column("Measured peak", "dB", 1),
    )  # fmt: skip
    cells = zip(*rows, strict=True) if rows else [[]] * len(columns)
    return Table.of(
        f"Typical value by {FOLLOWING[grouped.model].title}; errors in windows left out",
        zip(columns, cells, strict=True),
    )


def data_sheet(dataset: Dataset, described: tuple[Described, ...]) -> str:
    """What the data set is, how it was made, its columns, licence, citation and limits."""
    made = dataset.judgements.made
    table = dataset.groups[BEST]
    used = {digest for digest in dataset.rows["sha256"]}
    count = sum(digest in used for _, _, digest in dataset.recordings)
    foreign = [
        file
        for facts, file, digest in dataset.recordings
        if digest in used and not _is_published(facts.get("campaign"), file)
    ]
    windows = len(dataset.rows[["sha256", "start"]].drop_duplicates())
    models = ", ".join(f"{FOLLOWING[model].title} (`{model}`)" for model in dataset.groups)
    columns = Table.of(
        "",
        [
            (Column("Column"), [part.name for part in described if not _is_end(part.name)]),
            (Column("Unit"), [part.unit for part in described if not _is_end(part.name)]),
            (Column("Meaning"), [part.meaning for part in described if not _is_end(part.name)]),
        ],
    )
    licence = []
    if len(foreign) < count:
        licence.append(f"Recordings: {OPENACC}")
        licence.append(
            f"So this data set may be shared and adapted under CC BY 4.0 ({LICENCE}), if OpenACC is"
            " named as above and changes are indicated."
        )
    if foreign:
        named = ", ".join(foreign[:MOST_NAMED]) + (", .." if len(foreign) > MOST_NAMED else "")
        licence.append(markdown(UNKNOWN_LICENCE.format(count=len(foreign), named=named)))
    sections = {
        "What it is": f"Parameters of adaptive cruise control by make, model and distance setting:"
        f" {len(table.groups)} groups from {windows} windows of {count} recordings, by the models"
        f" {models}, with {100 * table.level:g} % intervals, margins to string stability, errors in"
        " windows left out, and the measured gain.",
        "Overview": overview(dataset).to_markdown(),
        "How it was made": f"By accpinn {__version__} on {made.created[:10]}:\n\n"
        f"    {made.command or 'accpinn dataset'}\n\n"
        "Of each recording the windows are the complete stretches in car-following under ACC, 60"
        " to 300 s long, in which the gap fits the speeds. Each is estimated by the model's"
        " recommended method, and its posterior goes into the interval of the typical value of its"
        " vehicle and of its group; how windows and vehicles differ is estimated, too. The"
        " parameters themselves are those that all windows of a group support together (`point`),"
        " one consistent set. Held-out errors are of the"
        " same method: it estimates from all windows of a recording but one, at most 150 s long,"
        " and drives in that one in closed loop from its first state on, with only the speed ahead"
        " given. The measured gain is Welch's estimate over all drives of a group and rests on no"
        f" model. `{MADE}` has versions, models, and each recording's SHA-256 and windows; the same"
        " command makes the same table.",
        "Files": "\n".join(
            f"- `{name}`: {meaning}"
            for name, meaning in (
                ("parameters.csv, .parquet", "one row a group and model, the columns below"),
                ("windows.csv, .parquet", "one row a window, follower and model; the columns are"
                 " described in the Parquet file"),
                ("held_out.csv", "one row a window left out and model"),
                ("recordings.csv", "the recordings with their SHA-256"),
                ("failures.csv", "what has no result, and why"),
                ("sumo_MODEL.add.xml", "vehicle types of the traffic simulator SUMO"),
                (MADE, "how it was made"),
            )
        ),
        "Columns of parameters.csv": "The interval of a value stands in the columns that end in"
        " `_low` and `_high`.\n\n" + columns.to_markdown(),
        "Licence": "\n\n".join(licence),
        "How to cite": "Name the recordings as above, this program (accpinn"
        f" {__version__}, its CITATION.cff), and for the method T. Apostolakis and K. Ampountolas,"
        " Physics-inspired neural networks for parameter learning of adaptive cruise control"
        " systems, IEEE Transactions on Vehicular Technology, 2024.",
        "Limits": "The numbers hold for cars in car-following under ACC at the speeds that were"
        " driven; a time gap outside of these is extrapolated and marked. τ and s₀ trade off"
        " against each other and are used together or not at all. A group of one vehicle does not"
        " say how vehicles of that model differ. Windows of one drive share road, day and weather."
        " Margins and stability are the model's and hold for small disturbances; where the measured"
        " peak is above the model's, the car amplifies more.",
    }  # fmt: skip
    parts = [f"## {title}\n\n{text.strip()}" for title, text in sections.items()]
    return "\n\n".join(["# Parameters of adaptive cruise control", *parts]) + "\n"


def _is_end(name: str) -> bool:
    return name.endswith(tuple(ENDS))
