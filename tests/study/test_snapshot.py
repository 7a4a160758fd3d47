"""The file of a snapshot: every bit kept, and nothing believed that a stranger wrote."""

import io
import os
import platform as machine
import random
import re
import zipfile
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from accpinn.errors import SnapshotError
from accpinn.methods import TaskContext
from accpinn.methods.estimate import Outcome
from accpinn.methods.pinn.config import preset
from accpinn.methods.registry import VARIANTS
from accpinn.model.cthp import Parameters
from accpinn.model.registry import BEST
from accpinn.model.spec import ModelSpec
from accpinn.recordings import Recording
from accpinn.segment import Segment
from accpinn.segment.quality import exclude_regimes, label_regimes
from accpinn.serial import Arrays
from accpinn.study import Analysis, snapshot
from accpinn.study.result import Result, result_of
from accpinn.study.run import estimate, run
from accpinn.study.snapshot import (
    ARRAYS,
    ATTRIBUTION,
    DOCUMENT,
    LARGEST,
    MANIFEST,
    MOST_COMPUTED,
    SCHEMA,
    load,
    prepare_snapshot,
    save,
    to_bytes,
)
from accpinn.study.verification import verify
from accpinn.units import Stretch
from tests.fuzz.campaign import attempt
from tests.fuzz.kinds import Kind
from tests.support.command import loaded_after
from tests.support.driving import MIXED, driven, standing_still
from tests.support.holes import with_holes
from tests.support.snapshots import (
    altered,
    arrays_of,
    asked_of,
    bits,
    crowded,
    lying,
    members,
    put,
    resealed,
    result_for,
    sealed,
    small,
    small_bytes,
    trained,
    two_windows,
    whole,
    zipped,
)

SEALED = small_bytes()


def refused(data: bytes) -> str:
    """The one sentence with which bytes are refused."""
    with pytest.raises(SnapshotError) as fault:
        load(data)
    sentence = str(fault.value)
    assert sentence.endswith(".")
    assert sentence.isprintable()
    assert len(sentence) < 250
    return sentence


def masked() -> Segment:
    segment = driven(duration=60.0)
    far = np.sin(segment.time / 8)[:, None] > 0
    segment = replace(segment, gaps=np.where(far, 2.1, 1.5) * segment.speeds[:, 1:])
    return exclude_regimes(segment, label_regimes(segment), ("catching up",))


def holed() -> Segment:
    return with_holes(driven(), {1: [Stretch(40, 80)], 2: [Stretch(20, 90)]})


def undetermined(method: str, model: str) -> Result:
    """Of vehicles that do not move."""
    still = standing_still(samples=601)
    asked = replace(asked_of(still, method), spec=ModelSpec(model))
    found = estimate(asked, (still,), context=TaskContext(threads=1))
    return result_of(asked, (still,), found)


def without_recording(result: Result) -> Result:
    """As a file has it."""
    compared = tuple(map(without_recording, result.compared))
    return replace(result, recording=None, compared=compared)


