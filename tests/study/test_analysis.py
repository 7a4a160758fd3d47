"""An analysis: equal ones have one key, others another, and a wrong one a sentence."""

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from accpinn import fit
from accpinn.errors import AccpinnError
from accpinn.methods.pinn.config import CALIBRATED, preset
from accpinn.methods.registry import METHODS, VARIANTS
from accpinn.model.registry import FOLLOWING
from accpinn.model.spec import ModelSpec
from accpinn.recordings import Window
from accpinn.recordings.openacc import read
from accpinn.serial import dump, flatten, restore
from accpinn.study import Analysis, differences
from tests.support.samples import FOLDER, NOISY
from tests.support.snapshots import platoon, put

MINUTE = [Window(0, 60)]
EXCLUDED = ["catching up", "manual"]
ASKED = Analysis.of(
    platoon(), MINUTE, "1-3", excluded=EXCLUDED, method="pinn", settings=preset("fast"),
    model="cthp-s0-delay", fixed={"s0": 4.0},
)  # fmt: skip


def make_analysis(**changes: Any) -> Analysis:
    """The same with other arguments."""
    usual: dict[str, Any] = {
        "windows": MINUTE, "vehicles": "1-3", "excluded": EXCLUDED, "method": "pinn",
        "settings": preset("fast"), "model": "cthp-s0-delay", "fixed": {"s0": 4.0},
    }  # fmt: skip
    return Analysis.of(**{"recording": platoon()} | usual | changes)


def test_equal_questions_have_equal_keys(tmp_path: Path) -> None:
    renamed = tmp_path / "renamed.csv"
    renamed.write_bytes((FOLDER / "synthetic_astazero_like.csv").read_bytes())
    others = (
        make_analysis(recording=read(renamed)),
        make_analysis(
            windows=[Window(0.0, 60.0)], vehicles=(1, 2, 3), excluded="manual,catching-up"
        ),
        make_analysis(vehicles=np.arange(1, 4), excluded=["manual"] * 2 + ["catching up"]),
        make_analysis(settings=preset("fast").to_json(), fixed={"s0": 4}),
        make_analysis(settings={"preset": "fast"} | preset("fast").to_json()),
        restore(Analysis, json.loads(json.dumps(dump(ASKED)[0])), {}),
    )
    assert {other.key for other in others} == {ASKED.key}
    assert len(ASKED.key) == 64
    assert others[-1] == ASKED


MAPPING = {"speeds": [{"column": "a"}, {"column": "b"}], "gaps": [{"column": "c"}]}
OTHERS = {"case": "I", "method": "splines", "source.mapping": MAPPING}


def changed(leaf: Any) -> Any:
    if isinstance(leaf, bool):
        return not leaf
    return leaf + 1 if isinstance(leaf, int | float) else f"{leaf}x"


@given(st.data())
def test_whatever_determines_the_estimate_changes_the_key(data: st.DataObject) -> None:
    tree = dump(ASKED)[0]
    paths = {"source.name", "source.sha256", "source.trajectory", "source.mapping"}
    places = list(flatten(tree))
    place, leaf = data.draw(st.sampled_from(places))
    put(tree, place.split("."), OTHERS.get(place, changed(leaf)))
    other = restore(Analysis, tree, {})
    assert (other.key == ASKED.key) == (place in paths)


def test_a_methods_version_changes_the_key(monkeypatch: pytest.MonkeyPatch) -> None:
    method = replace(METHODS["pinn"], version=METHODS["pinn"].version + 1)
    monkeypatch.setitem(METHODS, "pinn", method)
    assert replace(ASKED).key != ASKED.key


def test_a_longer_training_goes_on_from_a_shorter_ones_checkpoint() -> None:
    short, long, seeded = (
        ASKED.with_method("pinn", preset("paper", **changes))
        for changes in ({"iterations": 10}, {"iterations": 20}, {"seed": 1})
    )
    assert short.checkpoint_key == long.checkpoint_key != seeded.checkpoint_key
    assert short.key != long.key
    assert replace(short, spec=ModelSpec("cthp")).checkpoint_key != short.checkpoint_key
    assert ASKED.checkpoint_key == ASKED.with_method("splines").checkpoint_key == ""


def test_differences_name_what_was_asked_otherwise() -> None:
    assert differences(ASKED, ASKED) == ()
    moved = replace(ASKED, windows=(Window(40.0, 340.0),), case="I", excluded=())
    listed = differences(ASKED, moved)
    assert "case: II → I" in listed
    assert "window: 0–60 s → 40–340 s" in listed
    assert any(text.startswith("excluded") and text.endswith("nothing") for text in listed)
    assert differences(ASKED, ASKED.with_method("pinn", preset("fast", seed=3))) == ("seed: 0 → 3",)
    (model,) = differences(ASKED, replace(ASKED, spec=ModelSpec("idm")))
    assert model.startswith("model: ")
    assert model.endswith(f"s₀ = 4 m → {FOLLOWING['idm'].title}")


