import json
import os
import platform
import signal
import subprocess
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from accpinn.cli import main
from accpinn.errors import SnapshotError
from accpinn.evaluation.cross_validation import pooled_holdout_errors
from accpinn.methods.fit import Outcome
from accpinn.methods.pinn.config import preset
from accpinn.methods.pinn.training import train
from accpinn.model.cthp import Case, Parameters
from accpinn.recordings.openacc import read
from accpinn.results.snapshot.archive import contents
from accpinn.results.snapshot.checking import REFIT, check, verify
from accpinn.results.snapshot.codec import encode
from accpinn.results.snapshot.content import Snapshot
from accpinn.results.snapshot.create import create
from accpinn.results.snapshot.file import load, save, sealed, to_bytes
from accpinn.results.snapshot.schema import ATTRIBUTION, MANIFEST, PARTS, SCHEMA
from accpinn.segment.cut import cut
from accpinn.segment.regimes import exclude_regimes, label_regimes
from tests.driving import MIXED, driven, standing_still
from tests.snapshots import resealed, small, small_bytes, trained, whole
from tests.support.methods import RIVALS as ESTIMATORS
from tests.support.samples import FOLDER, NOISY

ROOT = Path(__file__).parent.parent

IN_A_FRESH_PROCESS = """
import json, sys
from accpinn.results.snapshot.checking import (check)
from accpinn.results.snapshot.file import (load)
snapshot = load(sys.argv[1])
laws = [[p.alpha.hex(), p.beta.hex(), p.tau.hex()] for p in snapshot.fit.parameters]
result = check(snapshot)
print(json.dumps([laws, result.ok, len(result.checks), "torch" in sys.modules]))
"""


def reopened(path: Path) -> list[Any]:
    done = subprocess.run(
        [sys.executable, "-c", IN_A_FRESH_PROCESS, str(path)],
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=True,
    )
    found: list[Any] = json.loads(done.stdout)
    return found


class TestRoundTrip:
    def test_keeps_every_bit(self) -> None:
        before, after = whole(), load(to_bytes(whole()))
        assert after.fit.parameters == before.fit.parameters
        assert encode(replace(after, digest="")) == encode(replace(before, digest=""))
        for name, values in before.fit.arrays.items():
            assert values.dtype == after.fit.arrays[name].dtype
            np.testing.assert_array_equal(values, after.fit.arrays[name])

    def test_written_again_it_is_the_same_file(self) -> None:
        data = to_bytes(whole())
        assert to_bytes(load(data)) == data

    def test_has_an_id_once_it_was_packed(self) -> None:
        assert small().id == ""
        assert len(load(small_bytes()).id) == 16

    def test_opens_in_a_fresh_process_without_torch(self, tmp_path: Path) -> None:
        path = save(whole(), tmp_path / "whole.accpinn.zip")
        laws, ok, checks, torch = reopened(path)
        assert laws == [[p.alpha.hex(), p.beta.hex(), p.tau.hex()] for p in whole().fit.parameters]
        assert ok
        assert checks == 20
        assert not torch

    def test_keeps_what_was_left_out(self) -> None:
        recording = read(FOLDER / f"{NOISY}.csv")
        segment = cut(recording, 0, 60)
        gaps = segment.gaps / segment.speeds[:, 1:]
        segment = replace(segment, gaps=np.where(gaps > 1.7, 2.1, 1.5) * segment.speeds[:, 1:])
        masked = exclude_regimes(segment, label_regimes(segment), ("catching up",))
        snapshot = load(to_bytes(create(masked, small().fit, with_data=True)))
        assert snapshot.info.excluded_regimes == ("catching up",)
        assert snapshot.segment is not None
        np.testing.assert_array_equal(snapshot.segment.left_out, masked.left_out)
        assert snapshot.info.excluded_share == masked.excluded_share

    def test_without_data_has_no_data(self) -> None:
        segment, fit = trained()
        data = to_bytes(create(segment, fit))
        assert "data.npz" not in contents(data, "It", len(PARTS))
        assert load(data).segment is None
        assert len(data) < 1_000_000

    def test_numpy_reads_the_arrays(self, tmp_path: Path) -> None:
        parts = contents(to_bytes(whole()), "It", len(PARTS))
        (tmp_path / "weights.npz").write_bytes(parts["weights.npz"])
        with np.load(tmp_path / "weights.npz", allow_pickle=False) as weights:
            assert set(weights.files) == set(whole().fit.arrays)

    def test_names_neither_host_nor_user(self) -> None:
        text = to_bytes(small())
        for secret in (platform.node(), str(Path.home())):
            assert secret.encode() not in text

    def test_attribution_travels_along(self) -> None:
        text = contents(small_bytes(), "It", len(PARTS))["ATTRIBUTION.txt"].decode()
        assert "CC BY 4.0" in text
        assert "Apostolakis" in text


