"""What a batch says, in sentences: the numbers are those of the data."""

import numpy as np

from accpinn.results.messages.database import (
    batch_line,
    failures_line,
    headline,
    progress_line,
    typical_line,
)
from accpinn.study.batch_progress import BatchProgress
from accpinn.study.groups import group
from accpinn.study.journal import Failure
from tests.support.studies import row, rows


def test_the_answer_names_share_interval_and_headway() -> None:
    given = rows(row("A", tau=1.0), row("A", tau=1.1), row("B", tau=2.0), row("C", tau=None))
    [whole] = group(given.assign(p_l2_stable=[1.0, 1.0, 1.0, 0.0]), ()).groups
    assert headline(whole, 0.9).startswith("75 % of the followers")
    tau = whole.tau
    assert f"{tau.median:.2f} s ({tau.low:.2f} to {tau.high:.2f} s)" in typical_line(whole)
    [unknown] = group(given.assign(p_l2_stable=np.nan), ()).groups
    assert "nan" not in headline(unknown, 0.9)


def test_failures_and_settings_are_counted_and_named() -> None:
    none = Failure("a.csv", None, None, "broken")
    assert failures_line(()) == ""
    assert failures_line((none, none)).startswith("1 file without a window;")
    window, vehicle = Failure("a.csv", 3.0, 2, "x"), Failure("", None, None, "A, together: x")
    assert failures_line((none, window, vehicle)).startswith(
        "1 file without a window and 2 estimates failed"
    )
    assert batch_line({"window": 300.0, "case": "II"}) == "Windows of up to 300 s, Case II."
    assert "any length" in batch_line({"window": "all", "case": "I"})
    assert batch_line({}) == ""


def test_progress_tells_what_is_done() -> None:
    said = progress_line(BatchProgress(7, 7.0, 20, 1076, 0, 2, 60.0, 9.0, vehicles=6, pooled=2))
    assert all(part in said for part in ("7 of 7 files", "20 windows", "1,076 rows", "2 of 6"))
    assert "3 failed" in progress_line(BatchProgress(7, 1.0, 1, 1, 3, 2, 6.0, None))
