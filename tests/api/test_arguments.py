"""A wrong argument of a public function ends as one `AccpinnError`."""

from collections.abc import Callable, Iterator
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

import accpinn
from accpinn import AccpinnError, Parameters
from accpinn.methods.registry import METHODS
from accpinn.model.registry import FOLLOWING
from accpinn.study import batch as batch_room
from tests.support.studies import row, rows

OTHERS = {"download", "catalogue"}
"""Functions that need the network, or no argument."""


@cache
def recording() -> accpinn.Recording:
    return accpinn.sample("paper_study")


@cache
def segment() -> accpinn.Segment:
    return accpinn.cut(recording(), 0, 60)


@cache
def result() -> accpinn.Result:
    return accpinn.fit(segment(), method="splines")


@cache
def uncertain() -> accpinn.Result:
    return accpinn.fit(segment())


CAR = Parameters([0.08], [0.3], [1.2])


@cache
def calls() -> dict[str, tuple[Callable[..., Any], dict[str, Any]]]:
    """Each function by its name, with arguments that it allows."""
    request = {"source": segment(), "method": "splines"}
    report = accpinn.stability_report(CAR)
    cars = accpinn.ParameterSet("given", ("A car",), CAR)
    regimes = accpinn.label_regimes(segment())
    fast = accpinn.analyse(segment(), preset="fast")
    usual: dict[str, dict[str, Any]] = {
        "analyse": {"data": segment(), "method": "splines"},
        "assess_quality": {"segment": segment()},
        "batch": {"sources": "nowhere", "study": "study"},
        "compare": {"source": segment(), "methods": ("splines",)},
        "cut": {"recording": recording(), "start": 0, "duration": 60},
        "evaluate": {"segments": segment(), "estimate": result().estimate},
        "exclude_regimes": {"segment": segment(), "regimes": regimes, "names": "standstill"},
        "fit": request,
        "from_arrays": {
            "time": segment().time,
            "speeds": segment().speeds,
            "gaps": segment().gaps,
        },
        "from_frame": {
            "frame": pd.DataFrame(
                {
                    "t": segment().time,
                    "a": segment().speeds[:, 0],
                    "b": segment().speeds[:, 1],
                    "p": segment().gaps[:, 0],
                }
            ),
            "time": "t",
            "speeds": ["a", "b"],
            "gaps": ["p"],
        },
        "gap_band": {
            "segment": segment(),
            "estimate": uncertain().estimate,
            "uncertainty": uncertain().uncertainty,
        },
        "group": {"rows": rows(row("Audi", start=0.0))},
        "judge": {"source": recording(), "models": ("cthp",), "windows": [(0, 20), (20, 40)]},
        "label_regimes": {"segment": segment()},
        "load": {"content": b""},
        "measured_gain": {"segment": segment(), "follower": 0},
        "messages": {"findings": result().findings, "about": result().info},
        "methods_table": {"results": [result()], "follower": 0},
        "model_forms": {"segment": segment()},
        "models_table": {"judgements": accpinn.Judgements(())},
        "pairs_table": {"judgements": accpinn.Judgements(())},
        "next_drive": {"result": result()},
        "parameter_card": {"snapshot": result()},
        "parameter_table": {"description": result()},
        "preset": {"name": "fast"},
        "read": {"source": accpinn.sample_path("paper_study")},
        "read_study": {"study": "study"},
        "register_method": {"method": METHODS["splines"]},
        "register_model": {"model": FOLLOWING["idm"]},
        "render_report": {"snapshot": result(), "with_curves": False},
        "report": {"result": result(), "path": "car.html"},
        "run": {"analysis": result().analysis, "recording": None, "segments": (segment(),)},
        "sample": {"name": "paper_study"},
        "sample_path": {"name": "paper_study"},
        "save": {"result": result(), "path": "car.accpinn.zip"},
        "simulate_platoon": {"parameters": CAR, "leader": accpinn.SpeedStep(duration=30)},
        "spread_of": {"results": [result()]},
        "stability_report": {"parameters": CAR},
        "stability_table": {"vehicles": cars, "report": report},
        "starts": {"analysis": fast},
        "sumo_types": {"names": ("A car",), "parameters": CAR},
        "transfer_function": {"parameters": CAR},
        "verify": {"content": b""},
        "what_if": {"parameters": CAR, "feedforward": 0.5},
    }
    functions = {name: getattr(accpinn, name) for name in usual}
    by_name = {name: (function, usual[name]) for name, function in functions.items()}
    of_classes: dict[str, tuple[Callable[..., Any], dict[str, Any]]] = {
        "Parameters": (Parameters, {"alpha": 0.1, "beta": 0.2, "tau": 1.0}),
        "Parameters.of": (Parameters.of, {"values": [0.1, 0.2, 1.0]}),
        "Recorded": (accpinn.Recorded, {"time": [0, 1], "speeds": [20, 20]}),
        "Sinusoid": (accpinn.Sinusoid, {}),
        "SpeedStep": (accpinn.SpeedStep, {}),
        "Brake": (accpinn.Brake, {}),
        "Store": (accpinn.Store, {}),
        "Library": (accpinn.Library, {}),
        "PinnConfig": (accpinn.PinnConfig, {}),
        "ModelSpec.of": (accpinn.ModelSpec.of, {"model": "cthp"}),
        "Analysis.of": (accpinn.Analysis.of, {"recording": recording()}),
        "Result.to_frame": (result().to_frame, {}),
        "Result.measured_growth": (result().measured_growth, {}),
        "Result.frequency_response": (result().frequency_response, {"omega": [0.1]}),
        "Result.what_if": (result().what_if, {"time_gap": 0.2}),
        "Result.with_data": (result().with_data, {"recording": recording()}),
        "Estimate.span": (result().estimate.span, {"name": "alpha", "follower": 0}),
        "Estimate.time_gap": (result().estimate.time_gap, {"speed": 20.0, "follower": 0}),
    }
    return by_name | of_classes