def test_casale_round_trip(openacc_dir: Path, tmp_path: Path) -> None:
    recording = read(openacc_dir / "Casale" / "part7.csv")
    segment = cut(recording, 0, 300)
    fit = train(segment, "II", preset("fast", iterations=60), threads=1)
    target = save(create(segment, fit, recording=recording), tmp_path / "casale.accpinn.zip")
    assert target.stat().st_size < 1_000_000
    laws, ok, _, _ = reopened(target)
    assert laws == [[p.alpha.hex(), p.beta.hex(), p.tau.hex()] for p in fit.parameters]
    assert ok
    assert verify(target, recording).ok
    assert len(verify(target, recording).checks) == 13


class TestVerification:
    def test_all_that_can_be_computed_agrees(self) -> None:
        result = verify(to_bytes(whole()))
        assert result.ok
        assert {c.name for c in result.checks} >= {"Contents", "Surrogate fit", "Data's quality"}

    def test_forged_stability_is_found(self) -> None:
        other = create(whole().segment or trained()[0], trained()[1]).stability
        assert other is not None
        vehicles = (replace(other.vehicles[0], linf_gain=1.0), *other.vehicles[1:])
        forged = replace(whole(), stability=replace(other, vehicles=vehicles))
        result = verify(to_bytes(forged))
        assert not result.ok
        assert "linf_gain" in result.sentence

    def test_forged_parameters_are_found(self) -> None:
        laws = small().fit.parameters
        laws = tuple(replace(law, tau=law.tau * (1 + 1e-7)) for law in laws)
        result = check(replace(small(), fit=replace(small().fit, parameters=laws)))
        assert not result.ok

    @pytest.mark.parametrize("figure", ["lower", "draws", "probability_l2"])
    def test_forged_intervals_are_found(self, figure: str) -> None:
        uncertainty = small().uncertainty
        assert uncertainty is not None
        forged = replace(uncertainty, **{figure: getattr(uncertainty, figure) * 1.001 + 0.001})
        result = check(replace(small(), uncertainty=forged))
        assert not result.ok
        assert result.sentence.startswith("Intervals: ")
        assert figure in result.sentence

    def test_intervals_of_another_method_are_not_called_wrong(self) -> None:
        assert small().uncertainty is not None
        older = replace(small().uncertainty, method="an older one", lower=np.zeros((1, 3)))
        origin = replace(small().origin, accpinn="0.0.1")
        result = check(replace(small(), uncertainty=older, origin=origin))
        assert result.ok
        assert any("an older one" in one.sentence for one in result.checks)
        assert not check(replace(small(), uncertainty=older)).ok, "this version has no other"

    def test_forged_errors_of_a_method_compared_are_found(self) -> None:
        first, *others = whole().rows
        errors = first.evaluation.closed_loop
        assert errors is not None
        better = replace(first.evaluation, closed_loop=replace(errors, gap_mae=errors.gap_mae / 2))
        forged = replace(whole(), rows=(replace(first, evaluation=better), *others))
        result = check(forged)
        assert not result.ok
        assert "Least squares" in result.sentence

    def test_forged_errors_on_the_rest_are_found_with_the_recording(self) -> None:
        recording = read(FOLDER / f"{whole().info.source}")
        segment, fit = trained()
        honest = create(segment, fit, recording=recording)
        assert check(honest, recording).ok
        assert honest.evaluation is not None
        errors = honest.evaluation.unseen
        assert errors is not None
        better = replace(errors, gap_mae=errors.gap_mae / 2)
        forged = replace(honest, evaluation=replace(honest.evaluation, unseen=better))
        assert not check(forged, recording).ok

    def test_another_recording_is_refused(self) -> None:
        recording = read(FOLDER / f"{NOISY}.csv")
        result = check(replace(whole(), segment=None), recording)
        assert not result.ok
        assert "not the recording" in result.sentence

    def test_the_recording_stands_in_for_missing_data(self) -> None:
        recording = read(FOLDER / f"{whole().info.source}")
        result = check(replace(whole(), segment=None), recording)
        assert result.ok
        assert "Window" in {c.name for c in result.checks}

    def test_without_data_it_says_what_is_needed(self) -> None:
        result = check(replace(whole(), segment=None))
        assert result.ok
        assert whole().info.sha256 in result.sentence

    def test_a_removed_part_is_found(self) -> None:
        for name in ("evaluation", "uncertainty"):
            result = check(replace(small(), **{name: None}))
            assert not result.ok
            assert "missing" in result.sentence

    def test_a_removed_error_on_blocks_held_out_is_found(self) -> None:
        first, *others = whole().rows
        bare = replace(first, evaluation=replace(first.evaluation, held_out=None))
        result = check(replace(whole(), rows=(bare, *others)))
        assert result.sentence.startswith("Held out, Least squares: ")

    def test_weights_that_give_other_curves_are_found(self) -> None:
        fit = whole().fit
        zero = {name: np.zeros_like(values) for name, values in fit.arrays.items()}
        for arrays in (zero, {}):
            result = check(replace(whole(), fit=replace(fit, arrays=arrays), segment=None))
            assert result.sentence.startswith("Network's curves: ")

    def test_replaced_sentences_are_found_but_not_those_of_other_versions(self) -> None:
        quality = replace(small().quality, warnings=("All is well.",))
        stability = small().stability
        assert stability is not None
        [vehicle] = stability.vehicles
        calm = replace(vehicle, l2=replace(vehicle.l2, reason="All is well."))
        for change in ({"quality": quality}, {"stability": replace(stability, vehicles=(calm,))}):
            forged = replace(small(), **change)
            assert "All is well." in check(forged).sentence
            older = check(replace(forged, origin=replace(small().origin, accpinn="0.0.9")))
            assert older.ok
            assert "its sentences, as accpinn 0.0.9 wrote them" in older.sentence

    def test_a_replaced_attribution_is_found(self) -> None:
        entries = contents(small_bytes(), "It", len(PARTS))
        del entries[MANIFEST]
        forged = verify(sealed(entries | {ATTRIBUTION: b"All mine."}, SCHEMA))
        assert forged.sentence.startswith("Attribution: ")

    def test_names_that_the_recording_does_not_have_are_found(self) -> None:
        recording = read(FOLDER / f"{whole().info.source}")
        info = replace(whole().info, names=("Lada",) * 5)
        result = check(replace(whole(), info=info, segment=None), recording)
        assert result.sentence.startswith("Names and notes: ")

    @pytest.mark.parametrize("honest", [small, whole])
    def test_parameters_no_method_found_are_found_by_running_it_again(
        self, honest: Callable[[], Snapshot]
    ) -> None:
        snapshot = honest()
        before = check(snapshot, again=True)
        assert before.ok, before.sentence
        assert not any(one.cure == REFIT for one in before.unchecked)
        assert snapshot.segment is not None
        laws = tuple(replace(law, beta=2 * law.beta) for law in snapshot.fit.parameters)
        forged = create(snapshot.segment, replace(snapshot.fit, parameters=laws), with_data=True)
        result = check(forged)
        assert result.ok
        assert any(one.cure == REFIT for one in result.unchecked)
        assert check(forged, again=True).sentence.startswith("Method run again: ")

    def test_forged_blocks_are_found_and_blocks_held_out_otherwise_are_not(self) -> None:
        first, *others = whole().rows

        def with_blocks(**change: Any) -> str:
            changed = tuple(replace(block, **change) for block in first.evaluation.blocks)
            honest = replace(first.evaluation, blocks=changed)
            pooled = replace(honest, held_out=pooled_holdout_errors(changed))
            row = replace(first, evaluation=pooled)
            return check(replace(whole(), rows=(row, *others)), again=True).sentence

        errors = first.evaluation.blocks[0].errors
        assert with_blocks(errors=errors).startswith("Block 2 held out, Least squares: ")
        start = first.evaluation.blocks[0].start + 1.0
        assert with_blocks(start=start).startswith("The snapshot is whole")

    def test_a_stopped_training_cannot_be_run_again(self) -> None:
        fit = replace(whole().fit, outcome=Outcome.STOPPED)
        result = check(replace(whole(), fit=fit), again=True)
        assert result.ok
        assert "as its training was stopped by hand" in result.sentence


