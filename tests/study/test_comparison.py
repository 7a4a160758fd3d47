"""All methods side by side, alone or with a second process, and the command that compares them."""

from collections.abc import Iterator
from dataclasses import replace
from typing import NoReturn

import numpy as np
import pytest

from accpinn.cli import main
from accpinn.errors import ConfigError, SegmentError
from accpinn.inference.model_adequacy import FORMS
from accpinn.methods.method import TaskContext
from accpinn.methods.registry import METHODS
from accpinn.recordings.openacc import read
from accpinn.recordings.recording import Recording, Window
from accpinn.study import comparison
from accpinn.study.analysis import Analysis
from accpinn.study.comparison import compare, parse_methods, refused_among, results_among
from accpinn.study.result import Result
from tests.support.command import THREE, document

QUICK = ("least-squares", "splines", "recursive")
SHORT = ("compare", str(THREE), "--duration", "60", "--vehicles", "1,2", "--methods")


@pytest.fixture(scope="module")
def recording() -> Recording:
    return read(THREE)


@pytest.fixture(scope="module")
def asked(recording: Recording) -> Analysis:
    return Analysis.of(recording, [Window(0.0, 60.0)])


@pytest.fixture(scope="module")
def rows(asked: Analysis, recording: Recording) -> tuple[Result, ...]:
    return results_among(compare(asked, recording, QUICK, context=TaskContext(threads=1)))


@pytest.fixture
def refusing(monkeypatch: pytest.MonkeyPatch) -> str:
    """The key of a method that can serve no segment."""

    def run(*_: object, **__: object) -> Iterator[NoReturn]:
        raise SegmentError("Too little is left of the window; choose a longer one.")
        yield

    monkeypatch.setitem(METHODS, "recursive", replace(METHODS["recursive"], run=run))
    return "recursive"


def test_methods_are_named_or_all() -> None:
    assert parse_methods("all") == tuple(METHODS)
    assert parse_methods("splines, pinn,splines") == ("splines", "pinn")
    with pytest.raises(ConfigError, match="guess"):
        parse_methods("splines,guess")


def test_results_come_in_order_with_errors_of_every_kind(
    asked: Analysis, rows: tuple[Result, ...]
) -> None:
    assert [row.analysis.method for row in rows] == list(QUICK)
    for row in rows:
        assert row.analysis == asked.with_method(row.analysis.method)
        assert (row.evaluation.surrogate is None) == (row.analysis.method != "splines")
        assert row.evaluation.holdout is not None
        assert (row.evaluation.closed_loop.gap_mae < 0.5).all()


def test_a_method_that_refuses_ends_nothing(
    asked: Analysis, recording: Recording, refusing: str
) -> None:
    found = list(compare(asked, recording, ("least-squares", refusing, "splines")))
    assert [row.fit.method for row in results_among(found)] == ["least-squares", "splines"]
    (failure,) = refused_among(found)
    assert found.index(failure) == 1
    assert failure.method == refusing
    assert isinstance(failure.fault, SegmentError)


@pytest.mark.parametrize("before", [3, 4, 5])
def test_a_stop_keeps_the_results_so_far(
    asked: Analysis, recording: Recording, before: int
) -> None:
    moments = iter([*[False] * before, *[True] * 9])
    context = TaskContext(threads=1, should_stop=lambda: next(moments))
    found = list(compare(asked, recording, QUICK, context=context))
    assert [row.fit.method for row in results_among(found)] in ([], list(QUICK[:1]))
    assert len(found) < len(QUICK)


class TestSecondProcess:
    @pytest.fixture(autouse=True)
    def worthwhile(self, monkeypatch: pytest.MonkeyPatch) -> None:
        monkeypatch.setattr(comparison, "WORTH", 0.0)
        monkeypatch.setattr("os.cpu_count", lambda: 2)

    def test_the_answers_are_the_same(
        self, asked: Analysis, recording: Recording, rows: tuple[Result, ...]
    ) -> None:
        found = results_among(compare(asked, recording, QUICK))
        for row, alone in zip(found, rows, strict=True):
            assert row.parameters == alone.parameters
            ours, theirs = (one.evaluation.holdout.gap_mae for one in (row, alone))
            np.testing.assert_array_equal(ours, theirs)

    @pytest.mark.parametrize("moment", ["it cannot start", "it dies"])
    def test_without_it_all_methods_are_run_all_the_same(
        self, asked: Analysis, recording: Recording, monkeypatch: pytest.MonkeyPatch, moment: str
    ) -> None:
        class Dying:
            """A process that never answers."""

            def submit(self, *_: object) -> "Dying":
                if moment == "it cannot start":
                    raise OSError("no processes are left")
                return self

            def result(self) -> NoReturn:
                raise RuntimeError("killed")

            def shutdown(self, **_: object) -> None:
                ended.append(True)

        ended: list[bool] = []
        monkeypatch.setattr(comparison, "ProcessPoolExecutor", lambda **_: Dying())
        found = results_among(compare(asked, recording, QUICK))
        assert [row.analysis.method for row in found] == list(QUICK)
        assert ended == [True]

    def test_a_stop_does_not_wait_for_it(self, asked: Analysis, recording: Recording) -> None:
        answers = compare(asked, recording, ("least-squares", "particle"))
        assert next(answers).analysis.method == "least-squares"
        answers.close()


class TestCommand:
    def test_has_the_document_of_the_contract(self, capsys: pytest.CaptureFixture[str]) -> None:
        of = ("--duration", 60, "--vehicles", "1-3", "--methods", "pinn,splines", "--no-cache")
        found = document(capsys, "compare", THREE, *of)
        assert isinstance(found["warnings"], list)
        assert [form["form"] for form in found["forms"][::2]] == list(FORMS)
        assert found["forms"][0].keys() >= {
            "alpha",
            "tau",
            "aic",
            "log_likelihood_ratio",
            "holdout",
        }
        assert [row["method"] for row in found["rows"]] == ["pinn", "splines"]
        for row in found["rows"]:
            assert len(row["parameters"]) == len(row["intervals"]) == len(row["whiteness"]) == 2
            assert set(row) >= {"surrogate_mae", "closed_loop_mae", "holdout_mae", "seconds"}
            assert row["incidents"] == []
            assert row["blocks_mae"][0]["start"] == 0
            assert len(row["blocks_mae"]) == 3
            assert row["unseen_mae"]["p"]
            for interval in row["intervals"]:
                assert set(interval) >= {"peak_gain", "linf_gain", "crossover", "alpha"}
        ours, limit = (row["parameters"][0] for row in found["rows"])
        assert ours["alpha"] == pytest.approx(limit["alpha"], rel=0.01)
        assert ours["beta"] == pytest.approx(limit["beta"], rel=0.02)

    def test_names_the_method_that_refused(
        self, capsys: pytest.CaptureFixture[str], refusing: str
    ) -> None:
        found = document(capsys, *SHORT, f"{refusing},least-squares")
        assert [row["method"] for row in found["rows"]] == ["least-squares"]
        (refused,) = found["refused"]
        assert refused["method"] == refusing
        assert main([*SHORT, f"{refusing},least-squares"]) == 0
        assert refused["reason"] in capsys.readouterr().out
        assert main([*SHORT, refusing]) == 1
        assert capsys.readouterr().err == f"error: {refused['reason']}\n"
