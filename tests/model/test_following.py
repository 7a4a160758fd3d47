"""All that follows from an acceleration, for every model; the published parameter sets."""

import re

import numpy as np
import pytest

from accpinn import PUBLISHED, Parameters, ParameterSet
from accpinn.errors import ConfigError, ParameterError
from accpinn.methods.simulation import Drives, optima
from accpinn.model import cthp
from accpinn.model.following import FollowingModel
from accpinn.model.published import ASTAZERO, CASALE, CASALE_STARTS, VICOLUNGO
from accpinn.model.registry import BASES, FOLLOWING, IDM, following_model
from accpinn.stability.criteria import response
from tests.stability.references import TABLE
from tests.support.command import ROOT
from tests.support.following import CTHPS, driven

SPEED = 22.0
TIME = np.arange(0.0, 30.05, 0.1)
DRIVE = 24.0 + 4.0 * np.sin(0.11 * TIME) + np.sin(0.6 * TIME)


@pytest.mark.parametrize("model", FOLLOWING.values(), ids=FOLLOWING)
def test_the_linearised_response_is_the_gain_of_a_small_sinusoid(model: FollowingModel) -> None:
    theta, near = model.typical, model.linearised(model.typical, SPEED)
    gap = model.equilibrium_gaps(theta, SPEED)
    for omega in (0.25, 0.7):
        time = np.arange(0.0, 100.0 + 4 * np.pi / omega, 0.1)
        wave = SPEED + 0.01 * np.sin(omega * time)
        run = model.simulate(theta, time, wave, np.array([SPEED]), np.array([gap]))
        late = time > 100.0
        phases = np.column_stack([np.ones(late.sum()), np.sin(omega * time[late])])
        basis = np.column_stack([phases, np.cos(omega * time[late])])
        _, sine, cosine = np.linalg.lstsq(basis, run.speeds[late, 1], rcond=None)[0]
        linear = abs(response(near[None], np.array([omega]))[0, 0])
        assert np.hypot(sine, cosine) / 0.01 == pytest.approx(linear, rel=0.01)


@pytest.mark.parametrize("key", CTHPS)
def test_the_cthp_is_its_closed_form(key: str) -> None:
    model = FOLLOWING[key]
    theta = model.typical
    near = model.linearised(theta, SPEED)
    stated = {name: getattr(near, name) for name in model.names}
    assert stated == pytest.approx(dict(zip(model.names, theta, strict=True)), rel=1e-12)
    assert near.s0 == pytest.approx(stated.get("s0", 0.0), abs=1e-11)
    starts = np.array([23.0, 25.0]), np.array([36.0, 41.0])
    part = TIME[:151], DRIVE[:151]
    exact = cthp.simulate(Parameters.of([near.complete] * 2), *part, *starts)
    run = model.simulate(theta, *part, *starts, substeps=16 if model.is_late else 4)
    assert run.gaps == pytest.approx(exact.gaps, abs=1e-8)
    assert run.speeds == pytest.approx(exact.speeds, abs=1e-8)


@pytest.mark.parametrize("delay", [0.05, 0.5])
def test_seldom_samples_and_a_short_delay_do_not_diverge(delay: float) -> None:
    model, starts = FOLLOWING["cthp-s0-delay"], (np.array([23.0]), np.array([36.0]))
    theta, seldom = np.array([0.08, 0.3, 0.8, 6.0, delay]), slice(None, None, 10)
    exact = cthp.simulate(Parameters(*theta[:4], 0.0, delay)[None], TIME[seldom], DRIVE[seldom],
                          *starts)  # fmt: skip
    run = model.simulate(theta, TIME[seldom], DRIVE[seldom], *starts)
    assert run.gaps == pytest.approx(exact.gaps, abs=0.02)


@pytest.mark.parametrize("key", ["idm-lag", "idm-delay"])
def test_a_follower_that_is_not_determined_leaves_the_one_ahead_as_it_is(key: str) -> None:
    model, starts = FOLLOWING[key], (np.array([23.0, 23.0]), np.array([36.0, 36.0]))
    theta = np.column_stack([model.typical, np.full(len(model.parameters), np.nan)])
    run = model.simulate(theta, TIME, DRIVE, *starts)
    alone = model.simulate(model.typical, TIME, DRIVE, *(start[:1] for start in starts))
    assert np.array_equal(run.gaps[:, :1], alone.gaps)
    assert np.isnan(run.gaps[1:, 1]).all()


