"""Profiles against brute force, dispersion over starts, and warnings that come when they should."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.optimize import nnls

from accpinn.cli import main
from accpinn.errors import ConfigError
from accpinn.inference.identifiability import WIDE, identifiability_warnings
from accpinn.inference.intervals import intervals
from accpinn.inference.multistart import Trial, multistart, summarise
from accpinn.inference.profiles import INCREASE, profile, profiles
from accpinn.methods import least_squares
from accpinn.methods.fit import Outcome
from accpinn.methods.pinn.config import STARTS, preset
from accpinn.methods.regression import Regression
from accpinn.model.cthp import Case, Parameters
from accpinn.recordings.openacc import read
from accpinn.results.tables.estimates import multistart_table
from accpinn.segment.cut import cut
from accpinn.segment.segment import Segment
from bench.disturbed import Disturbance, disturbed
from tests.support.driving import LAW, MIXED, driven, segment_of, standing_still

SAMPLE = Path(__file__).parent.parent / "sample_data" / "synthetic_paper_study.csv"
TRUTH = Parameters(*LAW)
SHORT = {"paper": 30, "fast": 40}
"""Iterations: enough to see what a recipe makes of its start."""


def brute_force(segment: Segment, symbol: str, value: float) -> float:
    """The least sum of squares of the first follower, by another solver on all rows."""
    regression = Regression.of(segment)
    terms, rates = regression.terms[0], regression.rates[0]
    alpha, alpha_tau, beta = terms.T
    if symbol == "α":
        return float(nnls(np.column_stack([alpha_tau, beta]), rates - value * alpha)[1] ** 2)
    if symbol == "β":
        return float(nnls(np.column_stack([alpha, alpha_tau]), rates - value * beta)[1] ** 2)
    return float(nnls(np.column_stack([alpha + value * alpha_tau, beta]), rates)[1] ** 2)


class TestProfile:
    @pytest.mark.parametrize(
        ("symbol", "grid"),
        [("α", [0.0, 0.05, 0.08, 0.3]), ("β", [0.0, 0.1, 0.9]), ("τ", [0.0, 0.7, 1.5, 4.0])],
    )
    def test_every_point_is_the_minimum_over_the_others(
        self, symbol: str, grid: list[float]
    ) -> None:
        segment = driven((LAW,), noise=0.1)
        theta = Regression.of(segment).solve("II").theta
        least = float((Regression.of(segment).residuals(theta) ** 2).sum())
        found = profile(segment, 0, symbol, np.array(grid))  # type: ignore[arg-type]
        by_hand = [brute_force(segment, symbol, value) / least - 1.0 for value in grid]
        np.testing.assert_allclose(found.increase, by_hand, rtol=1e-6, atol=1e-8)

    def test_is_least_at_the_estimate_and_rises_to_the_named_increase_at_its_ends(self) -> None:
        segment = driven(MIXED, noise=0.1)
        estimate = least_squares.fit(segment).parameters.values
        for k, row in enumerate(profiles(segment)):
            for p, one in enumerate(row):
                assert one.best == pytest.approx(estimate[k, p], rel=1e-6)
                assert one.lower < one.best < one.upper
                assert (np.diff(one.values) > 0).all()
                ends = profile(segment, k, one.parameter, np.array([one.lower, one.upper]))
                np.testing.assert_allclose(ends.increase, INCREASE, rtol=1e-4)

    def test_a_case_i_platoon_has_one_set(self) -> None:
        segment = driven((LAW, LAW), noise=0.1)
        (row,) = profiles(segment, "I")
        assert row[0].best == pytest.approx(least_squares.fit(segment, "I").parameters[0].alpha)

    def test_is_flat_where_nothing_moves(self) -> None:
        alpha, beta, tau = profiles(standing_still())[0]
        assert np.isinf(beta.upper)
        assert max(beta.increase.max(), 0.0) < INCREASE
        assert alpha.lower == 0.0
        assert tau.lower == 0.0

    def test_refuses_what_cannot_be_held(self) -> None:
        with pytest.raises(ConfigError, match="choose α, β, τ"):
            profile(driven(), 0, "x")  # type: ignore[arg-type]
        with pytest.raises(ConfigError, match="zero or more"):
            profile(driven(), 0, "α", np.array([-0.1]))


class TestStarts:
    def test_the_paper_recipe_depends_on_its_start_and_says_so(self) -> None:
        config = preset("paper", iterations=SHORT["paper"])
        found = multistart(driven(), config=config, threads=1)
        assert [trial.initial for trial in found.trials] == list(STARTS)
        assert found.spread[0, 0] > 50.0
        assert "had not settled" in found.notes[0]
        tables = np.array([trial.fit.parameters.values[0] for trial in found.trials])
        by_hand = 100 * np.ptp(tables[:, 0]) / tables[:, 0].mean()
        assert found.spread[0, 0] == pytest.approx(by_hand)

    def test_the_fast_recipe_forgets_its_start_but_not_its_seed(self) -> None:
        config = preset("fast", iterations=SHORT["fast"])
        segment = driven(noise=0.05)
        two = multistart(segment, config=config, initials=STARTS[1:3], seeds=(0, 1), threads=1)
        assert [trial.seed for trial in two.trials] == [0, 0, 1, 1]
        tables = np.array([trial.fit.parameters.values[0] for trial in two.trials])
        np.testing.assert_allclose(tables[0], tables[1], rtol=1e-3)
        assert (tables[0] != tables[2]).any()
        assert (two.spread < 1.0).all()
        assert two.notes[0].startswith("All 4 trainings end within")

    def test_a_stop_keeps_what_is_finished(self) -> None:
        asked = iter([False] + [True] * 1000)
        found = multistart(driven(), should_stop=lambda: next(asked), threads=1)
        assert found.trials == ()
        assert np.isnan(found.spread).all()

    def test_a_single_training_has_no_spread(self) -> None:
        segment = driven()
        trial = Trial(STARTS[0], 0, least_squares.fit(segment), None, None)
        assert trial.fit.outcome is Outcome.SOLVED
        assert np.isnan(summarise(segment, (trial,)).spread).all()

    @pytest.mark.parametrize("case", ["I", "II"])
    def test_an_undetermined_parameter_is_said_and_has_no_spread(self, case: Case) -> None:
        segment = driven(MIXED[:2])
        fit = least_squares.fit(segment, case)
        law = replace(fit.parameters[0], alpha=0.0, tau=float("nan"))
        others = (law,) if case == "I" else fit.parameters[1:]
        lost = replace(fit, parameters=(law, *others))
        trials = tuple(Trial(STARTS[0], k, f, None, None) for k, f in enumerate((fit, fit, lost)))
        found = summarise(segment, trials)
        assert np.isnan(found.spread[0, 2])
        whose = "all followers" if case == "I" else segment.labels[1]
        told = f"τ of {whose} is undetermined in 1 of 3 trainings, so there is no spread of it."
        assert found.notes[-1] == told
        assert not any("nan" in note for note in found.notes)
        assert "nan" not in str(multistart_table(segment, found, 0).rows[-1])
        none = summarise(segment, tuple(replace(trial, fit=lost) for trial in trials))
        assert not any(
            "nan" in note or "All 3 trainings end within 0.01 % of each other." in note
            for note in none.notes
        )

    def test_there_must_be_a_start(self) -> None:
        with pytest.raises(ConfigError, match="nothing to train from"):
            multistart(driven(), initials=())


class TestIdentifiable:
    def test_is_silent_where_the_data_tell(self) -> None:
        segment = disturbed((TRUTH,), 1, Disturbance(0.05, 4.0), duration=600.0)
        uncertainty = intervals(segment, least_squares.fit(segment))
        assert (uncertainty.upper < WIDE * uncertainty.lower).all(), (
            "the case needs narrow intervals"
        )
        assert identifiability_warnings(segment, uncertainty) == ()

    def test_a_steady_drive_is_warned_of(self) -> None:
        rng = np.random.default_rng(0)
        time = 0.1 * np.arange(1201)
        speeds = 20 + 0.05 * rng.standard_normal((1201, 2))
        segment = segment_of(time, speeds, 30 + 0.05 * rng.standard_normal((1201, 1)))
        uncertainty = intervals(segment, least_squares.fit(segment))
        (sentence,) = identifiability_warnings(segment, uncertainty)
        assert "leave" in sentence
        assert "τ" in sentence
        assert "the leader's speed varies by only 0.05 m/s" in sentence
        assert sentence.endswith("brakes and accelerates more.")

    @pytest.mark.parametrize("case", ["I", "II"])
    def test_where_there_is_motion_more_time_is_advised(self, case: Case) -> None:
        segment = disturbed((TRUTH,), 1, Disturbance(0.3, 4.0), duration=60.0)
        assert segment.speeds[:, 0].std() > 0.5
        (sentence,) = identifiability_warnings(
            segment, intervals(segment, least_squares.fit(segment, case)), case
        )
        assert sentence.endswith("moves enough here, so take a longer window if there is one.")

    @pytest.mark.parametrize("start", [820, 1140])
    def test_a_constant_speed_window_of_a_recording_is_warned_of(
        self, openacc_dir: Path, start: float
    ) -> None:
        """AstaZero's leader holds its speed within 0.09 m/s there, behind it four followers."""
        recording = read(openacc_dir / "AstaZero" / "ASta_040719_platoon5.csv")
        steady = cut(recording, start, 60)
        assert steady.speeds[:, 0].std() < 0.1
        uncertainty = intervals(steady, least_squares.fit(steady))
        warnings = identifiability_warnings(steady, uncertainty)
        assert len(warnings) == steady.followers
        assert all("leave" in sentence for sentence in warnings)
        moving = cut(recording, 320, 300)
        told = intervals(moving, least_squares.fit(moving))
        width, usual = uncertainty.upper - uncertainty.lower, told.upper - told.lower
        assert (width[[0, 3], :2] > 2 * usual[[0, 3], :2]).all()

    def test_case_i_has_one_sentence_for_all(self) -> None:
        segment = disturbed((TRUTH, TRUTH), 1, Disturbance(0.3, 4.0), duration=60.0)
        fit = least_squares.fit(segment, "I")
        (sentence,) = identifiability_warnings(segment, intervals(segment, fit), "I")
        assert sentence.startswith("All followers together")


class TestCommand:
    WORDS = ("starts", str(SAMPLE), "--duration", "20", "--iterations", "20", "--no-cache")

    def test_one_document_holds_every_start(self, capsys: pytest.CaptureFixture[str]) -> None:
        assert main([*self.WORDS, "--threads", "1", "--json"]) == 0
        found = json.loads(capsys.readouterr().out)
        assert [Parameters(*trial["initial"]) for trial in found["trials"]] == list(STARTS)
        alphas = [trial["parameters"][0]["alpha"] for trial in found["trials"]]
        by_hand = 100 * np.ptp(alphas) / np.mean(alphas)
        assert found["spread_percent"][0]["alpha"] == pytest.approx(by_hand)

    def test_a_table_is_printed_and_nonsense_refused(
        self, capsys: pytest.CaptureFixture[str]
    ) -> None:
        assert main([*self.WORDS, "--threads", "1"]) == 0
        assert "0.01, 0.5, 2" in capsys.readouterr().out
        assert main([*self.WORDS, "--seeds", "0"]) == 2
        assert capsys.readouterr().err.startswith("error: seeds:")
