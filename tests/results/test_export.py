"""The file for SUMO, which SUMO itself must read as the CTHP or IDM, and the parameter card."""

import importlib.util
import json
import subprocess
import sys
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest

from accpinn import PUBLISHED, Parameters, Sinusoid, parameter_card, simulate_platoon, sumo_types
from accpinn.errors import ParameterError
from accpinn.model.registry import FOLLOWING
from accpinn.results.export import snapshot_types
from tests.support import sumo
from tests.support.snapshots import recommended, small

LATE = Parameters(
    [0.08, 0.1, 0.09], [0.4, 0.3, 0.5], [0.8, 0.7, 1.2],
    s0=[8.0, 5.0, 0.0], delay=[0.5, 0.9, 0.0], lag=[0.0, 0.0, 0.4],
)  # fmt: skip
IDM = np.array([[1.0, 2.0, 1.1, 4.0, 38.0, 0.3], [0.8, 5.0, 0.9, 6.0, 45.0, 0.5]])
PROGRAM = Path(__file__).parents[1] / "support" / "sumo.py"


def ids(types: str) -> list[str]:
    return [str(one.get("id")) for one in ElementTree.fromstring(types).findall("vType")]


def idm(key: str) -> Parameters:
    model = FOLLOWING[key]
    return model.linearisations(IDM[:, : len(model.parameters)].T, sumo.SPEED)


@pytest.mark.skipif(importlib.util.find_spec("libsumo") is None, reason="libsumo is not installed")
def test_sumo_answers_as_our_platoon() -> None:
    runs = [("cthp", one.parameters, 0.2) for one in PUBLISHED]
    runs += [("cthp", LATE, 0.1), *((key, idm(key), 0.2) for key in ("idm", "idm-delay"))]
    asked, expected = [], []
    for model, vehicles, frequency in runs:
        types = sumo_types(tuple("ABCDEFGH"[: len(vehicles.alpha)]), vehicles, model=model)
        headways = vehicles.time_gap(sumo.SPEED).tolist()
        asked.append([types, ids(types), headways, frequency])
        leader = Sinusoid(frequency, 1.0, sumo.SPEED, sumo.SETTLE, sumo.DURATION)
        expected.append(simulate_platoon(vehicles, leader, model=model).amplitudes.measured)
    ran = subprocess.run(
        [sys.executable, str(PROGRAM)], input=json.dumps(asked), capture_output=True, text=True,
        check=True,
    )  # fmt: skip
    found = [json.loads(line) for line in ran.stdout.splitlines() if line.startswith("[")]
    for amplitudes, measured in zip(found, expected, strict=True):
        np.testing.assert_allclose(amplitudes, measured, rtol=0.02)


def test_types_hold_the_parameters_and_every_sample() -> None:
    snapshot = recommended()
    estimate, drawn_from = snapshot.estimate, snapshot.posterior.typical
    root = ElementTree.fromstring(snapshot_types(snapshot, 5))
    singles, mixtures = root.findall("vType"), root.findall("vTypeDistribution")
    assert len(singles) == len(mixtures) == snapshot.info.followers
    for k, (single, mixture) in enumerate(zip(singles, mixtures, strict=True)):
        own = {name: float(single.get(name, "nan")) for name in ("tau", "minGap")}
        gap, speed = estimate.parameters.time_gap(estimate.speeds[k])[k], estimate.speeds[k]
        assert own["tau"] + own["minGap"] / speed == pytest.approx(gap, rel=1e-9)
        gains = [float(single.get(a, "")) for a in ("gapControlGainSpace", "gapControlGainSpeed")]
        np.testing.assert_allclose(gains, estimate.parameters.values[k, :2], rtol=1e-9)
        held = float(single.get("actionStepLength", "0"))
        assert held / 2 == pytest.approx(estimate.parameters.delay[k], abs=0.03)
        # Each is one of the draws, to the digits that the file has.
        drawn = np.array([float(one.get("gapControlGainSpace", "")) for one in mixture])
        assert len(set(drawn)) == 5
        apart = np.abs(drawn_from.alpha[:, [k]] / drawn - 1).min(axis=0)
        assert (apart < 1e-9).all()
        assert sum(float(one.get("probability", "")) for one in mixture) == pytest.approx(1)
    assert not ElementTree.fromstring(snapshot_types(snapshot, 0)).findall("vTypeDistribution")


def test_a_point_has_a_type_and_no_distribution() -> None:
    root = ElementTree.fromstring(snapshot_types(small()))
    (single,) = root.findall("vType")
    assert float(single.get("tau", "")) == pytest.approx(small().parameters.tau[0], rel=1e-9)
    assert not root.findall("vTypeDistribution")


def test_names_become_identifiers_and_an_undetermined_headway_is_refused() -> None:
    odd = Parameters([0.1, 0.1], [0.2, 0.2], [1.0, 1.0])
    assert ids(sumo_types(('<"&> Ä(8)', "日"), odd)) == ["F1_8", "F2_vehicle"]
    with pytest.raises(ParameterError, match="A: τ is undetermined"):
        sumo_types(("A",), Parameters([0.0], [0.2], [np.nan]))


def test_a_card_names_parameters_intervals_and_where_they_come_from() -> None:
    snapshot = recommended()
    card, known, info = parameter_card(snapshot), snapshot.uncertainty, snapshot.info
    for k, vehicle in enumerate(card["vehicles"]):
        ends = [one.tau[k] for one in (snapshot.parameters, known.lower, known.upper)]
        named = zip(("value", "low", "high", "unit"), (*ends, "s"), strict=True)
        assert vehicle["tau"] == dict(named)
        assert card["answer"][k]["parameters"]["tau"] == snapshot.parameters.tau[k]
    assert card["model"]["key"] == snapshot.estimate.model
    assert card["level"] == snapshot.posterior.level
    assert card["provenance"]["sha256"] == info.sha256
    (window,) = card["provenance"]["windows"]
    assert window["duration"] == info.window.duration
    assert "CC BY 4.0" in card["attribution"]


def test_a_card_of_a_point_has_no_intervals() -> None:
    card = parameter_card(small())
    (vehicle,) = card["vehicles"]
    assert vehicle["tau"] == {"value": small().parameters.tau[0], "unit": "s"}
    assert vehicle["probability_l2_stable"] is None
    assert (card["level"], "answer" in card) == (None, False)
    assert "point" in card["about"]
