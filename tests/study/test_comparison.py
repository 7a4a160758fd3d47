"""Results that differ in method, initial values or instants, and the commands that compare them."""

from dataclasses import replace
from typing import NoReturn

import numpy as np
import pytest

from accpinn import METHODS, Analysis, Parameters, Recording, cut, label_regimes, run, spread_of
from accpinn.cli import main
from accpinn.errors import SegmentError
from accpinn.inference.model_adequacy import FORMS
from accpinn.methods import TaskContext
from accpinn.methods.pinn.config import STARTS
from accpinn.recordings import Window
from accpinn.recordings.openacc import read
from accpinn.results.recording import regimes_table, sensitivity_table
from accpinn.study.comparison import CHOICES, COMPARED, SensitivityResult, compare, sensitivity
from accpinn.study.result import Result
from tests.support.command import STUDY, THREE, Capture, document
from tests.support.driving import MIXED, driven
from tests.support.snapshots import result_for

QUICK = ("least-squares", "splines", "recursive")
SHORT = ("compare", str(THREE), "--duration", "60", "--vehicles", "1,2", "--methods")


def test_a_stop_keeps_the_results_so_far() -> None:
    recording = read(THREE)
    asked = Analysis.of(recording, [Window(0.0, 60.0)])
    moments = iter([*[False] * 2, *[True] * 9])
    context = TaskContext(threads=1, should_stop=lambda: next(moments))
    found = list(compare(asked, recording, QUICK, context=context))
    assert len(found) < len(QUICK)
    assert [row.fit.method for row in found if isinstance(row, Result)] == list(QUICK[: len(found)])


def test_the_command_has_the_document_of_the_contract_and_the_method_that_refused(
    capsys: Capture, monkeypatch: pytest.MonkeyPatch
) -> None:
    def run(*_: object, **__: object) -> NoReturn:
        raise SegmentError("Too little is left of the window; choose a longer one.")

    refusing = "recursive"
    monkeypatch.setitem(METHODS, refusing, replace(METHODS[refusing], run=run))
    found = document(capsys, *SHORT, f"{refusing},least-squares,splines", "--no-cache")
    assert isinstance(found["warnings"], list)
    assert [form["form"] for form in found["forms"]] == list(FORMS)
    shown = {"alpha", "tau", "aic", "log_likelihood_ratio", "holdout"}
    assert found["forms"][0].keys() >= shown
    assert [row["method"] for row in found["rows"]] == ["least-squares", "splines"]
    for row in found["rows"]:
        assert len(row["parameters"]) == len(row["whiteness"]) == 1
        assert (row["surrogate_mae"] is None) == (row["method"] == "least-squares")
        assert row["closed_loop_mae"]["p"][0] < 0.5
        assert len(row["blocks_mae"]) == 3
        assert row["holdout_mae"]["p"]
        assert row["unseen_mae"]["p"]
        (interval,) = row["intervals"]
        assert set(interval) >= {"peak_gain", "linf_gain", "crossover", "alpha"}
    (refused,) = found["refused"]
    assert refused["method"] == refusing
    assert main([*SHORT, f"{refusing},least-squares"]) == 0
    assert refused["reason"] in capsys.readouterr().out
    assert main([*SHORT, refusing]) == 1
    assert capsys.readouterr().err == f"error: {refused['reason']}\n"


# Initial values


def test_a_parameter_that_one_training_leaves_undetermined_has_no_spread() -> None:
    result = result_for(driven(MIXED[:2]), case="II")
    values = result.parameters.values.copy()
    values[0] = 0.0, values[0, 1], np.nan
    lost = replace(result, fits=(replace(result.fit, parameters=Parameters.of(values)),))
    assert np.isnan(spread_of([result]).percent).all(), "one training alone"
    spread = spread_of([result, result, lost])
    assert np.isnan(spread.percent[0, 2])
    (found,) = spread.findings
    assert (found.trainings, found.every) == (3, False)


def test_the_command_prints_every_start(capsys: Capture) -> None:
    limits = ("--duration", 20, "--iterations", 20, "--threads", 1, "--no-cache")
    words = ("starts", STUDY, *limits)
    assert main(list(map(str, words))) == 0
    assert "0.01, 0.5, 2" in capsys.readouterr().out
    found = document(capsys, *words)
    assert [Parameters.of(trial["initial"]) for trial in found["trials"]] == list(STARTS)
    alphas = [trial["parameters"][0]["alpha"] for trial in found["trials"]]
    by_hand = 100 * np.ptp(alphas) / np.mean(alphas)
    assert found["spread_percent"][0]["alpha"] == pytest.approx(by_hand)


# Instants


def of(rows: tuple[SensitivityResult, ...], choice: str, method: str) -> SensitivityResult:
    return next(row for row in rows if (row.choice, row.method) == (choice, method))


def test_where_all_is_car_following_nothing_depends_on_the_choice() -> None:
    segment = driven()
    rows = sensitivity(segment)
    assert [(row.choice, row.method) for row in rows] == [(c, m) for c in CHOICES for m in COMPARED]
    assert {row.share for row in rows} == {(0.0,)}
    for method in COMPARED:
        assert len({row.parameters for row in rows if row.method == method}) == 1
    masked = replace(segment, mask=segment.time[:, None] <= 30.0)
    assert sensitivity(masked) == rows, "the segment's own mask has no effect"


def test_too_little_left_is_said_in_its_row() -> None:
    segment = driven()
    rows = sensitivity(replace(segment, gaps=segment.gaps + 40.0))
    row = of(rows, "car-following only", "splines")
    assert row.parameters is None
    assert "0.0 s" in str(row.fault)
    assert of(rows, "all instants", "splines").parameters
    table = sensitivity_table(segment.info, rows, 0)
    share, *cells = table.rows[-1][1:]
    assert share == 100.0
    assert np.isnan(np.array(cells, float)).all()


def test_casale_without_catching_up(casale: Recording) -> None:
    """The method notes say about .028, .093, 1.36; what is seen is .0288, .0890, 1.352."""
    segment = cut(casale, 0, 300)
    rows = sensitivity(segment, casale)
    asked = Analysis.of(casale, excluded="catching-up", method="least-squares")
    row = of(rows, "without catching up", "least-squares")
    assert row.parameters == run(asked, casale).parameters
    assert row.share == pytest.approx((0.21,), abs=0.01)
    found = row.parameters[0]
    assert found.alpha == pytest.approx(0.028, rel=0.05)
    assert found.beta == pytest.approx(0.093, rel=0.06)
    assert found.tau == pytest.approx(1.36, rel=0.01)
    assert of(rows, "all instants", "splines").parameters.tau[0] == pytest.approx(1.522, rel=0.01)
    table = sensitivity_table(segment.info, rows, 0)
    assert [row[0] for row in table.rows] == [choice.capitalize() for choice in CHOICES]
    shares = regimes_table(segment.info, label_regimes(segment, casale)).rows[0][1:]
    assert shares == pytest.approx((78.8, 21.2, 0.0, 0.0), abs=0.1)
