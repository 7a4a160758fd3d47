"""The file for SUMO, which SUMO itself must read as the CTHP, and the parameter card."""

import importlib.util
import json
import subprocess
import sys
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest

from accpinn.errors import ParameterError
from accpinn.model.cthp import Parameters
from accpinn.model.published import PUBLISHED, ParameterSet
from accpinn.model.registry import FOLLOWING
from accpinn.platoon.leader import Sinusoid
from accpinn.platoon.simulation import simulate_platoon
from accpinn.results.export import parameter_card, snapshot_types, sumo_types
from tests.support import sumo
from tests.support.snapshots import small

LATE = ParameterSet(
    "intercept, delay and lag",
    ("A", "B", "C"),
    Parameters(
        [0.08, 0.1, 0.09], [0.4, 0.3, 0.5], [0.8, 0.7, 1.2],
        s0=[8.0, 5.0, 0.0], delay=[0.5, 0.9, 0.0], lag=[0.0, 0.0, 0.4],
    ),
)  # fmt: skip
PROGRAM = Path(__file__).parents[1] / "support" / "sumo.py"


def ids(types: str) -> list[str]:
    return [str(one.get("id")) for one in ElementTree.fromstring(types).findall("vType")]


@pytest.mark.skipif(importlib.util.find_spec("libsumo") is None, reason="libsumo is not installed")
@pytest.mark.parametrize("frequency", [0.1, 0.2])
@pytest.mark.parametrize("published", [*PUBLISHED, LATE], ids=lambda one: one.title)
def test_sumo_answers_as_our_platoon(published: ParameterSet, frequency: float) -> None:
    types = sumo_types(published.names, published.parameters)
    headways = published.parameters.time_gap(sumo.SPEED).tolist()
    given = {"types": types, "ids": ids(types), "headways": headways, "frequency": frequency}
    ran = subprocess.run(
        [sys.executable, str(PROGRAM)], input=json.dumps(given), capture_output=True, text=True,
        check=True,
    )  # fmt: skip
    leader = Sinusoid(frequency, 1.0, sumo.SPEED, sumo.SETTLE, sumo.DURATION)
    expected = simulate_platoon(published.parameters, leader).amplitudes
    found = json.loads(ran.stdout.splitlines()[-1])
    np.testing.assert_allclose(found, expected.measured, rtol=0.02)


@pytest.mark.skipif(importlib.util.find_spec("libsumo") is None, reason="libsumo is not installed")
@pytest.mark.parametrize("key", ["idm", "idm-delay"])
def test_sumos_own_idm_answers_as_our_platoon(key: str) -> None:
    theta = [[1.0, 2.0, 1.1, 4.0, 38.0, 0.3], [0.8, 5.0, 0.9, 6.0, 45.0, 0.5]]
    model = FOLLOWING[key]
    own = np.array(theta)[:, : len(model.parameters)]
    vehicles = model.linearisations(own.T, sumo.SPEED)
    types = sumo_types(("A", "B"), vehicles, model=key)
    headways = vehicles.time_gap(sumo.SPEED).tolist()
    given = {"types": types, "ids": ids(types), "headways": headways, "frequency": 0.2}
    ran = subprocess.run(
        [sys.executable, str(PROGRAM)], input=json.dumps(given), capture_output=True, text=True,
        check=True,
    )  # fmt: skip
    leader = Sinusoid(0.2, 1.0, sumo.SPEED, sumo.SETTLE, sumo.DURATION)
    expected = simulate_platoon(vehicles, leader, model=key).amplitudes
    found = json.loads(ran.stdout.splitlines()[-1])
    np.testing.assert_allclose(found, expected.measured, rtol=0.02)


def test_types_hold_the_parameters_and_every_sample() -> None:
    snapshot = small()
    answer = snapshot.answer
    root = ElementTree.fromstring(snapshot_types(snapshot, 5))
    singles, mixtures = root.findall("vType"), root.findall("vTypeDistribution")
    assert len(singles) == len(mixtures) == snapshot.info.followers
    for k, (single, mixture) in enumerate(zip(singles, mixtures, strict=True)):
        own = {name: float(single.get(name, "nan")) for name in ("tau", "minGap")}
        gap, speed = answer.parameters.time_gap(answer.speeds[k])[k], answer.speeds[k]
        assert own["tau"] + own["minGap"] / speed == pytest.approx(gap, rel=1e-9)
        gains = [float(single.get(a, "")) for a in ("gapControlGainSpace", "gapControlGainSpeed")]
        np.testing.assert_allclose(gains, answer.parameters.values[k, :2], rtol=1e-9)
        held = float(single.get("actionStepLength", "0"))
        assert held / 2 == pytest.approx(answer.parameters.delay[k], abs=0.03)
        # Each is one of the draws, to the digits that the file has.
        drawn = np.array([float(one.get("gapControlGainSpace", "")) for one in mixture])
        assert len(set(drawn)) == 5
        for alpha in drawn:
            assert np.isclose(answer.typical.alpha[:, k], alpha, rtol=1e-9, atol=0).any()
        assert sum(float(one.get("probability", "")) for one in mixture) == pytest.approx(1)
    assert not ElementTree.fromstring(snapshot_types(snapshot, 0)).findall("vTypeDistribution")


def test_names_become_identifiers_and_an_undetermined_headway_is_refused() -> None:
    odd = Parameters([0.1, 0.1], [0.2, 0.2], [1.0, 1.0])
    assert ids(sumo_types(('<"&> Ä(8)', "日"), odd)) == ["F1_8", "F2_vehicle"]
    with pytest.raises(ParameterError, match="A: τ is undetermined"):
        sumo_types(("A",), Parameters([0.0], [0.2], [np.nan]))


def test_a_card_names_parameters_intervals_and_where_they_come_from() -> None:
    snapshot = small()
    known = snapshot.uncertainty
    card = parameter_card(snapshot)
    for k, vehicle in enumerate(card["vehicles"]):
        tau = vehicle["tau"]
        assert tau["value"] == snapshot.fit.parameters.tau[k]
        assert (tau["low"], tau["high"]) == (known.lower.tau[k], known.upper.tau[k])
        assert tau["unit"] == "s"
    assert card["provenance"]["sha256"] == snapshot.info.sha256
    assert card["provenance"]["duration"] == snapshot.info.window.duration
    assert "CC BY 4.0" in card["attribution"]