class TestTaking:
    def test_a_diverged_training_is_refused(self) -> None:
        segment, fit = trained()
        with pytest.raises(SnapshotError, match="diverged"):
            create(segment, replace(fit, outcome=Outcome.DIVERGED))

    def test_a_long_name_is_refused(self) -> None:
        segment, fit = trained()
        with pytest.raises(SnapshotError, match="201 characters"):
            create(segment, fit, name="x" * 201)


class TestVersions:
    def test_a_later_one_relabelled_as_schema_1_keeps_what_it_says(self) -> None:
        with pytest.raises(SnapshotError, match="does not keep to schema 1"):
            load(resealed(lambda _: None, schema=1))

    def test_schema_1_is_brought_up(self) -> None:
        def as_of_1(trees: dict[str, Any]) -> None:
            for name in ("left_out", "excluded_share"):
                del trees["snapshot.json"]["info"][name]
            for name in ("blocks", "unseen", "unseen_seconds"):
                del trees["evaluation.json"][name]

        snapshot = load(resealed(as_of_1, schema=1))
        assert snapshot.info.excluded_regimes == ()
        assert snapshot.evaluation is not None
        assert snapshot.evaluation.blocks == ()
        assert snapshot.fit.parameters == small().fit.parameters
        assert check(snapshot).ok

    def test_a_newer_one_asks_for_an_update(self) -> None:
        with pytest.raises(SnapshotError, match=r"newer accpinn.*update"):
            load(resealed(lambda _: None, schema=SCHEMA + 1))


