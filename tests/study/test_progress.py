"""What a batch will come to, from some of its files, and how long the rest takes."""

from pathlib import Path

import numpy as np
import pytest

from accpinn.methods.registry import METHODS
from accpinn.study import progress
from accpinn.study.progress import INTERVALS_SECONDS, READ, START, Tally, estimate_batch
from tests.support.openacc_files import csv, metadata, platoon


def test_files_alike_count_as_those_that_are_read(tmp_path: Path) -> None:
    (tmp_path / "broken.csv").write_bytes(b"Date,1,1,2020\n\0")
    raw = csv(platoon(3, 1300), metadata())
    for k in range(2 * READ):
        (tmp_path / f"run{k}.csv").write_bytes(raw)
        if k == 1:
            few = estimate_batch(tmp_path, 60.0)
            assert (few.files, few.windows, few.followers, few.exact) == (3, 4, 8, True)
            assert few.size == pytest.approx(4 * 60 / 300 * 1.35), "a further follower takes less"
    estimate = estimate_batch(tmp_path, 60.0)
    assert not estimate.exact
    assert estimate.windows == pytest.approx(2 * READ * 2, rel=1e-3)
    a_window = METHODS["splines"].typical_seconds + INTERVALS_SECONDS
    alone, two = (estimate.seconds(["splines"], workers) - START for workers in (1, 2))
    assert alone == pytest.approx(2 * two) == pytest.approx(a_window / 3 * estimate.size)


def test_the_time_left_does_not_jump(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Two workers, four windows of about 10 s in each of eight files, one of which is known."""
    now = 100.0
    monkeypatch.setattr(progress.time, "monotonic", lambda: now)
    files = [tmp_path / str(k) for k in range(8)]
    for file in files:
        file.write_bytes(b"x" * 1000)
    tally = Tally(files)
    assert tally.progress(2).seconds_left is None
    tally.skip(files[0])
    durations = np.random.default_rng(0).uniform(8, 12, 28)
    waiting = [(file, durations[4 * k + i]) for k, file in enumerate(files[1:]) for i in range(4)]
    running: list[tuple[float, Path, float]] = []
    ends, shares = [], []
    while waiting or running:
        while waiting and len(running) < 2:
            file, duration = waiting.pop(0)
            running.append((now + duration, file, tally.begin()))
        now, file, began = running.pop(running.index(min(running)))
        tally.finish(file, 0.25, began)
        said = tally.progress(2)
        shares.append(said.share)
        ends.append(now + said.seconds_left)
    assert shares == sorted(shares)
    np.testing.assert_allclose(ends, now, atol=20)
    assert np.abs(np.diff(ends)).max() < 15
    assert (said.done, said.windows, said.share) == (8, 28, pytest.approx(1.0))
    assert tally.progress(0, is_done=True).seconds_left == 0
