"""One answer: Python, command line, snapshot, verification, parameter card and pages agree."""

from pathlib import Path

import pandas as pd
import pytest
from pyarrow import parquet

import accpinn
from accpinn.model.registry import FOLLOWING
from accpinn.results.tables.answer import answer_table
from accpinn.study.rows import OF_ANSWER
from accpinn.study.snapshot import load
from tests.support.command import STUDY, Capture, document

WINDOW = ("--start", 10, "--duration", 60)


def test_every_place_gives_the_same_answer_to_six_digits(capsys: Capture, tmp_path: Path) -> None:
    result = accpinn.fit(STUDY, start=10, duration=60)
    expected = {name: result.answer.span(name, 0).value for name in result.answer.names}
    fast = accpinn.fit(STUDY, start=10, duration=60, preset="fast")
    path = tmp_path / "a.accpinn.zip"
    fitted = document(capsys, "fit", STUDY, *WINDOW, "--method", "splines", "--out", path)
    compared = document(capsys, "compare", STUDY, *WINDOW, "--methods", "least-squares,splines")
    vehicle = document(capsys, "stability", path)["vehicles"][0]
    places = {
        "fit by another method": fitted["answer"][0]["parameters"],
        "compare": compared["answer"][0]["parameters"],
        "stability of the snapshot": {name: vehicle[name] for name in expected},
        "snapshot": {n: float(getattr(load(path).answer.parameters, n)[0]) for n in expected},
        "card": accpinn.parameter_card(load(path))["answer"][0]["parameters"],
        "preset fast": {name: fast.answer.span(name, 0).value for name in expected},
    }
    for place, found in places.items():
        assert found == pytest.approx(expected, rel=1e-6), place
    gap = result.answer.time_gap(100 / 3.6, 0)
    assert gap.value == pytest.approx(expected["tau"] + expected["s0"] / (100 / 3.6))
    assert gap.lower < gap.value < gap.upper
    assert gap.further_lower < gap.lower < gap.upper < gap.further_upper
    assert f"{gap.value:.2f}" in answer_table(result.info, result.answer).to_text()


def test_the_table_of_a_database_gives_it_too(
    capsys: Capture, tmp_path: Path, cluster: str
) -> None:
    model, out = "idm", tmp_path / "study"
    methods = ("--methods", "least-squares", "--scheduler", cluster, "--model", model)
    document(capsys, "batch", STUDY, "--out", out, "--window", 100, *methods)
    (group,) = document(capsys, "table", out)["groups"]
    windows = ("--windows", "all", "--duration", 100, "--model", model)
    (fitted,) = document(capsys, "fit", STUDY, *windows)["answer"]
    assert group["windows"] == fitted["windows"] == 3
    for name in ("parameters", "intervals", "further_window", "time_gap_intervals"):
        for key, value in group[name].items():
            assert value == pytest.approx(fitted[name][key], rel=1e-6), (name, key)
    names = FOLLOWING[model].names
    assert tuple(group["parameters"]) == names
    spread = group["between_windows"]
    assert len(spread) == len(names)
    assert all(0.0 < part["low"] < part["value"] < part["high"] for part in spread.values())
    rows = pd.read_parquet(out / "results.parquet")
    assert set(rows["answer_model"]) == {model}
    windows = {name for name in OF_ANSWER if rows[f"answer_{name}"].notna().all()}
    assert windows == set(names)
    fields = parquet.read_schema(out / "results.parquet")
    for parameter in FOLLOWING[model].parameters:
        unit = fields.field(f"answer_{parameter.name}").metadata[b"unit"].decode()
        assert unit == parameter.unit


def test_several_windows_and_held_terms(capsys: Capture) -> None:
    windows = ("--windows", "0-60,100-160")
    found = document(capsys, "fit", STUDY, *windows, "--model", "cthp-s0", "--hold", "s0=0")
    (row,) = found["answer"]
    assert (row["model"], row["windows"]) == ("cthp-s0", 2)
    assert row["parameters"]["s0"] == 0.0
    assert row["intervals"]["s0"] == [0.0, 0.0]
    paper = document(capsys, "fit", STUDY, *windows, "--model", "cthp")["answer"][0]["parameters"]
    assert set(paper) == {"alpha", "beta", "tau"}
    assert paper["tau"] == pytest.approx(row["parameters"]["tau"], rel=0.1)
