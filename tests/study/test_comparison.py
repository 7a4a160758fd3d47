"""Results that differ in method or initial values, and the commands that compare them."""

from dataclasses import replace
from typing import Any, NoReturn

import numpy as np
import pytest

from accpinn.cli import main
from accpinn.errors import ConfigError, SegmentError
from accpinn.inference.model_adequacy import FORMS
from accpinn.methods import TaskContext
from accpinn.methods.pinn.config import FAST, STARTS
from accpinn.methods.registry import METHODS, VARIANTS
from accpinn.model.cthp import Parameters
from accpinn.model.spec import ModelSpec
from accpinn.recordings import Window
from accpinn.recordings.files import read
from accpinn.study import Analysis
from accpinn.study.comparison import Refused, compare, spread_of, starts
from accpinn.study.result import Result
from accpinn.study.run import run
from tests.support.command import STUDY, THREE, Capture, document
from tests.support.driving import MIXED, driven
from tests.support.snapshots import altered, asked_of, bits, result_for

QUICK = ("least-squares", "splines", "recursive")
SHORT = ("compare", str(THREE), "--duration", "60", "--vehicles", "1,2", "--methods")


def test_a_stop_keeps_the_results_so_far() -> None:
    recording = read(THREE)
    asked = Analysis.of(recording, [Window(0.0, 60.0)])
    moments = iter([*[False] * 2, *[True] * 9])
    context = TaskContext(threads=1, should_stop=lambda: next(moments))
    found = list(compare(asked, recording, QUICK, context=context))
    assert len(found) < len(QUICK)
    assert [row.estimate.method for row in found if isinstance(row, Result)] == list(
        QUICK[: len(found)]
    )


def test_every_row_is_the_result_of_all_windows_by_its_method() -> None:
    recording = read(THREE)
    windows = [Window(0.0, 40.0), Window(60.0, 130.0)]
    asked = Analysis.of(recording, windows, (1, 2), model="cthp-s0")
    methods = ("least-squares", "recursive", "pinn")
    rows = list(compare(asked, recording, methods))
    models = ["cthp-s0", "cthp", "cthp-s0"]
    assert [row.estimate.method for row in rows] == list(methods)
    assert [row.estimate.model for row in rows] == models, "the usual one, where it has no other"
    for row in rows:
        assert [info.window.start for info in row.infos] == [0.0, 60.0]
        assert [block.window.start for block in row.blocks] == [0.0, 60.0]
        alone = run(row.analysis, recording)
        kept = (replace(one.estimate, seconds=0.0, history=None) for one in (row, alone))
        assert len({str(bits(estimate)) for estimate in kept}) == 1
    assert [row.posterior is None for row in rows] == [True, True, False]


def test_a_method_that_cannot_serve_the_data_is_named_and_the_others_run_on() -> None:
    short = driven(duration=15.0)
    rows = list(compare(asked_of(short), None, ("pinn", "splines"), segments=(short,)))
    assert isinstance(rows[0], Refused)
    assert (rows[0].method, isinstance(rows[1], Result)) == ("pinn", True)
    with pytest.raises(ConfigError, match="magic is not known"):
        list(compare(asked_of(short), None, ("magic",), segments=(short,)))


@pytest.mark.parametrize(
    ("model", "fixed", "kept"),
    [
        ("cthp-s0-delay", {"s0": 4.0}, {"pinn", "pinn-fast", "pinn-paper", "simulation"}),
        ("cthp-s0", {}, {*VARIANTS} - {"recursive", "particle", "dual-ukf"}),
        ("idm", {"v0": 40.0}, {"pinn-fast", "pinn-paper", "simulation"}),
    ],
)
def test_a_method_keeps_the_model_that_it_can_estimate(
    model: str, fixed: dict[str, float], kept: set[str]
) -> None:
    asked = Analysis.of(read(THREE), model=model, fixed=fixed)
    found = {name: asked.with_method(*variant).spec for name, variant in VARIANTS.items()}
    assert {name for name, spec in found.items() if spec == ModelSpec.of(model, fixed)} == kept
    for name in VARIANTS.keys() - kept:
        assert found[name] in (ModelSpec("cthp"), ModelSpec("cthp-s0-delay")), "the usual one"


def test_the_command_has_the_document_of_the_contract_and_the_method_that_refused(
    capsys: Capture, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail(*_: object, **__: object) -> NoReturn:
        raise SegmentError("Too little is left of the window; choose a longer one.")

    refusing = "recursive"
    monkeypatch.setitem(METHODS, refusing, replace(METHODS[refusing], run=fail))
    names = f"{refusing},least-squares,splines,pinn"
    found = document(capsys, *SHORT, names)
    assert isinstance(found["warnings"], list)
    assert [form["form"] for form in found["forms"]] == list(FORMS)
    shown = {"alpha", "tau", "aic", "log_likelihood_ratio", "holdout"}
    assert found["forms"][0].keys() >= shown
    assert [row["method"] for row in found["rows"]] == ["least-squares", "splines", "pinn"]
    for row in found["rows"]:
        assert len(row["parameters"]) == 1
        assert "whiteness" not in row
        assert (row["surrogate_mae"] is None) == (row["method"] == "least-squares")
        assert row["closed_loop_mae"]["p"][0] < 0.5
        assert len(row["blocks_mae"]) == 3
        assert row["holdout_mae"]["p"]
        assert row["unseen_mae"]["p"]
    *points, recommended = found["rows"]
    assert [row["intervals"] for row in points] == [None, None]
    (interval,) = recommended["intervals"]
    assert set(interval) >= {"peak_gain", "linf_gain", "crossover", "alpha"}
    assert found["answer"][0]["parameters"]["alpha"] == recommended["parameters"][0]["alpha"]
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
    lost = altered(result, parameters=Parameters.of(values))
    assert np.isnan(spread_of([result]).percent).all(), "one training alone"
    spread = spread_of([result, result, lost])
    assert np.isnan(spread.percent[0, 2])
    (found,) = spread.findings
    assert (found.trainings, found.every) == (3, False)


def test_starts_differ_in_initial_values_and_seed_alone() -> None:
    analysis = Analysis.of(read(STUDY), model="idm", method="pinn", settings=FAST)
    assert analysis.spec.model == "idm"
    asked: list[Any] = list(starts(analysis, initials=STARTS[:2], seeds=(0, 7)))
    assert [(one.config.initial, one.config.seed) for one in asked] == [
        (initial, seed) for seed in (0, 7) for initial in STARTS[:2]
    ]
    assert {one.spec.model for one in asked} == {"cthp"}, "which alone has α, β and τ"


def test_the_command_prints_every_start(capsys: Capture) -> None:
    limits = ("--duration", 20, "--iterations", 3, "--threads", 1, "--no-cache")
    words = ("starts", STUDY, *limits)
    assert main(list(map(str, words))) == 0
    assert "0.01, 0.5, 2" in capsys.readouterr().out
    found = document(capsys, *words)
    assert [Parameters.of(trial["initial"]) for trial in found["trials"]] == list(STARTS)
    alphas = [trial["parameters"][0]["alpha"] for trial in found["trials"]]
    by_hand = 100 * np.ptp(alphas) / np.mean(alphas)
    assert found["spread_percent"][0]["alpha"] == pytest.approx(by_hand)