class TestRoundTrip:
    @pytest.mark.parametrize("make", [small, whole, two_windows])
    def test_every_bit_is_kept(self, make: Callable[[], Result]) -> None:
        data = to_bytes(make())
        after = load(data)
        assert (make().id, len(after.id)) == ("", 16)
        assert bits(replace(after, digest="")) == bits(without_recording(make()))
        assert to_bytes(after) == data
        assert load(to_bytes(replace(after, note="another"))).digest != after.digest

    @pytest.mark.parametrize(
        "result",
        [
            partial(result_for, masked()),
            partial(result_for, holed(), "pinn"),
            partial(result_for, standing_still()),
            partial(undetermined, "pinn", BEST),
            *(partial(undetermined, "simulation", key) for key in ("fvdm", "idm")),
        ],
    )
    def test_odd_data_and_estimates(self, result: Callable[[], Result]) -> None:
        before = prepare_snapshot(result())
        after = load(to_bytes(before))
        assert bits(replace(after, digest="")) == bits(before)

    def test_every_method_and_preset(self) -> None:
        for method, settings in VARIANTS.values():
            quick = settings and replace(settings, iterations=3)
            before = prepare_snapshot(result_for(driven(MIXED[:2], 30.0), method, quick, "I"))
            assert bits(replace(load(to_bytes(before)), digest="")) == bits(before), method

    def test_what_follows_from_a_file_is_what_followed_from_the_result(self) -> None:
        before, after = two_windows(), load(to_bytes(two_windows()))
        for name in ("parameters", "posterior", "uncertainty", "trust", "findings", "evaluation",
                     "gap_band", "gain_checks", "qualities", "simulated"):  # fmt: skip
            pair = ({"of": getattr(one, name)} for one in (before, after))
            assert len({str(bits(one)) for one in pair}) == 1, name

    def test_it_opens_without_torch(self, tmp_path: Path) -> None:
        path = save(whole(), tmp_path / "whole.accpinn.zip")
        code = f"from accpinn.study.snapshot import load; load({str(path)!r}).parameters"
        assert not loaded_after(code, "torch")

    def test_it_holds_the_windows_data_once_and_says_whose_they_are(self) -> None:
        data = to_bytes(whole())
        kept = [name for name in arrays_of(data) if "segments" in name]
        assert sorted(kept) == ["segments.0.gaps", "segments.0.speeds", "segments.0.time"]
        after = load(data)
        np.testing.assert_array_equal(after.segments[0].speeds, whole().segments[0].speeds)
        assert {row.segments for row in after.compared} == {after.segments}
        assert after.recording is None
        assert b"CC BY 4.0" in members(data)[ATTRIBUTION]
        # Numbers may hold a short name by chance; texts hold what could tell of the machine.
        texts = [t for name, t in members(data).items() if name.endswith((".json", ".txt"))]
        assert len(texts) > 1
        for secret in (machine.node(), str(Path.home())):
            word = rb"(?<!\w)" + re.escape(secret.encode()) + rb"(?!\w)"
            assert not any(re.search(word, text) for text in texts)

    def test_casale(self, casale: Recording, tmp_path: Path) -> None:
        asked = Analysis.of(casale, method="pinn", settings=preset("fast", iterations=60))
        target = save(prepare_snapshot(run(asked, casale)), tmp_path / "casale.accpinn.zip")
        assert target.stat().st_size < 500_000
        assert verify(load(target), casale).ok

    def test_what_cannot_be_kept_is_refused(self) -> None:
        with pytest.raises(SnapshotError, match="diverged"):
            prepare_snapshot(altered(trained(), outcome=Outcome.DIVERGED))
        for name, note in (("x" * 201, ""), ("", "x" * 10_001), (None, ""), ("\ud800", "")):
            with pytest.raises(SnapshotError, match=r"characters long|is no text"):
                prepare_snapshot(trained(), name, note)
        noisy = np.random.default_rng(0).standard_normal((LARGEST // 8, 1))
        with pytest.raises(SnapshotError, match="too large"):
            to_bytes(altered(small(), arrays={"w": noisy}))


class TestPlaces:
    def test_the_old_file_is_replaced_and_a_link_to_it_followed(self, tmp_path: Path) -> None:
        target, link = tmp_path / "a.accpinn.zip", tmp_path / "link"
        link.symlink_to(target)
        for content in (b"", SEALED):
            target.write_bytes(content)
            assert save(whole(), link) == link
            assert load(target).name == "whole"
        assert link.is_symlink()
        assert len([*tmp_path.iterdir()]) == 2

    def test_nothing_else_is_replaced_or_waited_for(self, tmp_path: Path) -> None:
        (tmp_path / "table.csv").write_bytes(b"Time,Speed1")
        (tmp_path / "book.xlsx").write_bytes(b"PK\x03\x04" + bytes(100))
        (tmp_path / "circle").symlink_to("circle")
        if hasattr(os, "mkfifo"):
            os.mkfifo(tmp_path / "pipe")
        before = sorted(path.name for path in tmp_path.iterdir())
        for name in (*before, ".", "x" * 300, "missing/a", "nul\0"):
            with pytest.raises(SnapshotError, match=r"choose another|name a file"):
                save(small(), tmp_path / name)
            with pytest.raises(SnapshotError):
                load(tmp_path / name)
        assert sorted(path.name for path in tmp_path.iterdir()) == before
        assert (tmp_path / "table.csv").read_bytes() == b"Time,Speed1"


@given(st.integers(0, len(SEALED) - 1), st.integers(1, 255))
@example(0, 1)
@example(len(SEALED) - 1, 128)
def test_a_changed_byte_is_refused_or_changes_nothing(at: int, change: int) -> None:
    data = bytearray(SEALED)
    data[at] ^= change
    try:
        after = load(bytes(data))
    except SnapshotError:
        refused(bytes(data))
    else:
        assert bits(replace(after, digest="")) == bits(small())


def with_arrays(**changes: Any) -> bytes:
    return resealed(lambda _, arrays: arrays.update(changes))


def with_npz(*contents: tuple[str, bytes]) -> bytes:
    """The small snapshot with other members among its arrays."""
    return zipped(members(SEALED) | {ARRAYS: zipped(dict(contents))})


def npy(values: np.ndarray, allow_pickle: bool = False) -> bytes:
    buffer = io.BytesIO()
    np.save(buffer, values, allow_pickle=allow_pickle)
    return buffer.getvalue()


def header(shape: str) -> bytes:
    text = f"{{'descr': '<f8', 'fortran_order': False, 'shape': {shape}, }}"
    return b"\x93NUMPY\x01\x00\x76\x00" + f"{text:<117}\n".encode()


def with_text(text: bytes) -> bytes:
    return sealed(text, arrays_of(SEALED))


SPEEDS = "segments.0.speeds"
DRAWS = ("estimate.posterior.typical", "estimate.posterior.further")
HOSTILE: dict[str, Callable[[], bytes]] = {
    "another zip": lambda: zipped({"a.txt": b"a"}),
    "zip bomb": lambda: zipped({DOCUMENT: b"0" * 200_000_000}, zipfile.ZIP_DEFLATED),
    "bomb of arrays": lambda: zipped(
        members(SEALED)
        | {ARRAYS: zipped({"a.npy": npy(np.zeros(20_000_000))}, zipfile.ZIP_DEFLATED)}
    ),
    **{f"a size that is not true, {method}": partial(
        lambda method: lying(
            zipped(members(SEALED) | {DOCUMENT: bytes(200_000_000)}, method), DOCUMENT, 1000
        ),
        method,
    ) for method in (zipfile.ZIP_DEFLATED, zipfile.ZIP_BZIP2)},
    "a crowded directory": lambda: crowded(400_000),
    "a foreign member": lambda: zipped(members(SEALED) | {"run.exe": b"x"}),
    "arrays that nothing names": lambda: with_npz(
        *((f"{name}.npy", npy(values)) for name, values in arrays_of(SEALED).items()),
        *((f"a{k}.npy", npy(np.zeros(1))) for k in range(12_000)),
    ),
    "one such array": lambda: with_arrays(foreign=np.zeros(3)),
    "240,000 draws": lambda: resealed(
        lambda _, arrays: arrays.update(
            {name: np.resize(arrays[name], (240_000, 1, 6)) for name in DRAWS}
        ),
        to_bytes(two_windows()),
    ),
    "too many bytes": lambda: SEALED + bytes(LARGEST),
    "huge document": lambda: with_text(b" " * 3_000_000),
    "pickle": lambda: with_npz(("a.npy", npy(np.array([{"a": 1}], dtype=object), True))),
    "no array": lambda: with_npz(("a.npy", b"x")),
    "text": lambda: with_npz(("a.npy", npy(np.array(["text"])))),
    "records": lambda: with_npz(("a.npy", npy(np.zeros(2, [("a", "f8")])))),
    **{f"shape {shape}": partial(with_npz, ("a.npy", header(shape))) for shape in (
        "(1000000000000,)", "(0, 99999999999999999999)", "(4611686018427387904, 4)", "(-1,)",
        "(1 2)",
    )},
    **{name: partial(with_text, text) for name, text in {
        "nesting": b"[" * 1000 + b"]" * 1000,
        "deep nesting": b"[" * 450_000 + b"]" * 450_000,
        "nested document": b'{"analysis":' * 900 + b"1" + b"}" * 900,
        "unclosed": b"[" * 950_000,
        "digits": b"9" * 900_000,
        "no text": b'"\xff"',
        "number": b"1",
        "nothing": b"",
    }.items()},
    **{f"manifest {text[:12]!r}": partial(lambda text: zipped(members(SEALED) | {MANIFEST: text}),
                                          text)
       for text in (b"[]", b"{}", b'{"format":"other"}', b"x", b"[" * 100_000)},
}  # fmt: skip


@pytest.mark.parametrize("name", HOSTILE)
def test_a_hostile_file_is_refused_quickly_and_cheaply(name: str) -> None:
    limits = {"most_seconds": 1.0, "most_bytes": 300e6}
    loading = Kind(name, random.Random.randbytes, lambda data, _: bool(load(data)), "", **limits)
    assert not attempt(loading, HOSTILE[name]())


@pytest.mark.parametrize(
    ("name", "most"),
    [
        ("MOST_WINDOWS", 1), ("MOST_PAIRS", 1), ("MOST_COMPUTED_IN_ALL", 50), ("MOST_DRAWS", 1),
        ("MOST_DRAWN", 1), ("MAX_FOLLOWERS", 0), ("MOST_PARTS", 0), ("MOST_FINDINGS", 0),
    ],
)  # fmt: skip
def test_more_than_can_be_shown_is_neither_written_nor_read(
    monkeypatch: pytest.MonkeyPatch, name: str, most: int
) -> None:
    result = whole() if name in ("MOST_PARTS", "MOST_FINDINGS") else two_windows()
    data = to_bytes(result)
    assert load(data)
    monkeypatch.setattr(snapshot, name, most)
    for use in (partial(load, data), partial(to_bytes, result)):
        with pytest.raises(SnapshotError, match=f"{most} are the most"):
            use()


LONG = "x" * 500_000
FORGED: list[tuple[str, Any]] = [
    ("name", LONG),
    ("created", 5),
    ("analysis.case", "III"),
    ("analysis.method", "magic"),
    ("analysis.vehicles", [2, 3]),
    ("analysis.windows", []),
    ("analysis.spec.model", "magic"),
    ("analysis.spec.fixed", [["s0", 4.0]]),
    ("infos.0.names.0", LONG),
    ("infos.0.vehicles", [1, 3]),
    ("infos.0.window.end", "inf"),
    ("infos.0.excluded_share", [0.0, 2.0]),
    ("facts", {"acc_flag": []}),
    ("estimate", None),
    ("estimate.method", "magic"),
    ("estimate.case", "I"),
    ("estimate.spec.model", "cthp-s0"),
    ("estimate.numbers", []),
    ("estimate.iterations", -1),
    ("estimate.findings", [{"type": "Other"}]),
    ("estimate.parameters", [[0.1], [0.1, 0.2]]),
    ("estimate.parameters", [[0.1, 0.2, 1.0]] * 2),
    ("estimate.parameters", [[0.1, 0.2, 1.0, 0, 0, 0, 1, 1, 1, 1, 1]]),
    ("estimate.outcome", "__class__"),
    *((f"estimate.parameters.0.{k}", bad) for k in range(3)
      for bad in ("inf", -0.1, None, "x", [], 1e300)),
    ("estimate.windows", []),
    ("estimate.speeds", ["nan"]),
    ("estimate.driven", [[1.0]]),
    ("estimate.curves", [None, None]),
    ("estimate.track", {"time": [0.0], "parameters": [[[1, 1, 1]] * 2], "deviation": None}),
    ("estimate.posterior", {}),
    ("segments", []),
    ("segments.0.speeds", [[20.0, 20.0]] * 3),
    ("recording", {}),
]  # fmt: skip


class TestContents:
    @pytest.mark.parametrize(("place", "value"), FORGED, ids=lambda part: str(part)[:40])
    def test_what_no_run_gives_is_refused(self, place: str, value: Any) -> None:
        assert "refused" in refused(resealed(lambda tree, _: put(tree, place.split("."), value)))

    @pytest.mark.parametrize(
        ("place", "value"),
        [
            ("level", 1.5),
            ("level", "x"),
            ("differ", []),
            ("draws", [1.0, 2.0]),
            ("windows_lower", [[[0.1, 0.1, 1.0]]]),
            ("windows_gap", [[[1.0]]]),
            ("typical", "segments.0.speeds"),
        ],
        ids=str,
    )
    def test_what_no_posterior_has_is_refused(self, place: str, value: Any) -> None:
        def change(tree: Any, _: Arrays) -> None:
            tree["estimate"]["posterior"][place] = value

        assert "refused" in refused(resealed(change, to_bytes(two_windows())))

    @pytest.mark.parametrize(
        "name", ["analysis", "infos", "segments", "estimate", "origin", "created", SPEEDS]
    )
    def test_a_part_or_an_array_that_is_missing(self, name: str) -> None:
        refused(resealed(lambda tree, arrays: (tree if name in tree else arrays).pop(name)))

    @pytest.mark.parametrize(
        "values",
        [
            np.zeros((41, 3)), np.zeros((40, 2)), np.zeros(82), np.zeros((41, 2), bool),
            np.full((41, 2), np.nan), np.full((41, 2), np.inf), np.full((41, 2), 1e300),
            np.array(small().segments[0].speeds) + 1.0,
        ],
    )  # fmt: skip
    def test_data_that_are_not_those_of_the_window(self, values: np.ndarray) -> None:
        refused(with_arrays(**{SPEEDS: values}))

    def test_a_posterior_without_draws_or_with_impossible_ones(self) -> None:
        known = two_windows().posterior
        for draws in (known.typical.everything[:0], -known.typical.everything):
            forged = replace(known, typical=Parameters.of(draws))
            refused(to_bytes(altered(two_windows(), posterior=forged)))

    def test_data_that_would_take_minutes_to_compute_anew(self) -> None:
        count = 1 + MOST_COMPUTED // small().info.followers
        segment = small().segments[0]
        speeds, gaps = (np.broadcast_to(values[:1], (count, values.shape[1]))
                        for values in (segment.speeds, segment.gaps))  # fmt: skip
        segment = replace(segment, time=0.5 * np.arange(count), speeds=speeds, gaps=gaps)
        forged = replace(small(), segments=(segment,), infos=(segment.info,))
        assert "longer than can be computed" in refused(to_bytes(forged))

    @pytest.mark.parametrize("value", [0.0, -1.0])
    def test_a_curve_whose_time_stands_still(self, value: float) -> None:
        (curves,) = whole().curves
        still = replace(curves, time=np.full_like(curves.time, value))
        forged = to_bytes(altered(whole(), curves=(still,)))
        assert "do not follow each other" in refused(forged)

    def test_results_within_results(self) -> None:
        row = replace(small(), compared=(small(),))
        assert "nested" in refused(to_bytes(replace(small(), compared=(row,))))

    def test_what_a_terminal_would_obey_is_not_kept(self) -> None:
        evil = "a\x1b[2J\u202eb\nc"

        def rename(tree: Any, _: Arrays) -> None:
            tree["name"] = tree["note"] = evil
            tree["infos"][0]["names"][1] = tree["segments"][0]["names"][1] = evil

        after = load(resealed(rename))
        shown = "a\ufffd[2J\ufffdb c"
        assert (after.name, after.info.names[1]) == (shown, shown)
        assert after.note == "a\ufffd[2J\ufffdb\nc"

    @pytest.mark.parametrize(
        ("schema", "said"),
        [
            (SCHEMA - 1, "written by an earlier accpinn (schema 9, this one reads 10); learn and"),
            (SCHEMA + 1, "written by a newer accpinn (schema 11, this one reads 10); update accp"),
        ],
    )
    def test_another_schema_is_refused_in_one_sentence(self, schema: int, said: str) -> None:
        """Whatever the file holds: of another schema nothing else is read."""
        assert said in refused(sealed(b"{}", {}, schema))
