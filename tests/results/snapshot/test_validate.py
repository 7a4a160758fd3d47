"""Snapshots whole to the last digest that say what none does: refused in one sentence, no crash."""

from dataclasses import fields, is_dataclass, replace
from typing import Any, get_args, get_type_hints

import numpy as np
import pytest
from accpinn.results.snapshot import Snapshot
from accpinn.results.snapshot.archive import load, pack, seal, to_bytes
from accpinn.results.snapshot.validate import MOST_COMPUTED, SHAPES

from accpinn.errors import SnapshotError
from tests.support.snapshots import entries, put, resealed, small, small_bytes, whole

LONG = "x" * 500_000

MISSING = {"type": "BlocksMissing", "columns": ["Speed2"], "share": 0.5,
           "windows": [{"start": 1.0, "end": 2.0}]}  # fmt: skip

FORGED: list[tuple[str, Any, str]] = [
    ("snapshot.json/name", LONG, "500,000 characters|length <= "),
    ("snapshot.json/note", LONG, "500,000 characters|length <= "),
    ("snapshot.json/created", "today", "created"),
    ("snapshot.json/info/source", LONG, "500,000 characters|length <= "),
    ("snapshot.json/info/names/0", LONG, "500,000 characters|length <= "),
    ("snapshot.json/info/vehicles", [1, 3], "consecutive"),
    ("snapshot.json/info/vehicles", [0, 1], "consecutive"),
    ("snapshot.json/info/sha256", "abc", "SHA-256"),
    ("snapshot.json/info/window/end", "inf", "no length"),
    ("snapshot.json/info/excluded_share", [2.0], "share"),
    ("snapshot.json/info/findings", [MISSING | {"share": 2.0}], "share"),
    ("snapshot.json/info/findings", [MISSING | {"columns": []}], "missing nowhere"),
    ("snapshot.json/info/findings", [MISSING | {"windows": []}], "missing nowhere"),
    ("snapshot.json/info/findings", [MISSING], "not the window"),
    ("snapshot.json/facts", {"acc_flag": []}, "acc_flag"),
    ("snapshot.json/facts", {"acc_flag": {}}, "acc_flag"),
    ("snapshot.json/facts", {"campaign": 5}, "campaign"),
    ("snapshot.json/facts", {"host": "a"}, "host"),
    ("fit.json/method", "magic", "not known"),
    ("fit.json/iterations", -1, "negative"),
    ("fit.json/parameters/0/0", 1e308, "beyond 1e"),
    ("fit.json/parameters/0/2", 1e308, "beyond 1e"),
    ("stability.json/vehicles/0/peak/gain", -1.0, "peak"),
    ("stability.json/vehicles/0/peak/gain", "nan", "peak"),
    ("stability.json/vehicles/0/peak/omega", "inf", "peak"),
    ("stability.json/vehicles/0/linf_exact/value", -1.0, "negative"),
    ("stability.json/vehicles/0/crossover", -1.0, "crossover"),
    ("uncertainty.json/level", 1.5, "level"),
    ("uncertainty.json/probability_l2/0", 1.5, "probability"),
    ("uncertainty.json/peak_gain/lower/0", -1.0, "negative"),
    ("uncertainty.json/linf_gain/lower/0", 1e9, "upside down"),
    ("uncertainty.json/lower/0/0", 1e9, "upside down"),
    ("quality.json/leader_deviation", 1e300, "beyond"),
]


def forged(place: str, value: Any) -> bytes:
    """The small snapshot with another value at a place, sealed anew."""
    return resealed(lambda trees: put(trees, place.split("/"), value))


@pytest.mark.parametrize(("place", "value", "said"), FORGED)
def test_what_no_snapshot_says_is_refused(place: str, value: Any, said: str) -> None:
    with pytest.raises(SnapshotError, match=said) as fault:
        load(forged(place, value))
    assert str(fault.value).endswith(".")
    assert len(str(fault.value)) < 300


