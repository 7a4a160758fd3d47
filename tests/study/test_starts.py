"""Other initial values and seeds: how far trainings end apart."""

from dataclasses import replace

import numpy as np
import pytest

from accpinn.cli import main
from accpinn.methods.method import TaskContext
from accpinn.methods.pinn.config import STARTS, preset
from accpinn.model.cthp import Case, Parameters
from accpinn.results.messages import messages
from accpinn.study.result import Result
from accpinn.study.run import estimate
from accpinn.study.starts import NOTICED, SpreadUndetermined, TrainingSpread, spread_of, starts
from tests.support.command import STUDY, Capture, document
from tests.support.driving import MIXED, driven
from tests.support.snapshots import asked_of, result_for


def test_the_paper_preset_depends_on_its_start() -> None:
    segment = driven()
    asked = list(starts(asked_of(segment, "pinn", preset("paper", iterations=30))))
    assert [analysis.config.initial for analysis in asked] == list(STARTS)
    context = TaskContext(threads=1)
    results = [estimate(analysis, (segment,), context=context) for analysis in asked]
    alphas = np.array([result.parameters.alpha[0] for result in results])
    spread = spread_of(results)
    assert spread.percent[0, 0] == pytest.approx(100 * np.ptp(alphas) / alphas.mean())
    assert spread.percent[0, 0] > 50.0
    assert spread.findings == (TrainingSpread(5, spread.percent.max(), True, 5),)


def test_the_fast_preset_depends_on_its_seed_alone() -> None:
    segment = driven(noise=0.05)
    asked = asked_of(segment, "pinn", preset("fast", iterations=40))
    asked = list(starts(asked, initials=STARTS[1:3], seeds=(0, 1)))
    assert [analysis.config.seed for analysis in asked] == [0, 0, 1, 1]
    results = [estimate(analysis, (segment,)) for analysis in asked]
    tables = [result.parameters.values for result in results]
    np.testing.assert_allclose(tables[0], tables[1], rtol=1e-3)
    assert (tables[0] != tables[2]).any()
    (apart,) = spread_of(results).findings
    assert apart.largest < NOTICED
    assert messages([apart], segment)


@pytest.mark.parametrize("case", ["I", "II"])
def test_a_parameter_that_one_training_leaves_undetermined_has_no_spread(case: Case) -> None:
    result = result_for(driven(MIXED[:2]), case=case)
    values = result.parameters.values.copy()
    values[: 2 if case == "I" else 1] = 0.0, values[0, 1], np.nan

    def lost() -> Result:
        return replace(result, fits=(replace(result.fit, parameters=Parameters.of(values)),))

    assert np.isnan(spread_of([result]).percent).all(), "one training alone"
    spread = spread_of([result, result, lost()])
    assert np.isnan(spread.percent[0, 2])
    assert spread.findings[-1] == SpreadUndetermined(0 if case == "I" else 2, "τ", 1, 3)
    assert "1 of 3 trainings" in messages(spread.findings, result.info)[-1]
    assert not spread_of([lost()] * 3).findings[0].every


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
