"""All methods side by side: core, tables and command; and whether intervals hold."""

import json
from pathlib import Path
from typing import NoReturn

import numpy as np
import pytest

from accpinn.cli import main
from accpinn.errors import ConfigError, SegmentError
from accpinn.inference.intervals import intervals
from accpinn.methods import splines
from accpinn.methods.fit import Outcome
from accpinn.methods.pinn.config import FAST, PAPER
from accpinn.methods.registry import METHODS
from accpinn.recordings.openacc import read
from accpinn.recordings.synthetic import load_truth, truth_path
from accpinn.results.tables.estimates import intervals_table, methods_table, where
from accpinn.results.tables.names import TITLES, method_name
from accpinn.segment.cut import cut
from accpinn.segment.segment import Segment
from accpinn.study.comparison import (
    MethodResult,
    compare,
    failures_among,
    parse_methods,
    results_among,
)
from bench.coverage import measure
from tests.support.methods import RIVALS as ESTIMATORS

SAMPLE = Path(__file__).parent.parent / "sample_data" / "synthetic_vicolungo_like.csv"
QUICK = ("least-squares", "splines", "recursive")


@pytest.fixture(scope="module")
def segment() -> Segment:
    return cut(read(SAMPLE))


@pytest.fixture(scope="module")
def rows(segment: Segment) -> list[MethodResult]:
    return list(results_among(compare(segment, "II", QUICK)))


def test_methods_are_named_or_all() -> None:
    assert parse_methods("all") == tuple(METHODS)
    assert parse_methods("splines, pinn") == ("splines", "pinn")
    with pytest.raises(ConfigError, match="guess"):
        parse_methods("splines,guess")


def test_every_method_has_a_title() -> None:
    assert set(TITLES) == set(METHODS)


def test_a_pinn_is_called_by_what_it_was_trained_with() -> None:
    fast, done = FAST.to_json(), Outcome.CONVERGED
    assert method_name("pinn", fast, done) == "PiNN (fast preset)"
    assert method_name("pinn", fast | {"seed": 3}, done) == "PiNN (fast preset, own options)"
    stopped = method_name("pinn", PAPER.to_json(), Outcome.STOPPED)
    assert stopped == "PiNN (paper preset, stopped)"
    assert method_name("splines", {}, Outcome.SOLVED) == "Splines"


def test_rows_come_in_order_with_errors_of_every_kind(rows: list[MethodResult]) -> None:
    assert [row.fit.method for row in rows] == list(QUICK)
    assert rows[0].evaluation.surrogate is None
    assert rows[1].evaluation.surrogate is not None
    for row in rows:
        assert row.evaluation.closed_loop is not None
        assert row.evaluation.holdout is not None
        assert (row.evaluation.closed_loop.gap_mae < 0.5).all()


def refusing(*_: object, **__: object) -> NoReturn:
    raise SegmentError("Too little is left of the window; choose a longer one.")


