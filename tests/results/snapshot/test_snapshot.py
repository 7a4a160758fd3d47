"""Snapshots made from results, to bytes and back: bit for bit, of every method."""

import json
import platform
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from accpinn.results.snapshot import SCHEMA, create
from accpinn.results.snapshot.archive import load, to_bytes
from accpinn.results.snapshot.saved import save
from accpinn.results.snapshot.verification import verify

from accpinn.errors import SnapshotError
from accpinn.methods.fit import Outcome, WeaklyDetermined
from accpinn.methods.pinn.config import preset
from accpinn.model.cthp import Case
from accpinn.recordings.openacc import read
from accpinn.recordings.recording import Recording
from accpinn.segment.cut import cut
from accpinn.segment.quality import exclude_regimes, label_regimes
from accpinn.units import Stretch
from tests.support.command import ROOT
from tests.support.driving import MIXED, driven
from tests.support.holes import with_holes
from tests.support.methods import RIVALS as ESTIMATORS
from tests.support.methods import train
from tests.support.samples import FOLDER, NOISY
from tests.support.snapshots import bits, delayed, entries, resealed, small, trained, whole

IN_A_FRESH_PROCESS = """
import json, sys
from accpinn.results.snapshot.archive import load
from accpinn.results.snapshot.verification import QUICK, verify
from tests.support import draws
draws.take_few()  # as in this test's process
snapshot = load(sys.argv[1])
loaded = "torch" in sys.modules
result = verify(snapshot, refit_within=QUICK)  # draws the network's curves again
found = [snapshot.fit.parameters.values.tobytes().hex(), result.ok, loaded]
print(json.dumps(found))
"""


class TestRoundTrip:
    def test_every_bit_is_kept_and_written_again_alike(self) -> None:
        data = to_bytes(whole())
        after = load(data)
        assert (whole().id, len(after.id)) == ("", 16)
        assert bits(replace(after, digest="")) == bits(whole())
        assert to_bytes(after) == data

    def test_it_opens_in_a_fresh_process_without_torch(self, tmp_path: Path) -> None:
        path = save(whole(), tmp_path / "whole.accpinn.zip")
        command = [sys.executable, "-c", IN_A_FRESH_PROCESS, str(path)]
        done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=True)
        before = whole().fit.parameters.values.tobytes().hex()
        assert json.loads(done.stdout) == [before, True, False]

    def test_the_mask_is_kept(self) -> None:
        segment = cut(read(FOLDER / f"{NOISY}.csv"), 0, 60)
        gaps = segment.gaps / segment.speeds[:, 1:]
        segment = replace(segment, gaps=np.where(gaps > 1.7, 2.1, 1.5) * segment.speeds[:, 1:])
        masked = exclude_regimes(segment, label_regimes(segment), ("catching up",))
        snapshot = load(to_bytes(create(masked, small().fit, with_data=True)))
        assert snapshot.info == masked.info
        assert snapshot.info.excluded_regimes == ("catching up",)
        np.testing.assert_array_equal(snapshot.segment.mask, masked.mask)

    def test_missing_samples_are_kept(self) -> None:
        segment = with_holes(driven(duration=20.0), {1: [Stretch(40, 80)], 2: [Stretch(20, 90)]})
        fit = replace(small().fit, surrogate=None)
        before = create(segment, fit, with_data=True)
        after = load(to_bytes(before))
        assert bits(replace(after, digest="")) == bits(before)
        np.testing.assert_array_equal(after.segment.missing, segment.missing)
        assert after.segment.info == segment.info

    def test_the_forms_of_the_model_are_kept_and_checked(self) -> None:
        before = replace(small(), adequacy=delayed())
        after = load(to_bytes(before))
        assert bits(after.adequacy) == bits(before.adequacy)
        (one,) = [check for check in verify(after).checks if check.part == "adequacy"]
        assert not one.ok, "they are invented"
        with pytest.raises(SnapshotError, match="a vehicle that is none"):
            load(to_bytes(replace(small(), adequacy=delayed(vehicle=7))))

    def test_a_finding_about_no_vehicle_of_the_window_is_refused(self) -> None:
        fit = replace(small().fit, findings=(WeaklyDetermined(vehicle=7),))
        with pytest.raises(SnapshotError, match="a vehicle that is none"):
            load(to_bytes(replace(small(), fit=fit)))

    def test_a_disturbance_of_another_window_is_refused(self) -> None:
        fit = replace(small().fit, arrays={"disturbance": np.zeros((3, 1))})
        with pytest.raises(SnapshotError, match="not of the window"):
            load(to_bytes(replace(small(), fit=fit)))

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

    @pytest.mark.parametrize("case", ["I", "II"])
    def test_every_method_and_preset_comes_back_the_same(self, case: Case) -> None:
        segment = driven(MIXED[:2], duration=30.0)
        fits = [method(segment, case) for method in ESTIMATORS.values()]
        presets = [preset(name, iterations=3) for name in ("fast", "paper")]
        fits += [train(segment, case, config, threads=1) for config in presets]
        for fit in fits:
            before = create(segment, fit)
            assert bits(replace(load(to_bytes(before)), digest="")) == bits(before)

    def test_casale(self, casale: Recording, tmp_path: Path) -> None:
        segment = cut(casale, 0, 300)
        fit = train(segment, "II", preset("fast", iterations=60), threads=1)
        target = save(create(segment, fit, recording=casale), tmp_path / "casale.accpinn.zip")
        assert target.stat().st_size < 300_000
        assert verify(load(target), casale).ok


@pytest.mark.parametrize(
    ("change", "said"),
    [({"outcome": Outcome.DIVERGED}, "diverged"), ({"name": "x" * 201}, "201 characters")],
    ids=str,
)
def test_what_cannot_be_kept_is_refused(change: dict[str, Any], said: str) -> None:
    segment, fit = trained()
    outcome = change.get("outcome", fit.outcome)
    with pytest.raises(SnapshotError, match=said):
        create(segment, replace(fit, outcome=outcome), name=change.get("name", ""))


def test_a_newer_schema_asks_for_an_update() -> None:
    with pytest.raises(SnapshotError, match=r"newer accpinn.*update"):
        load(resealed(lambda _: None, schema=SCHEMA + 1))
    with pytest.raises(SnapshotError, match="earlier accpinn"):
        load(resealed(lambda _: None, schema=SCHEMA - 1))
