"""What a batch says, in sentences: the numbers are those of the data."""

from accpinn.results.messages.database import (
    batch_line,
    failures_line,
    headline,
    progress_line,
    typical_line,
)
from accpinn.study.batch import BatchProgress
from accpinn.study.groups import group
from accpinn.study.studies import Failure, Request
from tests.support.studies import REQUEST, row, rows


def test_the_answer_names_share_interval_and_time_gap() -> None:
    given = rows(row("A", tau=1.0), row("A", tau=1.1), row("B", beta=1.9), row("C", tau=None))
    [whole] = group(given, ()).groups
    share = whole.l2_stable
    assert headline(whole).startswith(f"{100 * share.value:.0f} % of the 2 vehicles")
    assert f"{whole.time_gap(100 / 3.6).value:.2f} s (" in typical_line(whole)
    [one] = group(given[:2], ()).groups
    assert "probability" in headline(one)
    [unknown] = group(given[3:], ()).groups
    assert "nan" not in headline(unknown) + typical_line(unknown)


def test_failures_and_settings_are_counted_and_named() -> None:
    none = Failure("a.csv", None, None, "broken")
    assert failures_line(()) == ""
    assert failures_line((none, none)).startswith("1 file without a window;")
    windows = (Failure("a.csv", 3.0, 2, "x"), Failure("a.csv", 9.0, None, "x"))
    assert failures_line((none, *windows)).startswith(
        "1 file without a window and 2 estimates failed"
    )
    assert batch_line(REQUEST).startswith("Windows of up to 300 s, Case II, model CTHP")
    assert "any length" in batch_line(Request((), (), None, "I"))
    assert batch_line(None) == ""


def test_progress_tells_what_is_done() -> None:
    said = progress_line(BatchProgress(files=7, done=7.0, finished=20, rows=1076))
    assert all(part in said for part in ("7 of 7 files", "20 windows", "1,076 rows"))
    assert "3 failed" in progress_line(BatchProgress(files=7, done=1.0, failed=3))