def test_data_that_would_take_minutes_to_compute_anew_are_refused() -> None:
    one = small()
    count = 1 + MOST_COMPUTED // one.info.followers
    speeds, gaps = (
        np.broadcast_to(values[:1], (count, values.shape[1]))
        for values in (one.segment.speeds, one.segment.gaps)
    )
    segment = replace(one.segment, time=0.5 * np.arange(count), speeds=speeds, gaps=gaps)
    data = to_bytes(replace(one, segment=segment, info=segment.info))
    with pytest.raises(SnapshotError, match="longer than can be computed"):
        load(data)


def test_data_without_steps_of_time_are_refused() -> None:
    one = small()
    segment = replace(one.segment, time=1e-12 * np.arange(one.segment.samples))
    with pytest.raises(SnapshotError, match="not the window"):
        load(to_bytes(replace(one, segment=segment)))


def with_member(name: str, header: str) -> bytes:
    """The small snapshot with an empty array of that name and header among the weights."""
    text = f"{header:<117}\n".encode()
    member = b"\x93NUMPY\x01\x00" + len(text).to_bytes(2, "little") + text
    return seal(entries(small_bytes()) | {"fit.npz": pack({name: member})})


@pytest.mark.parametrize(
    "shape",
    [
        "(1 2)", "(,)", "(0,, 1)", "(0, 99999999999999999999)", "(4611686018427387904, 4, 0)",
        "(0, 9223372036854775807)", "(0, 9999999999999999999)", "(00,)",
    ],
)  # fmt: skip
def test_a_shape_that_numpy_would_not_write_is_refused(shape: str) -> None:
    header = f"{{'descr': '<f8', 'fortran_order': False, 'shape': {shape}, }}"
    with pytest.raises(SnapshotError, match="the estimate"):
        load(with_member("a.npy", header))


@pytest.mark.parametrize(
    "name", ["a", "../a.npy", "/a.npy", ".npy", "a b.npy", "a\x1b[2J.npy", "a..npy"]
)
def test_a_member_whose_name_could_be_a_path_or_a_command_is_refused(name: str) -> None:
    with pytest.raises(SnapshotError, match="is no name"):
        load(with_member(name, "{'descr': '<f8', 'fortran_order': False, 'shape': (0,), }"))


@pytest.mark.parametrize("value", [0.0, -1.0, 5.0])
def test_a_curve_whose_time_stands_still_is_refused(value: float) -> None:
    fit = whole().fit
    still = replace(fit.surrogate, time=np.full_like(fit.surrogate.time, value))
    with pytest.raises(SnapshotError, match="do not follow each other"):
        load(to_bytes(replace(whole(), fit=replace(fit, surrogate=still))))


def test_what_a_terminal_would_obey_is_not_kept() -> None:
    evil = "a\x1b[2J\u202eb\nc"
    assert load(forged("snapshot.json/name", evil)).name == "a\ufffd[2J\ufffdb c"
    assert load(forged("snapshot.json/note", evil)).note == "a\ufffd[2J\ufffdb\nc"

    def rename(trees: dict[str, Any]) -> None:
        for holder in (trees["snapshot.json"]["info"], trees["segment.json"]):
            holder["names"][1] = evil

    assert load(resealed(rename)).info.names[1] == "a\ufffd[2J\ufffdb c"


def test_every_array_of_a_snapshot_has_a_known_shape() -> None:
    """What is not in the table is not checked, so a field that is added must be added there."""
    known, reached, kinds = set(SHAPES), set[str](), set[type]()

    def walk(kind: Any) -> None:
        if isinstance(kind, type) and is_dataclass(kind) and kind not in kinds:
            kinds.add(kind)
            hints = get_type_hints(kind)
            for field in fields(kind):
                places = {f"{owner.__name__}.{field.name}" for owner in kind.__mro__}
                reached.update(places)
                if any(word in str(hints[field.name]) for word in ("ndarray", "Parameters")):
                    assert places & known, places
                walk(hints[field.name])
        for part in get_args(kind):
            walk(part)

    walk(Snapshot)
    assert known <= reached
