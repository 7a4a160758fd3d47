"""What a batch will come to, from some of its files."""

from pathlib import Path

import pytest

from accpinn.methods.registry import METHODS
from accpinn.study.estimate import INTERVALS_SECONDS, READ, START, estimate_batch
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
    found = estimate_batch(tmp_path, 60.0)
    assert not found.exact
    assert found.windows == pytest.approx(2 * READ * 2, rel=1e-3)
    each = METHODS["splines"].typical_seconds + INTERVALS_SECONDS
    one, two = (found.seconds(["splines"], workers) - START for workers in (1, 2))
    assert one == pytest.approx(2 * two) == pytest.approx(each / 3 * found.size)
