"""Files that nobody should trust: damaged, forged, or made to exhaust whoever opens them."""

import io
import json
import os
import re
import struct
import subprocess
import sys
import zipfile
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from accpinn.results.snapshot import MANIFEST, TITLES
from accpinn.results.snapshot.archive import (
    load,
    pack,
    pack_arrays,
    seal,
    to_bytes,
    unpack,
    unpack_arrays,
)
from accpinn.results.snapshot.verification import verify
from hypothesis import example, given
from hypothesis import strategies as st

from accpinn.errors import SnapshotError
from tests.support.command import ROOT
from tests.support.snapshots import entries, small, small_bytes

SEALED = small_bytes()


def refused(data: bytes) -> str:
    with pytest.raises(SnapshotError) as fault:
        verify(load(data))
    sentence = str(fault.value)
    assert sentence.endswith(".")
    assert "\n" not in sentence
    return sentence


def parts() -> dict[str, bytes]:
    return entries(SEALED)


def start_of(name: str, content: bytes) -> int:
    return SEALED.index(name.encode() + content) + len(name)


def with_part(name: str, content: bytes) -> bytes:
    """Sealed anew, so that only its content can give it away."""
    return seal(parts() | {name: content})


def with_speeds(values: np.ndarray) -> bytes:
    group = unpack_arrays(parts()["segment.npz"], "data")
    return with_part("segment.npz", pack_arrays(group | {"speeds": values}))


def speeds() -> np.ndarray:
    return np.array(unpack_arrays(parts()["segment.npz"], "data")["speeds"])


def changed_text(name: str, pattern: str, to: str) -> bytes:
    before = parts()[name].decode()
    after = re.sub(pattern, to, before, count=1)
    assert after != before
    return with_part(name, after.encode())


def with_weights(number: float) -> bytes:
    fit = replace(small().fit, arrays={"w": np.full(100, number)})
    return to_bytes(replace(small(), fit=fit))


