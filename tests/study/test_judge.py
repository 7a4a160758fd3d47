"""The judge: which model a simulated car follows, and what the data leave open."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from accpinn.errors import SegmentError, SnapshotError
from accpinn.model.registry import BASES, FOLLOWING
from accpinn.recordings import Window
from accpinn.recordings.openacc import read
from accpinn.results.documents import judgement_document
from accpinn.results.messages.summary import which_model
from accpinn.results.report import tables_of
from accpinn.segment import Segment
from accpinn.study import Analysis
from accpinn.study.judge import Describes, Subject, blocks, judge, subjects_of, wins
from accpinn.study.run import run
from accpinn.study.snapshot import prepare_snapshot, to_bytes
from accpinn.study.snapshot import read as read_snapshot
from accpinn.study.store import Store
from accpinn.study.verification import Check, Verification, verify
from tests.methods.test_simulation import TRUTHS
from tests.support.following import driven
from tests.support.samples import FOLDER, PLATOON

MODELS = [base.key for base in BASES]
CONTAINS = {"cthp-s0": "unequal"}
"""Models, and the richer ones of which they are special cases."""


def subject(key: str, noise: float = 0.05) -> Subject:
    """A simulated car in four windows."""
    model, theta = FOLLOWING[key], TRUTHS[key][:1]
    windows = tuple(driven(model, theta, seed, noise, 45.0)[0] for seed in range(4))
    return Subject(windows, driven(model, theta, 9, noise, seconds=250.0)[:1])


@pytest.mark.parametrize("truth", ["cthp-s0", "unequal", "idm", "fvdm"])
def test_the_true_model_is_picked(truth: str) -> None:
    models = [key for key in MODELS if key != CONTAINS.get(truth)]
    *_, (judged,) = judge([subject(truth)], models)
    best = judged.ranked[0]
    assert best.model.key == truth
    assert np.median(best.rmse) < 0.3
    assert best.gain_error < 1.5  # over so wide a range of speeds no linear gain holds
    assert not best.collided.any()
    share = dict(zip(models, wins([judged]), strict=True))
    assert share[truth] >= 0.75
    assert sum(share.values()) == pytest.approx(1.0)
    finding = judged.findings[0]
    assert isinstance(finding, Describes)
    assert (finding.clear, finding.model, finding.windows) == (True, best.model.title, 4)
    assert judged.ranked[1] in judged.worse
    assert best not in judged.worse
    assert judged.ranked[-1].model.title in finding.worse


@pytest.mark.parametrize("models", [("cthp", "cthp-s0"), ("cthp-s0", "unequal")])
def test_models_that_are_alike_are_not_told_apart(models: tuple[str, str]) -> None:
    """The CTHP is that with an intercept of zero, and that is the one with equal gains."""
    model, theta = FOLLOWING[models[0]], np.array([[0.1, 0.2, 1.3, 4.0]])
    theta = theta[:, : len(model.parameters)]
    windows = [driven(model, theta, seed, 0.3)[0] for seed in range(4)]
    *_, (judged,) = judge([Subject(tuple(windows), ())], models)
    finding = judged.findings[0]
    assert isinstance(finding, Describes)
    assert not finding.clear
    assert np.isnan(judged.scores[0].gain_error)
    (said,) = which_model((judged, replace(judged, scores=judged.scores[::-1]), judged))
    assert "All three followers: no model is clearly better" in said
    assert f"{finding.rmse:.2f} to {finding.rmse:.2f} m" in said


def test_the_window_left_out_teaches_nothing() -> None:
    """Its own motion changes the error there and no parameter that is judged in it."""
    windows = subject("cthp-s0").windows
    other = driven(FOLLOWING["cthp"], np.array([[0.02, 0.05, 2.0]]), 3, 0.05)[0]
    ((first,),) = judge([Subject(windows[:3], ())], ["cthp-s0"])
    ((second,),) = judge([Subject((*windows[:2], other), ())], ["cthp-s0"])
    assert second.scores[0].rmse[2] > 5 * first.scores[0].rmse[2]
    assert second.scores[0].rmse[0] > 2 * first.scores[0].rmse[0]  # it is learned from the others


def test_a_stop_ends_with_the_models_that_are_done() -> None:
    asked: list[int] = []

    def should_stop() -> bool:
        asked.append(1)
        return len(asked) > 30

    done = list(judge([subject("cthp-s0")], MODELS, should_stop))
    assert 0 < len(done) < len(MODELS)
    assert len(done[-1][0].scores) == len(done)


def test_one_window_is_judged_by_its_blocks() -> None:
    recording = read(FOLDER / f"{PLATOON}.csv")
    assert [part.duration for part in blocks(Window(10.0, 310.0), 2)] == pytest.approx([100.0] * 3)
    subjects = subjects_of(recording, windows=[Window(0.0, 300.0)])
    assert [len(one.windows) for one in subjects] == [3] * len(subjects)
    assert all(isinstance(part, Segment) for one in subjects for part in one.stretches)
    (short,) = subjects_of(recording, (1, 2), [Window(0.0, 67.0)])
    assert [part.window.duration for part in short.windows] == [33.5, 33.5]
    with pytest.raises(SegmentError, match="it takes 60 s"):
        subjects_of(recording, (1, 2), [Window(0.0, 50.0)])
    one_short = subjects_of(recording, (1, 2), [Window(t, t + 25.0) for t in (0.0, 30.0, 60.0)])
    with pytest.raises(SegmentError, match="too short to be simulated; choose a window"):
        list(judge(one_short, ["cthp"]))


def test_a_judgement_is_kept_with_the_result(tmp_path: Path) -> None:
    """It is in store and snapshot, comes back, is verified from the recording, and is reported."""
    recording = read(FOLDER / f"{PLATOON}.csv")
    result = run(Analysis.of(recording, vehicles="1-2", method="least-squares"), recording)
    subjects = subjects_of(recording, (1, 2), [Window(0.0, 300.0)])
    *_, before = judge(subjects, ["cthp", "cthp-s0"])
    result = replace(result, judgements=before)
    store = Store(tmp_path)
    store.keep(result)
    assert len(store.find(result.analysis).judgements) == 1

    snapshot = read_snapshot(to_bytes(prepare_snapshot(result)))
    for now, then in zip(snapshot.judgements, before, strict=True):
        assert now.findings == then.findings
        assert judgement_document(now) == judgement_document(then)
        table = tables_of(snapshot)[f"models_{now.info.vehicles[1]}"]
        assert now.info.labels[1] in table.to_text()
    assert judged_check(verify(snapshot)).cure == "--recording"
    assert judged_check(verify(snapshot, recording)).ok
    (stored,) = snapshot.judgements
    first, *others = stored.scores
    forged = replace(stored, scores=(replace(first, rmse=0.5 * first.rmse), *others))
    changed = to_bytes(replace(snapshot, judgements=(forged,)))
    assert not judged_check(verify(read_snapshot(changed), recording)).ok
    fewer = replace(forged, windows=forged.windows[1:])
    with pytest.raises(SnapshotError, match="does not fit"):
        read_snapshot(to_bytes(replace(snapshot, judgements=(fewer,))))


def judged_check(verification: Verification) -> Check:
    (check,) = (check for check in verification.checks if check.part == "judgements")
    return check
