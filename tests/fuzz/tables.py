"""A right table of a simulated pair, changed as programs and people change tables.

A recipe says which drive and which changes, as JSON; the truth is known. Whatever the changes are,
a table is read right, or a finding contradicts it, or it is refused: nothing is misread in silence.
"""

import json
from collections.abc import Callable, Sequence
from random import Random
from typing import Any

import numpy as np
import pandas as pd

from accpinn.recordings import Recording
from accpinn.recordings.files import contradictions, opened
from accpinn.recordings.inconsistency import Inconsistency
from accpinn.recordings.sampling import TargetLost
from accpinn.units import GAP_UNITS, SPEED_UNITS
from tests.support.tables import STEADY, Truth, drive, misread

DRIVES: dict[str, dict[str, Any]] = {
    "motorway": {"swing": 2.5, "mean": 25.0},
    "rural": {"swing": 3.0, "mean": 17.0},
    "urban": {"swing": 2.5, "mean": 9.0},
    "steady": STEADY,
}
STYLES: dict[str, tuple[str, str, str, str]] = {
    "plain": ("t", "v1", "v2", "gap"),
    "roles": ("time", "lead_speed", "ego_speed", "gap"),
    "words": ("Time", "Leader speed", "Follower speed", "Clearance"),
    "german": ("Zeit", "v_Vorderfahrzeug", "v_Ego", "Abstand"),
    "ivs": ("Timestamp", "Speed_1", "Speed_2", "IVS_1"),
}
TIMES = (
    "s",
    "ms",
    "min",
    "unix",
    "unix ms",
    "iso",
    "clock",
    "hhmmss",
    "day first",
    "late",
    "night",
)
SEPARATORS = (",", ";", "\t", "|", " ")
DIRT = ("n/a", "-", "#N/A", "NULL", "abc", "", "1.2.3", "error")
LONGEST_SENTENCE = 300


def draw_table(draw: Random) -> bytes:
    """A recipe: a drive, a style of names, and one to three changes."""
    recipe: dict[str, Any] = {
        "drive": draw.choice([*DRIVES]),
        "seed": draw.randrange(4),
        "seconds": draw.choice((60, 90, 120)),
        "style": draw.choice([*STYLES]),
        "changes": [],
    }
    changes = {*draw.sample([*CHANGES], draw.choice((1, 1, 1, 2, 2, 3)))}
    if recipe["drive"] == "steady":  # where units leave no trace
        changes -= {"lie", "one speed"}
    if "lie" in changes:
        changes -= {"one speed", "unit"}
    if "clock" in changes:  # a shift is not seen in less
        recipe["seconds"] = 120
    for change in sorted(changes):
        recipe["changes"].append([change, *CHANGES[change](draw)])
    return json.dumps(recipe).encode()


def _unit(draw: Random) -> list[Any]:
    quantity = draw.choice(("speeds", "gap", "speeds and gap"))
    speed = draw.choice([*SPEED_UNITS]) if quantity != "gap" else "m/s"
    gap = draw.choice(("m", "ft", "cm")) if quantity != "speeds" else "m"
    place = draw.choice(("brackets", "suffix", "row", "nowhere"))
    if quantity == "speeds and gap" and place == "nowhere":
        place = "brackets"  # both scaled alike cannot be told from a faster drive
    return [speed, gap, place]


def _lie(draw: Random) -> list[Any]:
    return [draw.choice([*SPEED_UNITS][1:]), draw.choice(("brackets", "suffix", "row"))]


CHANGES: dict[str, Callable[[Random], list[Any]]] = {
    "unit": _unit,
    "lie": _lie,
    "one speed": lambda draw: [draw.choice(("lead", "ego")), draw.choice(("km/h", "mph", "ft/s"))],
    "swap": lambda draw: [],
    "sign": lambda draw: [],
    "clock": lambda draw: [draw.choice(("lead", "ego", "gap")), draw.choice((-2, -1, 0.6, 1.5))],
    "time": lambda draw: [draw.choice(TIMES)],
    "decimal comma": lambda draw: [],
    "separator": lambda draw: [draw.choice(SEPARATORS)],
    "rows lost": lambda draw: [draw.choice((0.01, 0.05, 0.2)), draw.randrange(1000)],
    "block lost": lambda draw: [draw.randrange(100, 400), draw.choice((5, 30, 100))],
    "rows doubled": lambda draw: [draw.randrange(20, 400), draw.choice((1, 20))],
    "rows shuffled": lambda draw: [draw.randrange(1000)],
    "column doubled": lambda draw: [draw.choice(("lead", "ego", "gap", "t")), draw.random() < 0.5],
    "same speeds": lambda draw: [],
    "gap is speed": lambda draw: [draw.choice(("lead", "ego"))],
    "header again": lambda draw: [draw.randrange(10, 500)],
    "comments": lambda draw: [draw.choice(("#", "%", "//"))],
    "metadata": lambda draw: [draw.randrange(1, 6)],
    "no header": lambda draw: [],
    "dirt": lambda draw: [draw.choice(DIRT), draw.randrange(1000), draw.choice((1, 3, 40))],
    "trailing separator": lambda draw: [],
    "index column": lambda draw: [],
    "further columns": lambda draw: [],
    "columns shuffled": lambda draw: [draw.randrange(1000)],
    "encoding": lambda draw: [draw.choice(("utf-8-sig", "utf-16", "latin-1"))],
    "line ends": lambda draw: [draw.choice(("\r\n", "\r", "\n\n"))],
    "quotes": lambda draw: [],
    "no target": lambda draw: [draw.choice((0.0, 255.0, 250.0, -1.0)), draw.randrange(100, 400)],
    "cut in": lambda draw: [draw.randrange(150, 400), draw.choice((-8.0, 12.0))],
    "rates": lambda draw: [],
    "rounded": lambda draw: [draw.choice((1, 2))],
}
"""How a table is changed, and what is drawn for it."""


