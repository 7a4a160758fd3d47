"""Snapshots as bytes and files: bit for bit, whole or not at all, and nothing else is replaced."""

import json
import os
import platform
import signal
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from accpinn.errors import SnapshotError
from accpinn.methods.fit import Outcome
from accpinn.methods.pinn.config import preset
from accpinn.model.cthp import Case
from accpinn.recordings.openacc import read
from accpinn.results.snapshot.create import create
from accpinn.results.snapshot.file import load, save, to_bytes
from accpinn.results.snapshot.schema import SCHEMA
from accpinn.results.snapshot.verification import verify
from accpinn.segment.cut import cut
from accpinn.segment.quality import exclude_regimes, label_regimes
from tests.support.driving import MIXED, driven
from tests.support.methods import RIVALS as ESTIMATORS
from tests.support.methods import train
from tests.support.samples import FOLDER, NOISY
from tests.support.snapshots import bits, entries, resealed, small, small_bytes, trained, whole

ROOT = Path(__file__).parents[3]

IN_A_FRESH_PROCESS = """
import json, sys
from accpinn.results.snapshot.file import (load)
from accpinn.results.snapshot.verification import (verify)
snapshot = load(sys.argv[1])
result = verify(snapshot)
found = [snapshot.fit.parameters.values.tobytes().hex(), result.ok, "torch" in sys.modules]
print(json.dumps(found))
"""


def assert_opens_without_torch(path: Path, before: object) -> None:
    done = subprocess.run(
        [sys.executable, "-c", IN_A_FRESH_PROCESS, str(path)],
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=True,
    )
    assert json.loads(done.stdout) == [before, True, False]


class TestRoundTrip:
    def test_every_bit_is_kept_and_written_again_alike(self) -> None:
        data = to_bytes(whole())
        after = load(data)
        assert bits(replace(after, digest="")) == bits(whole())
        assert to_bytes(after) == data

    def test_it_has_an_id_once_it_was_packed(self) -> None:
        assert small().id == ""
        assert len(load(small_bytes()).id) == 16

    def test_it_opens_in_a_fresh_process_without_torch(self, tmp_path: Path) -> None:
        path = save(whole(), tmp_path / "whole.accpinn.zip")
        assert_opens_without_torch(path, whole().fit.parameters.values.tobytes().hex())

    def test_the_mask_is_kept(self) -> None:
        segment = cut(read(FOLDER / f"{NOISY}.csv"), 0, 60)
        gaps = segment.gaps / segment.speeds[:, 1:]
        segment = replace(segment, gaps=np.where(gaps > 1.7, 2.1, 1.5) * segment.speeds[:, 1:])
        masked = exclude_regimes(segment, label_regimes(segment), ("catching up",))
        snapshot = load(to_bytes(create(masked, small().fit, with_data=True)))
        assert snapshot.info == masked.info
        assert snapshot.info.excluded_regimes == ("catching up",)
        assert snapshot.segment is not None
        np.testing.assert_array_equal(snapshot.segment.mask, masked.mask)

    def test_without_data_it_has_no_data(self) -> None:
        segment, fit = trained()
        data = to_bytes(create(segment, fit))
        assert "segment.npz" not in entries(data)
        assert load(data).segment is None

    def test_draws_that_methods_share_are_kept_once(self) -> None:
        found = entries(to_bytes(whole()))
        assert len(found["uncertainty.npz"]) > 1000 * 4 * 3 * 8
        assert len(found["methods.npz"]) < len(found["uncertainty.npz"])

    def test_numpy_reads_the_arrays(self, tmp_path: Path) -> None:
        (tmp_path / "fit.npz").write_bytes(entries(to_bytes(whole()))["fit.npz"])
        with np.load(tmp_path / "fit.npz", allow_pickle=False) as arrays:
            weights = whole().fit.arrays["output.weight"]
            np.testing.assert_array_equal(arrays["arrays.output.weight"], weights)

    def test_neither_host_nor_user_is_named(self) -> None:
        text = to_bytes(small())
        for secret in (platform.node(), str(Path.home())):
            assert secret.encode() not in text

    def test_the_attribution_travels_along(self) -> None:
        text = entries(small_bytes())["ATTRIBUTION.txt"].decode()
        assert "CC BY 4.0" in text
        assert "Apostolakis" in text

    @pytest.mark.parametrize("case", ["I", "II"])
    def test_every_method_comes_back_the_same(self, case: Case) -> None:
        segment = driven(MIXED[:2], duration=30.0)
        for name, method in ESTIMATORS.items():
            before = create(segment, method(segment, case), name=name)
            assert bits(replace(load(to_bytes(before)), digest="")) == bits(before)

    @pytest.mark.parametrize("name", ["fast", "paper"])
    def test_every_preset_comes_back_the_same(self, name: str) -> None:
        segment = driven(MIXED[:2], duration=30.0)
        before = create(segment, train(segment, "I", preset(name, iterations=3), threads=1))
        assert bits(replace(load(to_bytes(before)), digest="")) == bits(before)

    def test_casale(self, openacc_dir: Path, tmp_path: Path) -> None:
        recording = read(openacc_dir / "Casale" / "part7.csv")
        segment = cut(recording, 0, 300)
        fit = train(segment, "II", preset("fast", iterations=60), threads=1)
        target = save(create(segment, fit, recording=recording), tmp_path / "casale.accpinn.zip")
        assert target.stat().st_size < 300_000
        assert_opens_without_torch(target, fit.parameters.values.tobytes().hex())
        assert verify(load(target), recording).ok