WRONG: dict[str, Any] = {
    "None": None, "True": True, "3": 3, "-1": -1, "1.5": 1.5, "nan": float("nan"),
    "inf": float("inf"), "text": "text", "no text": "", "bytes": b"raw", "()": (),
    "a pair": (0, 100), "mixed": [1, "a"], "a dict": {"s0": "4"}, "an object": object(),
    "a function": len, "a class": int, "a path": Path("nowhere"), "a set": {1, 2},
    "a number of numpy": np.int64(7), "a frame": pd.DataFrame({"a": [1]}),
    "a car": CAR, "cars": Parameters([[0.1, 0.2]], [[0.1, 0.2]], [[1.0, 1.0]]),
    "a complex number": 1j,
}  # fmt: skip


def arguments(function: Callable[..., Any]) -> list[str]:
    import inspect

    kinds = inspect.signature(function).parameters.values()
    return [part.name for part in kinds if part.kind not in (part.VAR_KEYWORD, part.VAR_POSITIONAL)]


def called(name: str, argument: str, value: Any) -> str:
    """Call a function with one wrong argument; returns what it refuses it by."""
    function, usual = calls()[name]
    try:
        got = function(**usual | {argument: value})
        if isinstance(got, Iterator):
            next(got, None)
    except AccpinnError as fault:
        return str(fault)
    return ""


@pytest.fixture
def _harmless(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, registries: None) -> None:
    """Calls that happen to be allowed leave nothing behind."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(batch_room, "run_request", lambda *_: None)


def test_every_public_function_is_called_here() -> None:
    functions = {
        name
        for name in accpinn.__all__
        if getattr(getattr(accpinn, name), "__name__", "") == name
        and not isinstance(getattr(accpinn, name), type)
    }
    assert functions - OTHERS == {name for name in calls() if name[0].islower()}


shapes = st.lists(st.integers(0, 3), max_size=3).map(lambda shape: np.ones(shape))
wrong = st.sampled_from(list(WRONG.values())) | shapes


@pytest.mark.usefixtures("_harmless")
@settings(
    max_examples=400, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture]
)
@given(data=st.data())
def test_a_wrong_argument_ends_as_one_sentence(data: st.DataObject) -> None:
    name = data.draw(st.sampled_from(sorted(calls())))
    argument = data.draw(st.sampled_from(arguments(calls()[name][0])))
    sentence = called(name, argument, data.draw(wrong))
    assert "\n" not in sentence
    assert len(sentence) <= 300
    assert sentence == "" or sentence.endswith((".", '."'))


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("time", np.zeros(40)), ("time", np.arange(39) * 0.1), ("speed", np.zeros(40)),
        ("speed", np.zeros((40, 1))), ("gap", np.zeros((40, 2))), ("mode", np.zeros((40, 3))),
        ("speed", "fast"), ("time", [None] * 40),
    ],
)  # fmt: skip
def test_a_recording_of_shapes_that_do_not_fit_is_refused(name: str, value: Any) -> None:
    arrays = {
        "time": np.arange(40) * 0.1, "speed": np.full((40, 2), 20.0),
        "gap": np.full((40, 1), 30.0), "mode": np.zeros((40, 2), np.int8),
    }  # fmt: skip
    about: dict[str, Any] = {"source": "mine", "sha256": "", "names": {}}
    assert accpinn.Recording(**about, **arrays).duration == pytest.approx(3.9)
    with pytest.raises(AccpinnError, match="Recording"):
        accpinn.Recording(**about, **arrays | {name: value})
