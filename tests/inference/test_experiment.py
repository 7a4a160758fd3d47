"""Drives that tell most: limits are kept, information is the filter's, predictions come true."""

import numpy as np
import pytest

import accpinn
from accpinn.errors import ConfigError
from accpinn.inference import experiment
from accpinn.inference.experiment import (
    STEP,
    Limits,
    after_drive,
    drives,
    mixture,
    spread_of_draws,
)
from accpinn.results.tables.next_drive import drive_table
from accpinn.study.next_drive import Narrowing, NextDrive
from accpinn.study.result import Result
from accpinn.units import FloatArray
from bench.drive import figures

LIMITS = Limits(90.0, 18.0, 30.0, 1.2)


@pytest.fixture(scope="module")
def result() -> Result:
    return accpinn.fit(accpinn.sample("motorway"), vehicles="1-3")


@pytest.fixture(scope="module")
def proposed(result: Result) -> NextDrive:
    return accpinn.next_drive(result, duration=60.0)


def keeps_limits(speed: FloatArray, limits: Limits) -> None:
    assert len(speed) == len(limits.time)
    assert speed.min() >= limits.slowest - 1e-9
    assert speed.max() <= limits.fastest + 1e-9
    assert np.abs(np.diff(speed)).max() <= limits.acceleration * STEP + 1e-9


def test_every_drive_keeps_its_limits() -> None:
    offered = [*drives(LIMITS)]
    for drive in [*offered, mixture(offered[0], offered[-1], LIMITS)]:
        keeps_limits(drive.speed, LIMITS)
    assert len({drive.kind for drive in offered}) == len(offered)


def test_drives_of_a_kind_are_alike_at_any_acceleration() -> None:
    strong = {drive.kind: drive.speed for drive in drives(Limits())}
    gentle = {drive.kind: drive.speed for drive in drives(Limits(acceleration=1.0))}
    both = strong.keys() & gentle.keys()
    assert both  # sinusoids so slow that both have the whole range of speeds
    for kind in both:
        np.testing.assert_allclose(strong[kind], gentle[kind], atol=0.05)


def test_a_drive_without_motion_tells_less(proposed: NextDrive, result: Result) -> None:
    assert proposed.gain > proposed.motorway_gain
    gains = [gain for _, gain in proposed.offered]
    assert gains == sorted(gains, reverse=True)
    assert gains[0] == proposed.gain
    keeps_limits(proposed.speed, proposed.limits)
    assert proposed.smallest_gap > 0
    gentle = accpinn.next_drive(result, duration=60.0, acceleration=0.3)
    assert gentle.gain < proposed.gain


def test_intervals_only_become_narrower(proposed: NextDrive) -> None:
    names = [row.name for row in proposed.narrowing]
    assert names == ["alpha", "beta", "tau", "time_gap", "s0", "delay"]
    for row in proposed.narrowing:
        assert 0 < row.drive < row.now
        assert 0 < row.motorway < row.now
    alone = {row.name: row.relative_width for row in proposed.narrowing}
    assert max(alone["alpha"], alone["beta"], alone["delay"]) < 1.0
    assert proposed.to_frame().name.tolist() == names
    table = np.genfromtxt(proposed.to_csv().splitlines(), delimiter=",", names=True)
    np.testing.assert_allclose(table["speed_m_s"], proposed.speed, atol=1e-3)
    assert len(str(proposed).splitlines()) == 2 + len(names)


def test_the_interval_of_a_gain_is_symmetric_in_its_logarithm(proposed: NextDrive) -> None:
    row = Narrowing("beta", "%", 60.0, 10.0, 21.0, 10.0, 21.0)
    assert row.text(row.now) == "-38/+60 %"
    assert row.relative_width == pytest.approx(0.5)
    assert Narrowing("s0", "m", 1.0, 0.5, 0.8, 0.5, 1.0).text(0.5) == "±0.5 m"
    first, *_ = proposed.narrowing
    for text in (str(proposed), drive_table(proposed).to_text()):
        assert first.text(first.drive_alone) in text


def test_covariances_after_a_drive_are_those_of_a_normal_model() -> None:
    rng = np.random.default_rng(0)
    typical, windows, noise = (
        root @ root.T + 0.1 * np.eye(3) for root in rng.standard_normal((3, 3, 3))
    )
    further = typical + windows
    after, own = after_drive(typical, further, np.linalg.inv(noise)[None])
    # y = μ + window + noise: the posterior covariances of μ and of μ + window.
    total = np.linalg.inv(further + noise)
    np.testing.assert_allclose(after[0], typical - typical @ total @ typical)
    np.testing.assert_allclose(own[0], further - further @ total @ further)


def test_the_spread_of_normal_draws_is_their_covariance() -> None:
    covariance = np.array([[1.0, 0.5], [0.5, 4.0]])
    draws = np.random.default_rng(0).multivariate_normal([3, -1], covariance, 20000)
    np.testing.assert_allclose(spread_of_draws(draws), covariance, rtol=0.06)


def test_what_cannot_be_proposed_is_refused(
    result: Result, monkeypatch: pytest.MonkeyPatch
) -> None:
    with pytest.raises(ConfigError, match="vehicle: 9 is no follower"):
        accpinn.next_drive(result, vehicle=9)
    with pytest.raises(ConfigError, match="wider range"):
        accpinn.next_drive(result, slowest=20.0, fastest=21.0)
    with pytest.raises(ConfigError, match="duration: 5 is not allowed"):
        accpinn.next_drive(result, duration=5.0)
    point = accpinn.fit(accpinn.sample("motorway"), vehicles="1-2", method="splines")
    with pytest.raises(ConfigError, match="has no likelihood"):
        accpinn.next_drive(point)
    monkeypatch.setattr(experiment, "TOO_CLOSE", 500.0)
    with pytest.raises(ConfigError, match="comes too close"):
        accpinn.next_drive(result, duration=61.0)


def test_the_intervals_narrow_as_predicted() -> None:
    """A small version of `python -m bench.drive`."""
    from bench.drive import car

    rows = [car(seed) for seed in (0, 1, 5)]
    of_all = {name: np.array([row[name] for row in rows]) for name in rows[0]}
    said = {figure.name: figure.value for figure in figures(of_all)}
    for name in ("ln α", "ln β"):
        ratio, predicted = said[f"width of {name}, ratio"], said[f"predicted ratio of {name}"]
        assert ratio < 0.85
        assert 0.3 < ratio / predicted < 1.7
