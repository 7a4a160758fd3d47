"""Results as JSON documents: the keys of the contract, with the numbers of the one estimate."""

import json

import pytest

from accpinn.methods.pinn.config import preset
from accpinn.results.documents import describe_comparison, describe_fit, notes
from accpinn.results.naming import PAPERS_POINT, POINT
from accpinn.study.result import Result
from tests.support.snapshots import recommended, result_for, trained, two_windows, whole

KEYS = {
    "method", "case", "model", "preset", "seed", "segment", "parameters", "mae", "mean_time_gap",
    "loss", "network_weights", "iterations", "seconds", "cached", "outcome", "warnings",
}  # fmt: skip


def test_a_fit_with_a_posterior_has_an_answer_of_the_same_numbers() -> None:
    result = recommended()
    document = describe_fit(result)
    assert document.keys() > KEYS
    assert document["model"] == result.estimate.model
    for k, row in enumerate(document["answer"]):
        own = document["parameters"][k]
        assert row["parameters"] == {name: own[name] for name in result.estimate.names}
        span = result.estimate.time_gap(100 / 3.6, k)
        assert row["time_gap"]["100"] == span.value
        assert row["time_gap_intervals"]["100"] == [span.lower, span.upper]
        assert row["further_window"].keys() == row["intervals"].keys() == row["parameters"].keys()
        assert document["intervals"][k]["probability_l2"] == result.uncertainty.probability_l2[k]
    assert (document["level"], document["preset"]) == (result.posterior.level, "calibrated")


def test_a_point_has_no_answer_and_no_intervals() -> None:
    document = describe_fit(trained())
    assert document.keys() > KEYS
    assert "answer" not in document
    assert document["intervals"] is document["level"] is None
    assert [row["tau"] for row in document["parameters"]] == trained().parameters.tau.tolist()
    assert document["mae"]["p"] == trained().evaluation.surrogate.gap_mae.tolist()
    assert any(PAPERS_POINT in note for note in notes(trained()))
    json.dumps(document)


def test_each_of_several_windows_has_its_own_values_where_they_are_known() -> None:
    result = two_windows()
    known = result.posterior
    for k, window in enumerate(describe_fit(result)["windows"]):
        assert window["start"] == result.infos[k].window.start
        assert window["parameters"][0]["alpha"] == result.estimate.windows.alpha[k, 0]
        ends = [part.alpha[k, 0] for part in (known.windows_lower, known.windows_upper)]
        assert window["intervals"][0]["alpha"] == ends
        assert window["fit"]["closed_loop_mae"]["p"]


@pytest.mark.usefixtures("cthp_alone")
def test_a_comparison_has_intervals_and_an_answer_where_a_row_has_a_posterior() -> None:
    points = whole().compared
    document = describe_comparison(points, ())
    assert "answer" not in document
    assert [row["method"] for row in document["rows"]] == ["least-squares", "savitzky-golay"]
    assert [row["intervals"] for row in document["rows"]] == [None, None]
    assert {row["caution"] for row in document["rows"]} == {POINT}
    quick = preset("fast", iterations=20)
    point = result_for(recommended().segments[0], "pinn", quick)
    rows: tuple[Result, ...] = (point, recommended())
    document = describe_comparison(rows, ())
    assert [row["method"] for row in document["rows"]] == ["pinn-fast", "pinn"]
    assert [row["preset"] for row in document["rows"]] == ["fast", "calibrated"]
    assert document["rows"][1]["intervals"]
    taus = [row["parameters"]["tau"] for row in document["answer"]]
    assert taus == recommended().parameters.tau.tolist()
