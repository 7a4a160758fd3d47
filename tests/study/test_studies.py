"""The file of a study and groups of its rows: nothing lost, the truth recovered."""

import csv
import os
import sqlite3
from contextlib import closing
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.stats import beta, binom

from accpinn.cli import main
from accpinn.errors import ConfigError, RecordingError
from accpinn.inference.coordinates import AT_SPEED
from accpinn.inference.typical import car_of
from accpinn.model.registry import BEST
from accpinn.model.spec import ModelSpec
from accpinn.results.database import group_table, guarded
from accpinn.results.marks import EXTRAPOLATED
from accpinn.study.groups import POSTERIOR, group, read_study, share
from accpinn.study.studies import (
    FAILURES,
    FILE,
    RESULTS,
    Computed,
    Failure,
    KnownFile,
    read_failures,
    read_posteriors,
    read_request,
    read_rows,
    state_of,
    studies,
    study_path,
    written,
)
from tests.support.command import Capture, document, refused
from tests.support.studies import REQUEST, S0, analysis, row, rows, write_study


def test_results_can_be_read_while_a_batch_runs_and_a_newer_one_takes_their_place(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with written(tmp_path, REQUEST) as study:
        states = [state_of(tmp_path)]
        study.add("a.csv", Computed(analysis(), [row("A", alpha=0.3)]))
        states.append(state_of(tmp_path))
        study.add("a.csv", Computed(analysis(60.0), reason="broken"))
        study.add("a.csv", Computed(analysis(120.0), reason="a worker died", is_final=False))
        [kept] = read_rows(tmp_path)
        assert (kept["alpha"], kept["make"], kept["file"]) == (0.3, "A", None)
        failure = Failure("a.csv", 60.0, 2, "least-squares: broken")
        assert read_failures(tmp_path)[0] == failure
        known = [study.rows_of(analysis(start)) for start in (0.0, 60.0, 120.0, 180.0)]
        assert known == [1, 0, None, None]
        for start in (60.0, 120.0):
            study.add("a.csv", Computed(analysis(start), [row("A")]))
        assert study.rows_of(analysis(60.0)) == 1
        assert read_failures(tmp_path) == ()
        assert len({*states, state_of(tmp_path)}) == 3
        with pytest.raises(RecordingError, match="another batch is writing"):
            written(tmp_path, REQUEST).__enter__()
        later_version = analysis()
        monkeypatch.setitem(vars(later_version), "key", "another")
        assert study.rows_of(later_version) is None
        study.add("a.csv", Computed(later_version, [row("B")]))
    assert [cells["make"] for cells in read_rows(tmp_path)] == ["B", "A", "A"]
    assert [path.name for path in tmp_path.glob(f"{FILE}*")] == [FILE], "one plain file is left"


def test_names_and_reasons_are_no_formulas_in_files_that_leave(tmp_path: Path) -> None:
    with written(tmp_path, REQUEST) as study:
        study.refuse(Path("=cmd|'calc'!A0.csv"), ["@SUM(A1)"])
        study.add("a.csv", Computed(analysis(), [row("=1+1")]))
    with (tmp_path / FAILURES).open(newline="") as file:
        assert [*csv.reader(file)][1] == ["'=cmd|'calc'!A0.csv", "", "", "'@SUM(A1)"]
    saved = guarded(read_study(tmp_path))
    assert saved["make"].tolist() == ["'=1+1"]
    assert saved["alpha"].tolist() == read_study(tmp_path)["alpha"].tolist()


def test_rows_have_one_order_whatever_ended_first(tmp_path: Path) -> None:
    places = [(start, file, method) for file in ("a", "b") for start in (0.0, 60.0, 300.0)
              for method in ("least-squares", "splines")]  # fmt: skip
    contents: list[Any] = []
    for seed in (0, 1):
        folder = tmp_path / str(seed)
        with written(folder, REQUEST) as study:
            for k in np.random.default_rng(seed).permutation(len(places)).tolist():
                start, file, method = places[k]
                cells = row("A", file=file, start=start, method=method)
                study.add(file, Computed(analysis(*places[k]), [cells]))
                study.add(file, Computed(analysis(start + 30, file, method), reason="broken"))
        contents.append([(folder / name).read_bytes() for name in (FAILURES, RESULTS)])
        order = [(cells["start"], cells["file"], cells["method"]) for cells in read_rows(folder)]
        assert order == places
    assert contents[0] == contents[1]


def test_what_a_file_holds_and_what_was_asked_last_are_found_again(tmp_path: Path) -> None:
    known, finished = KnownFile(None, 1, 1, (analysis(),)), replace(REQUEST, is_finished=True)
    with written(tmp_path, REQUEST) as study:
        assert read_request(tmp_path) == REQUEST
        study.refuse(Path("runs/x.csv"), ["broken", "broken, too"])
        study.refuse(Path("runs/y.csv"), ["broken"])
        study.refuse(Path("runs/x.csv"), ["no window"])
        study.add_file("bytes", known)
        assert (study.known_file("bytes"), study.known_file("others")) == (known, None)
        study.note(finished)
    failures = [(failure.file, failure.reason) for failure in read_failures(tmp_path)]
    assert failures == [("x.csv", "no window"), ("y.csv", "broken")]
    assert read_request(tmp_path) == finished
    for changes in ({"case": "I"}, {"window": 60.0}, {"model": "idm"}):
        with pytest.raises(ConfigError, match="holds a batch with window 300, Case II"):
            written(tmp_path, replace(REQUEST, **changes)).__enter__()


def test_groups_are_of_the_draws_of_their_model_by_its_recommended_method(tmp_path: Path) -> None:
    """Whichever came last: other methods have draws of the same windows, and of other models."""
    asked = {name: analysis(method=name) for name in ("pinn", "simulation")}
    of_idm = replace(asked["simulation"], spec=ModelSpec("idm"))
    drawn = {"pinn": 1.0, "simulation": 2.0}
    for order in (("pinn", "simulation"), ("simulation", "pinn")):
        with written(tmp_path / order[0], REQUEST) as study:
            for name in order:
                draws = np.full((1, 4, 5), drawn[name])
                study.add("a.csv", Computed(asked[name], [row("A", method=name)], draws))
        (found,) = read_posteriors(tmp_path / order[0], BEST).values()
        np.testing.assert_array_equal(found, np.full((4, 5), 1.0))
        assert read_posteriors(tmp_path / order[0], "idm") == {}
    with written(tmp_path / "idm", replace(REQUEST, model="idm")) as study:
        study.add("a.csv", Computed(asked["pinn"], [row("A")], np.full((1, 4, 5), 1.0)))
        study.add("a.csv", Computed(of_idm, [row("A")], np.full((1, 4, 5), 2.0)))
    (found,) = read_posteriors(tmp_path / "idm", "idm").values()
    np.testing.assert_array_equal(found, np.full((4, 5), 2.0))


def spoilt(folder: Path, statement: str) -> Path:
    write_study(folder, row("A"))
    with closing(sqlite3.connect(folder / FILE)) as database, database:
        database.execute(statement)
    return folder


def test_what_is_no_study_ends_in_one_sentence(tmp_path: Path) -> None:
    with pytest.raises(RecordingError, match="no batch is there"):
        read_study(tmp_path)
    for k, statement in enumerate(
        (
            "drop table answers",
            "update answers set rows = 'no JSON'",
            "update answers set rows = '[{\"alpha\": 1e300}]'",
            "update answers set rows = x'ff'",
            "update answers set rows = 1.5",
        )
    ):
        folder = spoilt(tmp_path / str(k), statement)
        with pytest.raises(RecordingError, match=r"is damaged; take another folder"):
            read_study(folder)
    torn = write_study(tmp_path / "torn", row("A"))
    (torn / FILE).write_bytes((torn / FILE).read_bytes()[:5000])
    with pytest.raises(RecordingError, match="is damaged"):
        read_study(torn)
    later = spoilt(tmp_path / "later", "pragma user_version = 99")
    for use in (read_study, lambda folder: written(folder, REQUEST).__enter__()):
        with pytest.raises(RecordingError, match="another version of accpinn"):
            use(later)


@pytest.mark.parametrize(
    "name", ["", ".", "..", "../x", "a/b", "/etc", "a\\b", ".hidden", "x ", "x" * 61, "a\n", "out"]
)
def test_what_leads_out_of_the_folder_is_refused(name: str, tmp_path: Path) -> None:
    folder = tmp_path / "studies"
    folder.mkdir()
    (folder / "out").symlink_to(write_study(tmp_path / "elsewhere", row("A")))
    with pytest.raises(ConfigError, match="is no name"):
        study_path(name)
    assert studies() == ()


def test_studies_are_listed_the_latest_first(tmp_path: Path) -> None:
    folder = tmp_path / "studies"
    assert studies() == ()
    for age, name in enumerate(("Meine Läufe (2)", "old")):
        file = write_study(folder / name, row("A")) / FILE
        os.utime(file, (1e9 - age, 1e9 - age))
    (folder / "no study").mkdir()
    assert studies() == ("Meine Läufe (2)", "old")


def test_the_estimate_of_a_vehicle_is_that_of_its_windows() -> None:
    rng = np.random.default_rng(1)
    taus = 1.5 * np.exp(0.1 * rng.standard_normal(12))
    given = rows(*(row("A", tau=float(tau)) for tau in taus), row("B", tau=1.2))
    many, single = group(given, ("make",)).groups
    assert (many.values, many.windows, many.vehicles) == (("A",), 12, 1)
    alone = car_of(np.array(given[POSTERIOR].tolist()[:12]), ModelSpec(BEST))
    np.testing.assert_array_equal(many.drawn.middle, alone.middle)
    tau = many.span("tau")
    assert tau.lower < 1.5 < tau.upper
    assert tau.further_upper - tau.further_lower > 2 * (tau.upper - tau.lower)
    between = many.between_windows["time_gap"]
    assert between.lower < 0.1 * 1.5 / 1.68 < between.upper, "of τ + s₀/v"
    assert many.between_vehicles == {}
    # One window says nothing of how windows differ; what other cars taught widens its interval.
    assert single.between_windows == {}
    assert single.span("tau").upper - single.span("tau").lower > 0.2


def test_vehicles_of_a_group_differ_as_windows_do_one_level_below() -> None:
    rng = np.random.default_rng(2)
    gaps = 1.4 * np.exp(0.5 * rng.standard_normal(16))
    given = rows(*(row("A", name=f"A{k}", tau=float(g)) for k, g in enumerate(gaps) for _ in "ab"))
    [many] = group(given, ("make",)).groups
    assert (many.windows, many.vehicles, len(many.cars)) == (32, 16, 16)
    mean = float(np.exp(np.log(gaps).mean()))
    assert many.span("tau").lower < mean < many.span("tau").upper
    between = many.between_vehicles["time_gap"]
    expected = np.log(gaps + S0 / AT_SPEED).std()
    assert between.value == pytest.approx(expected, rel=0.3), "a t is fitted to what is normal"
    assert many.between_windows["time_gap"].value < between.value / 2
    further = many.span("tau")
    inside = (gaps > further.further_lower) & (gaps < further.further_upper)
    assert inside.mean() > 0.75


def test_a_time_gap_at_a_speed_that_no_window_holds_is_marked() -> None:
    slow, fast = row("A", lowest_speed=8.0, highest_speed=20.0), row("B", highest_speed=30.0)
    groups = group(rows(slow, fast), ("make",))
    driven = [[part.is_driven(speed / 3.6) for speed in (50.0, 100.0)] for part in groups.groups]
    assert driven == [[True, False], [True, True]], "a study that does not tell marks nothing"
    lines = group_table(groups).to_text().splitlines()
    assert [EXTRAPOLATED.glyph in line for line in lines if line.startswith(("A ", "B "))] == [
        True,
        False,
    ]


def test_what_is_unknown_counts_as_a_window_only() -> None:
    unknown = row("A", tau=None)
    [found] = group(rows(row("A"), row("A"), unknown), ("make",)).groups
    assert (found.windows, len(found.cars)) == (3, 1)
    [none] = group(rows(unknown), ("make",)).groups
    assert np.isnan([none.span("tau").value, none.l2_stable.value]).all()
    assert "nan" not in group_table(group(rows(unknown))).to_text()
    spoilt = rows(row("A"), row("A"))
    for wrong in (
        np.full((400, 5), 1e9),
        np.zeros((3, 5)),
        np.zeros((9, 4)),
        np.full((9, 5), np.nan),
    ):
        spoilt.at[1, POSTERIOR] = wrong
        [found] = group(spoilt, ("make",)).groups
        assert np.isfinite(found.span("tau").value)


def test_a_share_of_certain_followers_is_jeffreys_interval() -> None:
    found = share(np.array([1.0] * 7 + [0.0] * 3))
    expected = beta(7.5, 3.5).ppf([0.05, 0.95])
    assert found.value == pytest.approx(0.7)
    np.testing.assert_allclose([found.lower, found.upper], expected, atol=1e-6)
    doubtful = share(np.full(10, 0.7))
    assert doubtful.lower < found.lower < found.upper < doubtful.upper
    assert share(np.zeros(3)).lower == 0


def test_the_share_of_thousands_is_that_of_the_whole_mixture() -> None:
    count, p = 3000, 0.3
    found, stable = share(np.full(count, p)), np.arange(count + 1)
    for end, tail in ((found.lower, 0.05), (found.upper, 0.95)):
        below = beta(stable + 0.5, count - stable + 0.5).cdf(end)
        assert binom(count, p).pmf(stable) @ below == pytest.approx(tail, abs=1e-6)


def test_what_counts_as_a_group_a_window_and_a_vehicle() -> None:
    found = group(rows(row("B"), row(None), row("A"), row("B", campaign="Y")), ("make", "campaign"))
    values = [one.values for one in found.groups]
    assert values == [("", "X"), ("A", "X"), ("B", "X"), ("B", "Y")]
    # Rows of several methods are one window.
    given = rows(row("A", start=0.0), row("A", start=0.0, method="splines"), row("A", start=60.0))
    [everything] = group(given, ()).groups
    assert (everything.windows, everything.vehicles) == (2, 1)
    # Followers of Case I have one posterior, so they count once.
    for case, members in (("I", 1), ("II", 2)):
        pair = [row(name, case=case, start=0.0, vehicle=k) for k, name in ((2, "A"), (3, "B"))]
        [together] = group(rows(*pair), ("campaign",)).groups
        assert (len(together.cars), together.vehicles) == (members, 2)
    # Vehicles without a name are different ones in each recording.
    nameless = [row("", name="Vehicle 2", sha256=sha256) for sha256 in "aab"]
    named = [row("A", sha256=sha256) for sha256 in "ab"]
    assert [one.vehicles for one in group(rows(*nameless, *named), ("make",)).groups] == [2, 1]


@pytest.fixture
def study(tmp_path: Path) -> Path:
    methods = ("pinn", "simulation")
    longest = (row("C", model="Outlander PHEV, longest", method=key) for key in methods)
    return write_study(tmp_path, *(row("Ä & B", alpha=0.1 * k) for k in (1, 2, 3)), *longest)


def test_command_prints_every_format(capsys: Capture, study: Path) -> None:
    found = document(capsys, "table", study, "--by", "make")
    assert [one["make"] for one in found["groups"]] == ["C", "Ä & B"]
    assert (found["model"], found["groups"][1]["windows"]) == (BEST, 3)
    for one in found["groups"]:
        assert one["parameters"].keys() == one["intervals"].keys() == one["further_window"].keys()
        for name, (low, high) in one["intervals"].items():
            assert low < one["parameters"][name] < high
    assert found["groups"][0]["l2_stable"]["value"] < 0.5
    margin = found["groups"][0]["margin_l2"]
    assert margin["value"] < 0
    for kind, sign in (("text", "Ä & B"), ("csv", "alpha_low"), ("latex", r"Ä \& B")):
        assert main(["table", str(study), "--format", kind]) == 0
        assert sign in capsys.readouterr().out
    for option, is_wide in (("--wide", True), ("--format=text", False)):
        assert main(["table", str(study), option]) == 0
        assert ("Further window" in capsys.readouterr().out) == is_wide


def test_what_cannot_be_grouped(capsys: Capture, study: Path, tmp_path: Path) -> None:
    assert "colour is not known" in refused(capsys, 2, "table", study, "--by", "colour")
    assert "level" in refused(capsys, 2, "table", study, "--level", 1)
    assert "no batch is there" in refused(capsys, 1, "table", tmp_path / "none")