@pytest.mark.parametrize(
    ("given", "method", "model"),
    [
        ({}, "pinn", "cthp-s0-delay"),
        *(({"model": key}, "pinn", key) for key, model in FOLLOWING.items() if model.is_linear),
        *(
            ({"model": key}, "simulation", key)
            for key, model in FOLLOWING.items()
            if not model.is_linear
        ),
        *(({"method": key}, key, "cthp") for key in ("least-squares", "splines", "recursive")),
        ({"method": "simulation"}, "simulation", "cthp-s0-delay"),
        ({"method": "maximum-likelihood"}, "pinn", "cthp-s0-delay"),
        ({"method": "pinn", "settings": preset("fast")}, "pinn", "cthp"),
        ({"settings": preset("paper")}, "pinn", "cthp"),
    ],
    ids=str,
)
def test_what_is_not_named_is_recommended(given: dict[str, Any], method: str, model: str) -> None:
    analysis = Analysis.of(platoon(), **given)
    assert (analysis.method, analysis.spec) == (method, ModelSpec(model))
    settings = given.get("settings") or METHODS[method].settings
    assert analysis.settings.get("preset") == (
        settings and getattr(settings, "preset", "calibrated")
    )
    assert analysis.windows == (Window(0.0, 300.0),)
    assert analysis.has_posterior == (analysis.settings.get("preset") == "calibrated"
                                   or method == "simulation")  # fmt: skip


def test_a_usual_model_becomes_that_of_another_method() -> None:
    analysis = Analysis.of(platoon())
    fast = analysis.with_method(*VARIANTS["pinn-fast"])
    assert (analysis.spec.model, fast.spec.model) == ("cthp-s0-delay", "cthp")
    assert fast.with_method("pinn", CALIBRATED).spec == analysis.spec
    assert analysis.with_method("simulation").spec == analysis.spec
    lag = replace(analysis, spec=ModelSpec("cthp-s0-lag"))
    assert lag.with_method(*VARIANTS["pinn-fast"]).spec == lag.spec, "as it was chosen"
    assert lag.with_method("least-squares").spec == ModelSpec("cthp"), "as it cannot have it"


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ({"source": None}, "recording"),
        ({"case": "III"}, "choose I or II"),
        ({"start": "0"}, "start"),
        ({"duration": True}, "duration"),
        ({"method": "magic"}, "magic is not known; choose pinn, least-squares"),
        ({"method": "pinn", "seed": "a"}, "seed"),
        ({"seed": 1.5}, "seed"),
        ({"method": "splines", "preset": "fast"}, "preset: the method splines has none"),
        ({"method": "maximum-likelihood", "preset": "fast"}, "means pinn with the preset calibr"),
        ({"method": "pinn", "settings": {"speed": 1}}, "speed is not known; choose from preset"),
        ({"vehicles": (1.0, 2.0)}, "vehicles"),
        ({"exclude": "lunch"}, "catching-up"),
        ({"windows": []}, "windows"),
        ({"windows": "0-60", "start": 0}, "start: the windows say where they lie"),
        ({"windows": "0-60,30-90"}, "0–60 s and 30–90 s overlap"),
        ({"model": "gipps"}, "cthp-s0-delay"),
        ({"method": "pinn", "preset": "calibrated", "model": "idm"}, "For idm choose the method"),
        ({"model": "cthp-s0-lag"}, "splines cannot estimate cthp-s0-lag"),
        ({"model": "cthp", "fixed": {"s0": 4.0}}, "s0 cannot be fixed; cthp has no parameter to"),
        (
            {"method": "pinn", "model": "cthp-s0-lag", "fixed": {"delay": 0.5}},
            "delay cannot .* has s0, lag to fix",
        ),
        ({"model": "cthp-s0", "fixed": {"alpha": 0.1}}, "alpha cannot be .* has s0 to fix"),
        ({"model": "cthp-s0", "fixed": {"s0": 400.0}}, "-30 to 60"),
        ({"model": "cthp-s0", "fixed": {"s0": np.nan}}, "s0 = nan is not allowed; choose -30 to"),
        ({"method": "pinn", "threads": -1}, "threads"),
        ({"method": "pinn", "threads": "2"}, "threads"),
    ],
    ids=str,
)
def test_an_argument_out_of_range_is_named(arguments: dict[str, Any], words: str) -> None:
    with pytest.raises(AccpinnError, match=words) as fault:
        fit(**{"source": FOLDER / f"{NOISY}.csv", "method": "splines"} | arguments)
    assert str(fault.value).endswith(".")
    assert "\n" not in str(fault.value)
