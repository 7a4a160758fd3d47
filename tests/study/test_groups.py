"""Groups of a batch's rows: the truth recovered, shares with intervals, every format."""

from pathlib import Path

import numpy as np
import pytest
from scipy.stats import beta, binom

from accpinn.cli import main
from accpinn.errors import ConfigError, RecordingError
from accpinn.results.tables.groups import group_table
from accpinn.study.groups import group, read_study, share
from tests.support.command import Capture, document, refused
from tests.support.studies import row, rows, write_study


def test_medians_and_spread_are_those_of_the_windows() -> None:
    rng = np.random.default_rng(1)
    spread, error = 0.3, 0.1
    normal = rng.normal(size=400)
    taus = 1.5 * np.exp(np.hypot(spread, error) * (normal - normal.mean()) / normal.std())
    found = group(
        rows(*(row("A", tau=float(tau), tau_error=error) for tau in taus), row("B")), ("make",)
    )
    many, single = found.groups
    assert (many.values, many.windows, many.vehicles) == (("A",), 400, 1)
    assert many.tau.low < 1.5 < many.tau.high
    assert many.tau.high - many.tau.low == pytest.approx(2 * 1.65 * 1.5 * 0.32 / 20, rel=0.15)
    assert many.tau.between.deviation == pytest.approx(spread, rel=0.15)
    assert many.alpha.between.deviation == 0
    # One window alone has its own interval.
    assert (single.tau.median, single.tau.low, single.tau.high) == (1.0, 0.9, 1.1)


def test_what_is_unknown_counts_as_a_window_only() -> None:
    unknown = row("A", tau=None, tau_error=None, p_l2_stable=None, alpha=0.0)
    [found] = group(rows(row("A"), row("A"), unknown), ("make",)).groups
    assert found.windows == 3
    assert found.tau.between.windows == found.alpha.between.windows == 2
    [none] = group(rows(unknown), ("make",)).groups
    assert np.isnan([none.tau.median, none.l2_stable.value]).all()
    assert "(–)" not in group_table(group(rows(unknown))).to_text()
    [zero] = group(rows(row("A", beta=0.0, beta_low=0.0)), ("make",)).groups
    assert (zero.beta.median, zero.beta.low) == (0.0, 0.0)
    [mixed] = group(rows(row("A"), row("A", beta=0.0)), ("make",)).groups
    assert (mixed.beta.median, mixed.beta.between.windows) == (0.2, 1), "the one that counts"


def test_vehicles_without_a_name_are_different_ones_in_each_recording() -> None:
    nameless = [row("", name="Vehicle 2", sha256=sha256) for sha256 in "aab"]
    named = [row("A", sha256=sha256) for sha256 in "ab"]
    assert [one.vehicles for one in group(rows(*nameless, *named), ("make",)).groups] == [2, 1]


def test_a_share_of_certain_followers_is_jeffreys_interval() -> None:
    found = share(np.array([1.0] * 7 + [0.0] * 3))
    expected = beta(7.5, 3.5).ppf([0.05, 0.95])
    assert found.value == pytest.approx(0.7)
    np.testing.assert_allclose([found.low, found.high], expected, atol=1e-6)
    doubtful = share(np.full(10, 0.7))
    assert doubtful.low < found.low < found.high < doubtful.high
    assert share(np.zeros(3)).low == 0


def test_the_share_of_thousands_is_that_of_the_whole_mixture() -> None:
    count, p = 3000, 0.3
    found, stable = share(np.full(count, p)), np.arange(count + 1)
    for end, tail in ((found.low, 0.05), (found.high, 0.95)):
        below = beta(stable + 0.5, count - stable + 0.5).cdf(end)
        assert binom(count, p).pmf(stable) @ below == pytest.approx(tail, abs=1e-6)


def test_groups_are_sorted_and_missing_names_are_empty() -> None:
    found = group(rows(row("B"), row(None), row("A"), row("B", campaign="Y")), ("make", "campaign"))
    values = [one.values for one in found.groups]
    assert values == [("", "X"), ("A", "X"), ("B", "X"), ("B", "Y")]
    by_method = group(rows(row("A"), row("A", method="splines")), ("method",))
    assert [one.values for one in by_method.groups] == [("maximum-likelihood",), ("splines",)]
    [everything] = group(rows(row("A"), row("B")), ()).groups
    assert (everything.windows, everything.vehicles) == (2, 2)


@pytest.fixture
def study(tmp_path: Path) -> Path:
    several = (row("Ä & B", alpha=0.1 * k) for k in (1, 2, 3))
    return write_study(tmp_path, *several, row("C"), row("C", method="splines"))


def test_command_prints_every_format(capsys: Capture, study: Path) -> None:
    found = document(capsys, "table", study, "--by", "make")
    assert [one["make"] for one in found["groups"]] == ["C", "Ä & B"]
    assert found["groups"][1]["windows"] == 3
    assert found["groups"][1]["alpha"]["median"] == pytest.approx(0.1 * 6 ** (1 / 3), rel=1e-6)
    assert found["groups"][0]["l2_stable"]["share"] == 0.0
    for kind, sign in (("text", "Ä & B"), ("csv", "alpha_per_s2_low"), ("latex", r"Ä \& B")):
        assert main(["table", str(study), "--format", kind]) == 0
        assert sign in capsys.readouterr().out
    only = document(capsys, "table", study, "--by", "make", "--method", "splines")
    assert [one["windows"] for one in only["groups"]] == [1]


def test_what_cannot_be_grouped(capsys: Capture, study: Path, tmp_path: Path) -> None:
    assert "colour is not known" in refused(capsys, 2, "table", study, "--by", "colour")
    assert "choose maximum-likelihood, splines" in refused(
        capsys, 2, "table", study, "--method", "pinn"
    )
    assert "level" in refused(capsys, 2, "table", study, "--level", 1)
    assert "no batch is there" in refused(capsys, 1, "table", tmp_path / "none")
    with pytest.raises(RecordingError):
        read_study(tmp_path / "none")
    with pytest.raises(ConfigError):
        group(rows(row("A")), ("vehicle",))


def test_a_number_that_is_no_probability_is_unknown(tmp_path: Path) -> None:
    study = write_study(tmp_path / "s", row("A", p_linf_stable=2**62), row("A"))
    found = read_study(study)
    assert found["p_linf_stable"].isna().tolist() == [True, False]
    assert not found["p_l2_stable"].isna().any()
    [one] = group(found).groups
    assert one.linf_stable.value == 0.0