class TestDamage:
    @given(st.integers(0, len(SEALED) - 1), st.integers(1, 255))
    @example(0, 1)
    @example(len(SEALED) - 1, 128)
    def test_every_changed_byte_is_found(self, at: int, change: int) -> None:
        data = bytearray(SEALED)
        data[at] ^= change
        refused(bytes(data))

    def test_every_byte_outside_the_contents_counts(self) -> None:
        """Those of the zip's own records, which no digest covers; one bit of each."""
        inside = set()
        for name, content in unpack(SEALED, "It").items():
            start = start_of(name, content)
            inside.update(range(start, start + len(content)))
        records = [at for at in range(len(SEALED)) if at not in inside]
        assert 1000 < len(records) < 5000
        for at in records:
            data = bytearray(SEALED)
            data[at] ^= 1 << at % 8
            refused(bytes(data))

    @given(st.integers(0, len(SEALED) - 1))
    def test_a_part_of_a_file_is_refused(self, length: int) -> None:
        refused(SEALED[:length])

    @given(st.binary(min_size=1, max_size=100))
    def test_appended_bytes_are_refused(self, more: bytes) -> None:
        refused(SEALED + more)
        assert "not an accpinn snapshot" in refused(b"Date" + more + SEALED)

    @pytest.mark.parametrize("name", sorted(parts()))
    def test_the_damaged_part_is_named(self, name: str) -> None:
        data = bytearray(SEALED)
        content = parts()[name]
        data[start_of(name, content) + len(content) // 2] ^= 1
        assert f"damaged in {name}" in refused(bytes(data))

    @given(st.binary(max_size=300))
    def test_anything_else_is_refused(self, data: bytes) -> None:
        refused(data)

    @pytest.mark.skipif(sys.platform == "win32", reason="there are no pipes by name")
    def test_a_pipe_is_refused_and_not_waited_for(self, tmp_path: Path) -> None:
        os.mkfifo(tmp_path / "pipe")
        with pytest.raises(SnapshotError, match="this is no file"):
            load(tmp_path / "pipe")

    def test_a_name_with_a_line_break_stays_on_one_line(self) -> None:
        refused(SEALED.replace(b"manifest.json", b"manifest\njson", 1))

    def test_a_part_that_is_no_archive_is_named_as_a_part(self) -> None:
        said = refused(with_part("fit.npz", b"x"))
        assert said.startswith("The part with the estimate is damaged")


def zipped(entries: list[tuple[str, bytes]], method: int = zipfile.ZIP_STORED) -> bytes:
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w", method) as archive:
        for name, content in entries:
            archive.writestr(name, content)
    return buffer.getvalue()


def pickled() -> bytes:
    buffer = io.BytesIO()
    np.save(buffer, np.array([{"a": 1}], dtype=object), allow_pickle=True)
    return with_part("fit.npz", pack({"a.npy": buffer.getvalue()}))


def huge_claim() -> bytes:
    buffer = io.BytesIO()
    np.lib.format.write_array_header_1_0(
        buffer, {"descr": "<f8", "fortran_order": False, "shape": (10**12, 10**6)}
    )
    return with_part("fit.npz", pack({"a.npy": buffer.getvalue()}))


def overlong_claim() -> bytes:
    """Entries that all point at the same bytes, as in overlapping zip bombs."""
    names = list(TITLES)
    data = bytearray(
        pack({name: b"x" * 5_000_000 if k == 0 else b"" for k, name in enumerate(names)})
    )
    for match in list(re.finditer(rb"PK\x01\x02", bytes(data)))[1:]:
        struct.pack_into("<II", data, match.start() + 20, 5_000_000, 5_000_000)
        struct.pack_into("<I", data, match.start() + 42, 0)
    return bytes(data)


FOREIGN = ("../evil.json", "/etc/evil.json", "..\\evil.json", "evil/", "evil.py")
HOSTILE: dict[str, Callable[[], bytes]] = {
    "zip bomb": lambda: zipped([("fit.json", b"0" * 200_000_000)], zipfile.ZIP_DEFLATED),
    "overlapping entries": overlong_claim,
    **{f"part {k}": partial(with_part, name, b"{}") for k, name in enumerate(FOREIGN)},
    "symlink": lambda: SEALED.replace(bytes.fromhex("0000a481"), bytes.fromhex("0000ffa1"), 1),
    "pickle": pickled,
    "10,000 entries": lambda: zipped([(f"{k}.json", b"{}") for k in range(10_000)]),
    "a name twice": lambda: pack({"fit.json": b"{}", "fit.jsoX": b"[]"}).replace(b"jsoX", b"json"),
    "claimed shape": huge_claim,
    **{
        name: partial(with_part, "quality.json", text)
        for name, text in {
            "deep nesting": b"[" * 1000 + b"]" * 1000,
            "very deep nesting": b"[" * 450_000 + b"]" * 450_000,
            "unclosed nesting": b"[" * 950_000,
            "many brackets in strings": b'"' + b"[{" * 450_000 + b'"',
            "unclosed strings": b'"\\' * 450_000,
            "many empty lists": b"[" + b"[]," * 300_000 + b"[]]",
            "a number of a million digits": b"9" * 900_000,
            "a huge part": b" " * 3_000_000,
        }.items()
    },
    "1e999": lambda: changed_text("fit.json", r'"seconds":[\d.e-]+', '"seconds":1e999'),
    "2 to the 70": lambda: changed_text(
        "snapshot.json", r'"samples":\d+', '"samples":1180591620717411303424'
    ),
    "too many bytes": lambda: SEALED + bytes(30_000_000),
    "a huge text": lambda: with_part("ATTRIBUTION.txt", b" " * 23_000_000),
}

SENTENCES = {
    "zip bomb": "compressed",
    "overlapping entries": "overlap",
    **{f"part {k}": "which no snapshot has" for k in range(len(FOREIGN))},
    "pickle": "no plain array",
    "10,000 entries": "10,000 entries",
    "a name twice": "twice",
    "claimed shape": "no plain array",
    "very deep nesting": "nested",
}

MEASURED = """
import json, sys, time
from pathlib import Path
from accpinn.errors import (SnapshotError)
from accpinn.results.snapshot.verification import (verify)
from accpinn.results.snapshot.archive import (load)
def peak():
    [line] = [line for line in open("/proc/self/status") if line.startswith("VmHWM")]
    return int(line.split()[1]) / 1024
found, before = {}, peak()
for path in sorted(Path(sys.argv[1]).iterdir()):
    started = time.process_time()
    try:
        verify(load(path))
        sentence = ""
    except SnapshotError as fault:
        sentence = str(fault)
    found[path.stem] = [sentence, time.process_time() - started]
print(json.dumps([found, peak() - before]))
"""


@pytest.mark.skipif(sys.platform != "linux", reason="peaks of memory are read as Linux has them")
def test_hostile_files_are_refused_quickly_and_cheaply(tmp_path: Path) -> None:
    for name, make in HOSTILE.items():
        (tmp_path / f"{name}.zip").write_bytes(make())
    done = subprocess.run(
        [sys.executable, "-c", MEASURED, str(tmp_path)],
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=True,
        timeout=60,
    )
    found, megabytes = json.loads(done.stdout)
    assert found.keys() == HOSTILE.keys()
    for name, (sentence, seconds) in found.items():
        assert sentence.endswith("."), name
        assert "\n" not in sentence, name
        assert len(sentence.replace(str(tmp_path), "")) < 250, name
        assert SENTENCES.get(name, "") in sentence
        assert seconds < 1, (name, seconds)
    assert megabytes < 200  # beyond what the packages themselves take


NOT_NUMBERS = ['"nan"', '"inf"', "-0.1", "null", '"0.1"', "true", "[]", "NaN", "-Infinity", "1e999"]


IMPOSSIBLE: dict[str, tuple[Callable[[], bytes], str]] = {
    "a follower too many": (
        lambda: changed_text("fit.json", r'"parameters":\[(.*?\])', r'"parameters":[\1,\1'),
        "does not fit the rest",
    ),
    "too few vehicles": (
        lambda: changed_text("snapshot.json", r'"vehicles":\[1,2\]', '"vehicles":[1]'),
        "",
    ),
    "a field too many": (lambda: changed_text("snapshot.json", "^{", '{"a":1,'), '"a"'),
    "a field too few": (lambda: changed_text("fit.json", '"iterations":0,', ""), "fit.iterations"),
    "a field twice": (lambda: changed_text("snapshot.json", "^{", '{"name":"",'), "provenance"),
    "an unknown outcome": (
        lambda: changed_text("fit.json", '"SOLVED"', '"__class__"'),
        "outcome",
    ),
    "spaces between": (lambda: changed_text("fit.json", "$", " "), "not as it was written"),
    "bytes that are no text": (lambda: with_part("fit.json", b'"\xff"'), ""),
    "an array that nothing names": (
        lambda: with_part("fit.npz", pack_arrays({"more": np.zeros(100)})),
        "fit.more",
    ),
    "weights that are nan": (lambda: with_weights(np.nan), "nan or infinite"),
    "weights without end": (lambda: with_weights(np.inf), "nan or infinite"),
    "a speed that is nan": (lambda: with_speeds(speeds() * [1, np.nan]), ""),
    "a speed without end": (lambda: with_speeds(speeds() * [1, np.inf]), ""),
    "data of another window": (lambda: with_speeds(speeds() + 1.0), "not the window"),
    **{
        f"data of {values.shape} {values.dtype}": (partial(with_speeds, values), "")
        for values in (
            np.zeros((41, 3)), np.zeros((40, 2)), np.zeros(82), np.zeros((41, 2), np.float32),
            np.zeros((41, 2), np.bool_),
        )
    },
}  # fmt: skip


class TestContents:
    @pytest.mark.parametrize("what", IMPOSSIBLE)
    def test_what_no_snapshot_holds_is_refused(self, what: str) -> None:
        make, said = IMPOSSIBLE[what]
        assert said in refused(make())

    @pytest.mark.parametrize("number", NOT_NUMBERS)
    @pytest.mark.parametrize("which", range(3))
    def test_parameters_no_vehicle_has(self, which: int, number: str) -> None:
        before = rf'("parameters":\[\[{"[^,]*," * which})[^],]*'
        refused(changed_text("fit.json", before, rf"\g<1>{number}"))

    @pytest.mark.parametrize("number", ["NaN", "Infinity", '"0.5"', "true", "null", "[]", "1e999"])
    def test_what_is_no_number(self, number: str) -> None:
        data = changed_text("quality.json", r'("leader_deviation":)[^,]*', rf"\g<1>{number}")
        assert "quality" in refused(data)

    @pytest.mark.parametrize("manifest", [b"[]", b"{}", b'{"format":"other"}', b"x", b"[" * 10_000])
    def test_a_foreign_manifest(self, manifest: bytes) -> None:
        assert "manifest" in refused(pack({MANIFEST: manifest, **parts()}))

    @pytest.mark.parametrize(
        "values",
        [
            np.asfortranarray(np.arange(6.0).reshape(2, 3)),
            np.array(["text"]),
            np.zeros(2, [("a", "f8")]),
            np.zeros(2, ">f8"),
            np.zeros(2, complex),
            np.zeros(2, np.int64),
        ],
        ids=["order of columns", "text", "records", "big-endian", "complex", "integers"],
    )
    def test_arrays_in_other_forms(self, values: np.ndarray) -> None:
        buffer = io.BytesIO()
        np.lib.format.write_array(buffer, values, version=(1, 0), allow_pickle=False)
        data = with_part("fit.npz", pack({"a.npy": buffer.getvalue()}))
        assert "no plain array" in refused(data)

    def test_a_part_that_is_missing(self) -> None:
        for name in parts():
            kept = {other: content for other, content in parts().items() if other != name}
            refused(seal(kept))
            manifest = unpack(SEALED, "It")[MANIFEST]
            assert f"{name} is missing" in refused(pack({MANIFEST: manifest, **kept}))