def test_a_method_that_refuses_ends_nothing(
    segment: Segment, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(ESTIMATORS, "splines", refusing)
    found = list(compare(segment, "II", QUICK))
    assert [row.fit.method for row in results_among(found)] == ["least-squares", "recursive"]
    (refused,) = failures_among(found)
    assert found.index(refused) == 1
    assert (refused.method, refused.reason[:10]) == ("splines", "Too little")


def test_the_command_names_who_refused(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(ESTIMATORS, "recursive", refusing)
    words = ["compare", str(SAMPLE), "--duration", "60", "--methods"]
    assert main([*words, "recursive,least-squares", "--json"]) == 0
    document = json.loads(capsys.readouterr().out)
    assert [row["method"] for row in document["rows"]] == ["least-squares"]
    (refused,) = document["refused"]
    assert refused["method"] == "recursive"
    assert main([*words, "recursive,least-squares"]) == 0
    assert f"recursive has no row: {refused['reason']}" in capsys.readouterr().out
    assert main([*words, "recursive"]) == 1
    assert capsys.readouterr().err.splitlines()[-1] == f"error: {refused['reason']}"


def test_a_stop_keeps_the_rows_so_far(segment: Segment) -> None:
    asked = iter([False, False, False, True])
    found = list(compare(segment, "II", QUICK, should_stop=lambda: next(asked)))
    assert [row.fit.method for row in results_among(found)] == [QUICK[0]]


def test_intervals_hold_the_truth_of_a_sample(segment: Segment, rows: list[MethodResult]) -> None:
    """Of α and β; τ is shifted by the receivers' drift, which the data cannot show, by 0.5 %."""
    laws = load_truth(truth_path(SAMPLE)).parameters
    truth = np.array([[law.alpha, law.beta, law.tau] for law in laws])
    uncertainty = rows[0].uncertainty
    held = (uncertainty.lower.values <= truth) & (truth <= uncertainty.upper.values)
    assert held[:, :2].all()
    np.testing.assert_allclose(uncertainty.centre.tau, truth[:, 2], rtol=0.005)
    assert (uncertainty.probability_l2 < 0.05).all()
    assert uncertainty.draws.values.shape[1:] == (segment.followers, 3)


def test_intervals_hold_as_often_as_they_say_and_naive_ones_do_not() -> None:
    """40 recordings with lasting disturbances; the full study is `python -m bench.coverage`."""
    study = measure(40)
    ours, naive = study.rows[0], next(row for row in study.rows if row.method == "naive")
    assert all(0.75 <= share <= 1.0 for share in ours.covered)
    assert all(share < 0.5 for share in naive.covered)


def test_intervals_are_wide_where_nothing_moves(segment: Segment) -> None:
    still = Segment(
        time=segment.time,
        speeds=20.0 + 1e-3 * np.random.default_rng(0).normal(size=segment.speeds.shape),
        gaps=np.full_like(segment.gaps, 22.0),
        vehicles=segment.vehicles,
        names=segment.names,
        start=0.0,
        source="still",
        sha256="",
    )
    uncertainty = intervals(still, splines.fit(still))
    moving = intervals(segment, splines.fit(segment))
    assert uncertainty.findings
    assert np.isfinite(moving.upper.values).all()
    wide, narrow = (one.upper.values - one.lower.values for one in (uncertainty, moving))
    assert (wide > 3 * narrow).all()


def test_tables_name_method_and_interval(segment: Segment, rows: list[MethodResult]) -> None:
    methods = methods_table(segment, rows, 1)
    assert [row[0] for row in methods.rows] == ["Least squares", "Splines", "Recursive"]
    assert methods.rows[1][1] == rows[1].fit.parameters[1].alpha
    lines = intervals_table(segment, rows[0].uncertainty).rows
    assert len(lines) == segment.followers
    low = rows[0].uncertainty.lower[0].alpha
    assert str(lines[0][1]).startswith(f"{low:.4f} ")
    assert where(segment) in intervals_table(segment, rows[0].uncertainty).caption
    time = methods.columns[-1]
    assert time.shown(0.0004) == "< 0.01"
    assert [time.shown(seconds) for seconds in (0.0, 0.006, 1.284)] == ["0.00", "0.01", "1.28"]


def test_command_prints_one_document(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setenv("ACCPINN_CACHE", str(tmp_path))
    words = ["compare", str(SAMPLE), "--duration", "100", "--methods", "pinn,splines", "--json"]
    assert main(words) == 0
    document = json.loads(capsys.readouterr().out, parse_constant=pytest.fail)
    assert isinstance(document["warnings"], list)
    assert [form["form"] for form in document["forms"][::3]] == [
        "as it is", "standstill distance", "delay",
    ]  # fmt: skip
    assert document["forms"][0].keys() >= {"alpha", "tau", "extra", "explained_unseen"}
    found = document["rows"]
    assert [row["method"] for row in found] == ["pinn", "splines"]
    for row in found:
        assert len(row["parameters"]) == len(row["intervals"]) == 3
        assert set(row) >= {"surrogate_mae", "closed_loop_mae", "holdout_mae", "seconds"}
        assert row["incidents"] == []
        assert len(row["blocks_mae"]) == 3
        assert row["unseen_mae"]["p"]
        assert len(row["whiteness"]) == 3
        for interval in row["intervals"]:
            assert set(interval) >= {"peak_gain", "linf_gain", "crossover"}
    ours, limit = (row["parameters"][0] for row in found)
    assert ours["alpha"] == pytest.approx(limit["alpha"], rel=0.01)
    assert ours["beta"] == pytest.approx(limit["beta"], rel=0.02)


def test_command_refuses_an_unknown_method(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["compare", str(SAMPLE), "--methods", "guess"]) == 2
    assert capsys.readouterr().err.startswith("error: methods:")