def truth_of(recipe: dict[str, Any]) -> Truth:
    """The drive of a recipe."""
    return drive(recipe["seed"], recipe["seconds"], **DRIVES[recipe["drive"]])


def written(recipe: dict[str, Any]) -> bytes:
    """The table that a recipe makes."""
    truth = truth_of(recipe)
    changes = {name: values for name, *values in recipe["changes"]}
    columns: dict[str, Any] = {
        "t": truth.time, "lead": truth.lead, "ego": truth.ego, "gap": truth.gap,
    }  # fmt: skip
    names = dict(zip(columns, STYLES[recipe["style"]], strict=True))
    units = dict.fromkeys(columns, "")
    _change_values(columns, changes)
    _change_units(columns, names, units, changes)
    columns["t"] = _time(columns["t"], *changes.get("time", ["s"]))
    table = _table(columns, names, changes)
    return _file(table, [units.get(key, "") for key in table], changes)


def _change_values(columns: dict[str, Any], changes: dict[str, Any]) -> None:
    time = columns["t"]
    if "clock" in changes:
        channel, seconds = changes["clock"]
        columns[channel] = np.interp(time - seconds, time, columns[channel]).round(4)
    if "cut in" in changes:
        at, size = changes["cut in"]
        columns["gap"] = np.maximum(columns["gap"] + size * (np.arange(len(time)) > at), 0.5)
    if "same speeds" in changes:
        columns["ego"] = columns["lead"]
    if "gap is speed" in changes:
        columns["gap"] = columns[changes["gap is speed"][0]]
    if "swap" in changes:
        columns["lead"], columns["ego"] = columns["ego"], columns["lead"]
    if "no target" in changes:
        value, at = changes["no target"]
        columns["gap"] = np.where(np.abs(np.arange(len(time)) - at) < 40, value, columns["gap"])
    if "sign" in changes:
        columns["gap"] = -columns["gap"]


def _change_units(
    columns: dict[str, Any], names: dict[str, str], units: dict[str, str], changes: dict[str, Any]
) -> None:
    speed, gap, place = changes.get("unit", ["m/s", "m", "nowhere"])
    for key in ("lead", "ego"):
        columns[key] = columns[key] / SPEED_UNITS[speed]
    columns["gap"] = columns["gap"] / GAP_UNITS[gap]
    if "one speed" in changes:
        key, unit = changes["one speed"]
        columns[key] = columns[key] / SPEED_UNITS[unit]
    if "lie" in changes:
        speed, place = changes["lie"]
    units |= {"t": "", "lead": speed, "ego": speed, "gap": gap}
    for key in ("lead", "ego", "gap"):
        if place == "brackets":
            names[key] += f" [{units[key]}]"
        elif place == "suffix":
            names[key] += "_" + units[key].replace("/h", "h").replace("m/s", "mps").replace(
                "/", "p"
            )
    if place != "row":
        units.clear()
    for key in ("lead", "ego", "gap"):
        columns[key] = columns[key].round(changes.get("rounded", [4])[0])


def _time(time: Any, form: str) -> Any:
    """The time as a column has it."""
    moments = pd.Timestamp("2024-03-25 14:07:03.2") + pd.to_timedelta(time, unit="s")
    patterns = {
        "iso": "%Y-%m-%dT%H:%M:%S.%f", "clock": "%H:%M:%S.%f", "hhmmss": "%H%M%S.%f",
        "day first": "%d.%m.%Y %H:%M:%S.%f",
    }  # fmt: skip
    if form in patterns:
        return [moment.strftime(patterns[form])[:-3] for moment in moments]
    numbers = {
        "ms": time * 1000, "min": (time / 60).round(8), "unix": (1.7e9 + time).round(3),
        "unix ms": (1.7e12 + 1000 * time).round(), "late": (time + 58067.1).round(3),
        "night": ((time + 86370) % 86400).round(3),
    }  # fmt: skip
    return numbers.get(form, time)