KILLED = """
import os, signal, sys
from pathlib import Path
from accpinn.results.snapshot import (file)
moment = sys.argv[2]
before = getattr(os, moment)
def die(*arguments, **options):
    os.kill(os.getpid(), signal.SIGKILL)
setattr(file.os, moment, die)
file.write_whole(b"new" * 100_000, Path(sys.argv[1]))
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
        assert verify(target).ok
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
            "import sys\nfrom accpinn.results.snapshot import load, save\n"
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
        assert all(verify(source).ok for source in sources)

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


class TestCommands:
    def test_verify_says_yes(self, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
        path = save(small(), tmp_path / "a.accpinn.zip")
        assert main(["verify", str(path), "--json"]) == 0
        printed = json.loads(capsys.readouterr().out)
        assert printed["ok"] is True
        assert REFIT in [one["cure"] for one in printed["not_checked"]]
        assert main(["verify", str(path)]) == 0
        assert capsys.readouterr().out.rstrip().endswith("More is checked with --refit.")
        assert main(["verify", str(path), REFIT]) == 0
        assert "Method run again" in capsys.readouterr().out

    def test_verify_says_why_not(self, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
        laws = tuple(replace(law, beta=2 * law.beta) for law in small().fit.parameters)
        forged = replace(small(), fit=replace(small().fit, parameters=laws))
        path = save(forged, tmp_path / "a.accpinn.zip")
        assert main(["verify", str(path)]) == 1
        assert "figures differ" in capsys.readouterr().out

    def test_verify_names_the_damaged_part(
        self, tmp_path: Path, capsys: pytest.CaptureFixture[str]
    ) -> None:
        data = bytearray(to_bytes(whole()))
        data[data.index(b"output.weight.npy") + 300] ^= 1
        path = tmp_path / "a.accpinn.zip"
        path.write_bytes(data)
        assert main(["verify", str(path)]) == 1
        said = capsys.readouterr().err
        assert "damaged in the network's weights (weights.npz)" in said
        assert str(path) in said

    def test_fit_keeps_a_snapshot_that_others_read(
        self, tmp_path: Path, capsys: pytest.CaptureFixture[str]
    ) -> None:
        path = tmp_path / "a.accpinn.zip"
        recording = FOLDER / f"{NOISY}.csv"
        command = ["fit", recording, "--duration", 60, "--method", "splines", "--out", path]
        assert main([*map(str, command), "--name", "mine", "--json"]) == 0
        printed = json.loads(capsys.readouterr().out)["parameters"][0]
        assert main(["stability", "--snapshot", str(path), "--json"]) == 0
        judged = json.loads(capsys.readouterr().out)["vehicles"][0]
        assert judged["alpha"] == printed["alpha"]
        assert main(["simulate", "--snapshot", str(path), "--duration", "60", "--json"]) == 0
        assert len(json.loads(capsys.readouterr().out)["minimum_gap"]) == 8
        assert main(["verify", str(path), "--recording", str(recording)]) == 0
        assert load(path).facts["samples"] == read(recording).samples

    def test_no_command_replaces_what_it_reads(
        self, tmp_path: Path, capsys: pytest.CaptureFixture[str]
    ) -> None:
        path, recording = save(small(), tmp_path / "a.accpinn.zip"), tmp_path / "a.csv"
        recording.write_bytes((FOLDER / f"{NOISY}.csv").read_bytes())
        before = [file.read_bytes() for file in (path, recording)]
        assert main(["report", str(path), "-o", str(path)]) == 1
        assert main(["fit", str(recording), "--out", str(recording)]) == 1
        assert capsys.readouterr().err.count("is not overwritten") == 2
        assert [file.read_bytes() for file in (path, recording)] == before

    @pytest.mark.parametrize(
        "options",
        [("--out", "missing/a"), ("--out", "x" * 300), ("--out", "a", "--name", "x" * 300)],
    )
    def test_what_cannot_be_kept_is_said_before_any_work(
        self,
        capsys: pytest.CaptureFixture[str],
        tmp_path: Path,
        monkeypatch: pytest.MonkeyPatch,
        options: tuple[str, ...],
    ) -> None:
        monkeypatch.chdir(tmp_path)
        assert main(["fit", "not even read.csv", *options]) == 1
        assert "not even read" not in capsys.readouterr().err

    def test_parameters_come_from_one_place(self, capsys: pytest.CaptureFixture[str]) -> None:
        assert main(["stability", "--snapshot", "x", "--alpha", "1"]) == 2
        assert "not both" in capsys.readouterr().err


@pytest.mark.parametrize("case", ["I", "II"])
def test_every_method_comes_back_the_same(case: Case) -> None:
    segment = driven(MIXED[:2], duration=30.0)
    for name, method in ESTIMATORS.items():
        before = create(segment, method(segment, case), name=name)
        assert encode(replace(load(to_bytes(before)), digest="")) == encode(before)


@pytest.mark.parametrize("name", ["fast", "paper"])
def test_every_recipe_comes_back_the_same(name: str) -> None:
    segment = driven(MIXED[:2], duration=30.0)
    fit = train(segment, "I", preset(name, iterations=3), threads=1)
    before = create(segment, fit)
    assert encode(replace(load(to_bytes(before)), digest="")) == encode(before)


def test_a_vehicle_that_keeps_no_gap_has_no_headway() -> None:
    segment = driven(duration=30.0)
    fit = ESTIMATORS["least-squares"](segment, "II")
    free = replace(fit, parameters=(Parameters(0.0, 0.4, float("nan")),))
    snapshot = load(to_bytes(create(segment, free, with_data=True)))
    assert snapshot.fit.parameters[0].alpha == 0
    assert np.isnan(snapshot.fit.parameters[0].tau)
    assert check(snapshot).ok


def test_what_does_not_move_can_be_kept() -> None:
    segment = standing_still()
    snapshot = create(segment, ESTIMATORS["least-squares"](segment, "II"), with_data=True)
    assert check(load(to_bytes(snapshot))).ok