class TestCreate:
    def test_a_diverged_training_is_refused(self) -> None:
        segment, fit = trained()
        with pytest.raises(SnapshotError, match="diverged"):
            create(segment, replace(fit, outcome=Outcome.DIVERGED))

    def test_a_long_name_is_refused(self) -> None:
        segment, fit = trained()
        with pytest.raises(SnapshotError, match="201 characters"):
            create(segment, fit, name="x" * 201)


def test_a_newer_schema_asks_for_an_update() -> None:
    with pytest.raises(SnapshotError, match=r"newer accpinn.*update"):
        load(resealed(lambda _: None, schema=SCHEMA + 1))
    with pytest.raises(SnapshotError, match="earlier accpinn"):
        load(resealed(lambda _: None, schema=SCHEMA - 1))


KILLED = """
import os, signal, sys
from pathlib import Path
from accpinn.results.snapshot import (file)
moment = sys.argv[2]
before = getattr(os, moment)
def die(*arguments, **options):
    os.kill(os.getpid(), signal.SIGKILL)
setattr(file.os, moment, die)
file.write_whole(b"new" * 100_000, Path(sys.argv[1]), "snapshot")
"""


class TestFile:
    @pytest.mark.parametrize("moment", ["fsync", "replace"])
    def test_a_killed_process_leaves_the_old_file(self, tmp_path: Path, moment: str) -> None:
        target = save(small(), tmp_path / "a.accpinn.zip")
        done = subprocess.run([sys.executable, "-c", KILLED, target, moment], cwd=ROOT, check=False)
        assert done.returncode == -signal.SIGKILL
        assert target.read_bytes() == small_bytes()

    def test_saving_replaces_the_old_file(self, tmp_path: Path) -> None:
        target = tmp_path / "a.accpinn.zip"
        target.write_bytes(to_bytes(whole()))
        save(small(), target)
        assert verify(load(target)).ok
        assert [path.name for path in tmp_path.iterdir()] == [target.name]

    @pytest.mark.skipif(sys.platform == "win32", reason="there is no umask")
    @pytest.mark.parametrize(("mask", "mode"), [(0o077, 0o600), (0o022, 0o644)])
    def test_who_may_read_follows_the_umask(self, tmp_path: Path, mask: int, mode: int) -> None:
        before = os.umask(mask)
        try:
            target = save(small(), tmp_path / "a.accpinn.zip")
        finally:
            os.umask(before)
        assert target.stat().st_mode & 0o777 == mode

    def test_concurrent_saves_of_one_name_leave_a_whole_file(self, tmp_path: Path) -> None:
        target = tmp_path / "a.accpinn.zip"
        code = (
            "import sys\nfrom accpinn.results.snapshot.file import load, save\n"
            "snapshot = load(sys.argv[1])\n"
            "for _ in range(20): save(snapshot, sys.argv[2])\n"
        )
        sources = [tmp_path / "one", tmp_path / "two"]
        for source, name in zip(sources, ("one", "two"), strict=True):
            save(replace(small(), name=name), source)
        running = [
            subprocess.Popen([sys.executable, "-c", code, source, target], cwd=ROOT)
            for source in sources
        ]
        assert [process.wait() for process in running] == [0, 0]
        assert load(target).name in ("one", "two")
        assert all(verify(load(source)).ok for source in sources)

    def test_a_place_that_cannot_be_written_is_named(self, tmp_path: Path) -> None:
        with pytest.raises(SnapshotError, match="could not be written"):
            save(small(), tmp_path / "missing" / "a.accpinn.zip")

    @pytest.mark.parametrize("empty", [False, True])
    def test_a_link_is_followed(self, tmp_path: Path, empty: bool) -> None:
        target, link = tmp_path / "a.accpinn.zip", tmp_path / "link"
        target.write_bytes(b"" if empty else to_bytes(whole()))
        link.symlink_to(target)
        assert save(small(), link) == link
        assert link.is_symlink()
        assert target.read_bytes() == small_bytes()

    def test_nothing_else_is_replaced(self, tmp_path: Path) -> None:
        (tmp_path / "table.csv").write_bytes(b"Time,Speed1")
        (tmp_path / "book.xlsx").write_bytes(b"PK\x03\x04" + bytes(100))
        (tmp_path / "circle").symlink_to("circle")
        os.mkfifo(tmp_path / "pipe")
        names = sorted(path.name for path in tmp_path.iterdir())
        for name in (*names, ".", "x" * 300, "missing/a", "nul\0"):
            with pytest.raises(SnapshotError, match=r"choose another|name a file"):
                save(small(), tmp_path / name)
        assert sorted(path.name for path in tmp_path.iterdir()) == names
        assert (tmp_path / "table.csv").read_bytes() == b"Time,Speed1"
