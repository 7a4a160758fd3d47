"""The question: equal ones have one key, and whatever determines the answer is part of it."""

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import accpinn
from accpinn.errors import AccpinnError
from accpinn.methods.pinn.config import preset
from accpinn.methods.registry import METHODS
from accpinn.recordings.openacc import read
from accpinn.recordings.recording import Window
from accpinn.serial import dump, flatten, restore
from accpinn.study.analysis import Analysis, differences
from tests.support.samples import FOLDER, NOISY
from tests.support.snapshots import platoon, put

ASKED = Analysis.of(platoon(), [Window(0, 60)], "1-3", excluded=["catching up", "manual"])


def test_equal_questions_have_equal_keys(tmp_path: Path) -> None:
    renamed = tmp_path / "renamed.csv"
    renamed.write_bytes((FOLDER / "synthetic_astazero_like.csv").read_bytes())
    others = (
        Analysis.of(read(renamed), [Window(0, 60)], "1-3", excluded=["catching up", "manual"]),
        Analysis.of(platoon(), [Window(0.0, 60.0)], (1, 2, 3), excluded="manual,catching-up"),
        Analysis.of(platoon(), [Window(0, 60)], np.arange(1, 4), excluded=["manual"] * 2
                    + ["catching up"], settings=preset("fast")),
        Analysis.of(platoon(), [Window(0, 60)], "1-3", excluded=["catching up", "manual"],
                    settings=preset("fast").to_json()),
        restore(Analysis, json.loads(json.dumps(dump(ASKED)[0])), {}),
    )  # fmt: skip
    assert {other.key for other in others} == {ASKED.key}
    assert len(ASKED.key) == 64
    assert others[-1] == ASKED


OTHERS = {"case": "I", "method": "splines"}


def changed(leaf: Any) -> Any:
    if isinstance(leaf, bool):
        return not leaf
    return leaf + 1 if isinstance(leaf, int | float) else f"{leaf}x"


@given(st.data())
def test_whatever_determines_the_answer_changes_the_key(data: st.DataObject) -> None:
    tree = dump(ASKED)[0]
    # Least squares cannot estimate another model than the paper's delay, so none is fitted.
    told = {"source.name", "source.sha256", "source.trajectory", "fitted"}
    places = list(flatten(tree))
    place, leaf = data.draw(st.sampled_from(places))
    put(tree, place.split("."), OTHERS.get(place, changed(leaf)))
    other = restore(Analysis, tree, {})
    assert (other.key == ASKED.key) == (place in told)
    of_answer = place == "model" or place.startswith("held")
    assert (other.fit_key == ASKED.fit_key) == (place in told or of_answer)


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
    assert replace(short, model="cthp").checkpoint_key == short.checkpoint_key
    assert ASKED.checkpoint_key == ASKED.with_method("splines").checkpoint_key == ""


def test_differences_name_what_was_asked_otherwise() -> None:
    assert differences(ASKED, ASKED) == ()
    moved = replace(ASKED, windows=(Window(40.0, 340.0),), case="I", excluded=())
    said = differences(ASKED, moved)
    assert "case: II → I" in said
    assert "window: 0–60 s → 40–340 s" in said
    assert any(one.startswith("excluded") and one.endswith("nothing") for one in said)
    assert differences(ASKED, ASKED.with_method("pinn", preset("fast", seed=3))) == ("seed: 0 → 3",)


@pytest.mark.parametrize(
    ("asked", "words"),
    [
        ({"recording": None}, "recording"),
        ({"start": "0"}, "start"),
        ({"duration": True}, "duration"),
        ({"method": "pinn", "seed": "a"}, "seed"),
        ({"seed": 1.5}, "seed"),
        ({"vehicles": (1.0, 2.0)}, "vehicles"),
        ({"exclude": "lunch"}, "catching-up"),
        ({"windows": "0-60,60-120", "method": "pinn", "preset": "fast"}, "takes one window"),
        ({"windows": "0-60,60-120", "method": "splines"}, "choose one of them"),
        ({"model": "gipps"}, "cthp-s0-delay"),
        ({"model": "cthp", "hold": {"s0": 4.0}}, "no term"),
        ({"hold": {"s0": 400.0}}, "-30 to 60"),
        ({"method": "pinn", "threads": -1}, "threads"),
        ({"method": "pinn", "threads": "2"}, "threads"),
    ],
    ids=str,
)
def test_an_argument_out_of_range_is_named(asked: dict[str, Any], words: str) -> None:
    with pytest.raises(AccpinnError, match=words) as fault:
        accpinn.fit(**{"recording": FOLDER / f"{NOISY}.csv", "method": "splines"} | asked)
    assert str(fault.value).endswith(".")
    assert "\n" not in str(fault.value)