@pytest.mark.parametrize("key", [base.key for base in BASES])
def test_an_acceleration_is_the_same_in_numpy_and_torch(key: str) -> None:
    torch = pytest.importorskip("torch")
    model, at = FOLLOWING[key], np.array([[30.0, 12.0], [25.0, 8.0], [24.0, 9.0]])
    tensors = torch.tensor(at), torch.tensor(model.typical)
    by_torch = model.acceleration(*tensors[0], tensors[1], torch).numpy()
    assert by_torch == pytest.approx(model.acceleration(*at, model.typical, np), rel=1e-12)


@pytest.mark.parametrize("model", FOLLOWING.values(), ids=FOLLOWING)
def test_a_complex_step_gives_the_derivatives_of_a_simulation(model: FollowingModel) -> None:
    count = len(model.parameters)
    steps = np.eye(count) * 1e-6 * model.typical

    def gaps(theta: np.ndarray) -> np.ndarray:
        start = np.array([36.0])[:, None], np.array([23.0])[:, None]
        return model.integrate(theta[:, None], DRIVE[:, None], *start, 0.2)[:, 0, 0]

    slopes = gaps(model.typical[:, None] + 1e-30j * np.eye(count)).imag / 1e-30
    for k, step in enumerate(steps):
        up, down = (gaps((model.typical + sign * step)[:, None]).real[:, 0] for sign in (1, -1))
        by_difference = (up - down) / (2 * step[k])
        assert slopes[:, k] == pytest.approx(by_difference, rel=1e-4, abs=1e-4)


def test_what_no_model_can_do_ends_in_one_sentence() -> None:
    with pytest.raises(ParameterError, match=r"IDM: .* no equilibrium at 60.0 m/s; choose"):
        IDM.linearised(IDM.typical, 60.0)
    with pytest.raises(ConfigError, match="model: krauss is not known; choose from cthp"):
        following_model("krauss")


def test_the_further_model_of_the_contributing_guide() -> None:
    text = (ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8")
    (code,) = [part for part in re.findall(r"```python\n(.*?)```", text, re.S) if "ovm" in part]
    names: dict[str, FollowingModel] = {}
    exec(code, names)
    model = names["OPTIMAL_VELOCITY"]
    near = model.linearised(model.typical, SPEED)
    gap = float(model.equilibrium_gaps(model.typical, SPEED))
    assert near.alpha > 0
    assert near.beta == 0
    run = model.simulate(model.typical, TIME, 0 * TIME + SPEED, np.array([SPEED]), np.array([gap]))
    assert run.gaps == pytest.approx(gap, abs=1e-9)
    theta = model.typical * [1.5, 1.1, 0.9, 1.1]
    windows = [driven(model, theta[None], seed, 0.03)[0] for seed in range(2)]
    (optimum,) = optima(model, Drives.of(windows, model), [[0, 1]])
    assert optimum.theta == pytest.approx(theta, rel=0.15)


def test_published_sets_are_those_of_the_paper() -> None:
    printed = [row for row in TABLE if "average" not in row.name]  # means are of no vehicle
    shared = [row.vehicle for row in printed if "Table II," in row.name]
    by_follower = [row.vehicle for row in printed if "Table II," not in row.name]
    printed_sets = [dict.fromkeys(group.parameters) for group in PUBLISHED]
    alike = [group for group in PUBLISHED if "Case I " in group.title]
    assert [row for group in printed_sets for row in group] == by_follower + shared
    assert [len({*group.parameters}) for group in alike] == [1, 1]
    assert [len(group) for group in alike] == [len(ASTAZERO), len(VICOLUNGO)]
    assert CASALE_STARTS.parameters[0] == CASALE.parameters[0]
    assert len({group.title for group in PUBLISHED}) == len(PUBLISHED)


def test_followers_go_by_a_recordings_numbers_or_their_names() -> None:
    assert ASTAZERO.labels == ASTAZERO.spoken == ASTAZERO.names
    assert ASTAZERO.vehicles == (1, 2, 3, 4, 5)
    assert not ASTAZERO.numbered
    ours = ParameterSet("run", ("X", "Y"), ASTAZERO.parameters[:2], (3, 4, 5), ("4 X", "5 Y"))
    assert ours.numbered
    assert ours.spoken == ("vehicle 4 X", "vehicle 5 Y")
    with pytest.raises(ParameterError, match="2 names and 1 sets"):
        ParameterSet("Mine", ("a", "b"), ASTAZERO.parameters[:1])
    with pytest.raises(ParameterError, match="at least one vehicle"):
        ParameterSet("Mine", (), Parameters([], [], []))
