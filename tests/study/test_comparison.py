"""All methods side by side, the command that compares them, and earlier fits."""

from collections.abc import Iterator
from dataclasses import replace
from typing import NoReturn

import numpy as np
import pytest
from accpinn.study.worker import Answer, Job

from accpinn.cli import main
from accpinn.errors import ConfigError, SegmentError
from accpinn.methods import least_squares
from accpinn.methods.method import TaskContext
from accpinn.methods.registry import METHODS
from accpinn.methods.state_space import FORMS
from accpinn.model.cthp import Parameters
from accpinn.recordings.openacc import read
from accpinn.recordings.recording import Window
from accpinn.segment.cut import cut
from accpinn.segment.segment import Segment
from accpinn.study import comparison
from accpinn.study.comparison import (
    FitRecord,
    MethodResult,
    compare,
    differences,
    failures_among,
    parse_methods,
    result_of,
    results_among,
)
from tests.support.command import THREE, document
from tests.support.samples import PLATOON, sample

QUICK = ("least-squares", "splines", "recursive")
SHORT = ("compare", THREE, "--duration", 60, "--vehicles", "1,2", "--methods")


@pytest.fixture(scope="module")
def segment() -> Segment:
    return cut(read(THREE))


@pytest.fixture(scope="module")
def rows(segment: Segment) -> list[MethodResult]:
    return list(results_among(compare(segment, "II", QUICK)))


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


def test_results_come_in_order_with_errors_of_every_kind(rows: list[MethodResult]) -> None:
    assert [row.fit.method for row in rows] == list(QUICK)
    assert rows[0].evaluation.surrogate is None
    assert rows[1].evaluation.surrogate is not None
    for row in rows:
        assert row.evaluation.holdout is not None
        assert (row.evaluation.closed_loop.gap_mae < 0.5).all()


def test_a_fit_that_exists_has_no_holdout(segment: Segment, rows: list[MethodResult]) -> None:
    found = result_of(segment, rows[0].fit)
    assert found.evaluation.holdout is None
    assert found.uncertainty.lower == rows[0].uncertainty.lower


def test_a_method_that_refuses_ends_nothing(segment: Segment, refusing: str) -> None:
    found = list(compare(segment, "II", ("least-squares", refusing, "splines")))
    assert [row.fit.method for row in results_among(found)] == ["least-squares", "splines"]
    (failure,) = failures_among(found)
    assert found.index(failure) == 1
    assert failure.method == refusing
    assert isinstance(failure.fault, SegmentError)


@pytest.mark.parametrize("before", [3, 4, 5])
def test_a_stop_keeps_the_results_so_far(segment: Segment, before: int) -> None:
    asked = iter([*[False] * before, True])
    context = TaskContext(should_stop=lambda: next(asked))
    found = list(compare(segment, "II", QUICK, context=context))
    assert [row.fit.method for row in results_among(found)] == [QUICK[0]]


class TestCommand:
    def test_has_the_document_of_the_contract(self, capsys: pytest.CaptureFixture[str]) -> None:
        of = ("--duration", 60, "--vehicles", "1-3", "--methods", "pinn,splines", "--no-cache")
        words = ("compare", THREE, *of)
        found = document(capsys, *words)
        assert isinstance(found["warnings"], list)
        forms = [form["form"] for form in found["forms"][::2]]
        assert forms == list(FORMS)
        assert found["forms"][0].keys() >= {"alpha", "tau", "extra", "aic", "holdout"}
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
        both = [*map(str, SHORT), f"{refusing},least-squares"]
        found = document(capsys, *both)
        assert [row["method"] for row in found["rows"]] == ["least-squares"]
        (refused,) = found["refused"]
        assert refused["method"] == refusing
        assert main(both) == 0
        assert f"{refusing} has no result: {refused['reason']}" in capsys.readouterr().out
        assert main([*map(str, SHORT), refusing]) == 1
        assert capsys.readouterr().err.splitlines()[-1] == f"error: {refused['reason']}"


class TestFitRecords:
    def test_name_what_was_requested_differently(self) -> None:
        four = sample(PLATOON).segment
        fit = least_squares.fit(four)
        one = FitRecord.of(four, fit)
        assert differences(one, FitRecord.of(four, fit)) == ()
        assert one.same_as(FitRecord.of(four, fit))
        shared = FitRecord.of(four, least_squares.fit(four, "I"))
        assert "case: II → I" in differences(one, shared)
        assert not one.same_as(shared)
        changed = replace(one.info, window=Window(40.0, 340.0), excluded_regimes=("manual",))
        moved = differences(one, replace(one, info=changed))
        assert "window: 0–300 s → 40–340 s" in moved
        assert "excluded: nothing → manual" in moved

    def test_give_a_vehicles_parameters_and_errors(self) -> None:
        four = sample(PLATOON).segment
        fit = least_squares.fit(four)
        record = FitRecord.of(four, fit)
        assert record.of_vehicle(3) == fit.parameters[1]
        assert record.of_vehicle(1) is None
        assert np.isfinite(record.closed_loop).all()
        headless = replace(fit, parameters=Parameters.of(fit.parameters.values * [1, 1, np.nan]))
        assert np.isnan(FitRecord.of(four, headless).closed_loop).all()


def test_what_the_second_process_has_not_begun_is_run_while_its_answer_is_awaited(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    ran: list[str] = []

    class Busy:
        """At work on splines until the caller has run another method."""

        def __init__(self, job: Job, _: object) -> None:
            self.job = job

        def leaves(self, key: str) -> bool:
            if key != "splines":
                ran.append(key)
            return key != "splines"

        def is_busy_with(self, key: str) -> bool:
            return key == "splines" and "recursive" not in ran

        def answer(self, key: str, _: object) -> Answer | None:
            return self.job.run(key, TaskContext()) if key == "splines" else None

        def close(self) -> None:
            ran.append("closed")

    monkeypatch.setattr(comparison, "Worker", Busy)
    monkeypatch.setattr(comparison, "is_worthwhile", lambda *_: True)
    segment, methods = cut(read(THREE), 0, 60), ("splines", "recursive", "least-squares")
    found = results_among(compare(segment, "II", methods))
    assert [one.fit.method for one in found] == [*methods]
    assert ran == ["recursive", "least-squares", "closed"]
