"""Multistart: how far trainings from several initial values and seeds end apart."""

from dataclasses import replace

import numpy as np
import pytest
from accpinn.inference.multistart import (
    NOTICED,
    MultistartFinding,
    SpreadUndetermined,
    TrainingSpread,
    Trial,
    multistart,
    summarise,
)

from accpinn.cli import main
from accpinn.methods import least_squares
from accpinn.methods.fit import Outcome
from accpinn.methods.method import TaskContext
from accpinn.methods.pinn.config import STARTS, preset
from accpinn.model.cthp import Case, Parameters
from tests.support.command import STUDY, Capture, document
from tests.support.driving import MIXED, driven

ONE_THREAD = TaskContext(threads=1)


def spread_of(findings: tuple[MultistartFinding, ...]) -> TrainingSpread:
    (found,) = (one for one in findings if isinstance(one, TrainingSpread))
    return found


def test_the_paper_preset_depends_on_its_start() -> None:
    config, segment = preset("paper", iterations=30), driven()
    found = summarise(segment, list(multistart(segment, config=config, context=ONE_THREAD)))
    assert [trial.initial for trial in found.trials] == list(STARTS)
    alphas = np.array([trial.fit.parameters[0].alpha for trial in found.trials])
    assert found.spread[0, 0] == pytest.approx(100 * np.ptp(alphas) / alphas.mean())
    assert found.spread[0, 0] > 50.0
    assert spread_of(found.findings) == TrainingSpread(5, found.spread.max(), True, 5)


def test_the_fast_preset_depends_on_its_seed_alone() -> None:
    config, segment = preset("fast", iterations=40), driven(noise=0.05)
    trials = multistart(
        segment, config=config, initials=STARTS[1:3], seeds=(0, 1), context=ONE_THREAD
    )
    found = summarise(segment, list(trials))
    assert [trial.seed for trial in found.trials] == [0, 0, 1, 1]
    tables = np.array([trial.fit.parameters.values[0] for trial in found.trials])
    np.testing.assert_allclose(tables[0], tables[1], rtol=1e-3)
    assert (tables[0] != tables[2]).any()
    assert spread_of(found.findings).largest == found.spread.max() < NOTICED


@pytest.mark.parametrize("before", [0, 1], ids=["first training", "its second step"])
def test_a_stop_ends_the_series(before: int) -> None:
    asked = iter([False] * before + [True] * 1000)
    context = TaskContext(threads=1, should_stop=lambda: next(asked))
    assert list(multistart(driven(), context=context)) == []


def test_a_single_training_has_no_spread() -> None:
    segment = driven()
    trial = Trial(STARTS[0], 0, least_squares.fit(segment), None, None)
    assert trial.fit.outcome is Outcome.SOLVED
    assert np.isnan(summarise(segment, [trial]).spread).all()


@pytest.mark.parametrize("case", ["I", "II"])
def test_a_parameter_that_one_training_leaves_undetermined_has_no_spread(case: Case) -> None:
    segment = driven(MIXED[:2])
    fit = least_squares.fit(segment, case)
    values = fit.parameters.values.copy()
    values[: 2 if case == "I" else 1] = 0.0, values[0, 1], np.nan
    lost = replace(fit, parameters=Parameters.of(values))
    trials = [Trial(STARTS[0], k, each, None, None) for k, each in enumerate((fit, fit, lost))]
    found = summarise(segment, trials)
    assert np.isnan(found.spread[0, 2])
    assert found.findings[-1] == SpreadUndetermined(0 if case == "I" else 2, "τ", 1, 3)
    everywhere = summarise(segment, [replace(trial, fit=lost) for trial in trials])
    assert not spread_of(everywhere.findings).every


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