def _table(
    columns: dict[str, Any], names: dict[str, str], changes: dict[str, Any]
) -> dict[str, tuple[str, list[str]]]:
    """Names and cells by what they are, in the order of the table."""
    cells = {
        key: (names[key], [v if isinstance(v, str) else f"{v:.15g}" for v in values])
        for key, values in columns.items()
    }
    count = len(cells["t"][1])
    if "rates" in changes:
        cells["gap"] = (
            names["gap"],
            [v if k % 2 == 0 else "" for k, v in enumerate(cells["gap"][1])],
        )
    if "dirt" in changes:
        word, seed, times = changes["dirt"]
        some = Random(seed)
        for _ in range(times):
            key = some.choice(("lead", "ego", "gap"))
            cells[key][1][some.randrange(20, count)] = word
    if "column doubled" in changes:
        key, is_named_alike = changes["column doubled"]
        name, values = cells[key]
        cells["copy"] = (name if is_named_alike else f"{name} copy", list(values))
    if "index column" in changes:
        cells = {"index": ("", [str(k) for k in range(count)]), **cells}
    if "further columns" in changes:
        cells["lat"] = ("lat", [f"{48 + 1e-6 * k:.7f}" for k in range(count)])
        cells["lon"] = ("lon", [f"{11 + 2e-6 * k:.7f}" for k in range(count)])
        cells["thw"] = ("thw", ["1.3"] * count)
        cells["accel"] = ("ego accel [m/s2]", [f"{np.sin(k / 9):.3f}" for k in range(count)])
    if "columns shuffled" in changes:
        keys = [*cells]
        Random(changes["columns shuffled"][0]).shuffle(keys)
        cells = {key: cells[key] for key in keys}
    return cells


def _file(
    table: dict[str, tuple[str, list[str]]], units: Sequence[str], changes: dict[str, Any]
) -> bytes:
    separator = changes.get("separator", [","])[0]
    is_comma = "decimal comma" in changes
    separator = ";" if is_comma and separator == "," else separator
    names = [name for name, _ in table.values()]
    if separator == " ":
        names = [name.replace(" ", "_") or "i" for name in names]
    rows = [list(row) for row in zip(*(cells for _, cells in table.values()), strict=True)]
    if separator == " ":
        rows = [[cell.replace(" ", "T") or "nan" for cell in row] for row in rows]
    if is_comma:
        rows = [[c.replace(".", ",") if c.count(".") == 1 else c for c in row] for row in rows]
    if "rows lost" in changes:
        share, seed = changes["rows lost"]
        some = Random(seed)
        rows = [row for k, row in enumerate(rows) if k < 5 or some.random() > share]
    if "block lost" in changes:
        at, length = changes["block lost"]
        del rows[at : at + length]
    if "rows doubled" in changes:
        at, length = changes["rows doubled"]
        rows[at:at] = rows[at : at + length]
    if "rows shuffled" in changes:
        Random(changes["rows shuffled"][0]).shuffle(rows)
    quote = '"{}"' if "quotes" in changes else "{}"
    end = separator if "trailing separator" in changes and separator != " " else ""

    def line(cells: Sequence[str]) -> str:
        return separator.join(quote.format(cell) for cell in cells) + end

    lines = [] if "no header" in changes else [line(names)]
    if any(units) and lines:
        shown = [
            unit or "s" if key == "t" else unit for key, unit in zip(table, units, strict=True)
        ]
        lines.append(line(shown))
    body = [line(row) for row in rows]
    if "header again" in changes and lines:
        body.insert(changes["header again"][0], lines[0])
    if "comments" in changes:
        body.insert(30, f"{changes['comments'][0]} a note")
        lines.insert(0, f"{changes['comments'][0]} made by a program")
    if "metadata" in changes:
        lines = [line([f"key{k}", "value"]) for k in range(changes["metadata"][0])] + lines
    text = changes.get("line ends", ["\n"])[0].join([*lines, *body, ""])
    return text.encode(changes.get("encoding", ["utf-8"])[0], "replace")


def use_table(content: bytes, _: object = None) -> bool:
    """Read the table; whether its numbers are right and nothing contradicts them."""
    recipe = json.loads(content)
    recording = opened(written(recipe), "t.csv").read()
    for finding in recording.findings:
        assert len(finding.sentence(recording)) <= LONGEST_SENTENCE
    wrong = misread(recording, truth_of(recipe))
    assert not wrong or is_told(recording), f"misread in silence ({wrong}): {recipe}"
    return not wrong


def is_told(recording: Recording) -> bool:
    """Whether a finding says that something is wrong with speeds or gap."""
    return bool(contradictions(recording)) or any(
        isinstance(finding, Inconsistency | TargetLost) for finding in recording.findings
    )
