"""The judge: which model a simulated car follows, and what the data leave open."""

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest

import accpinn
from accpinn import FollowingModel, Parameter
from accpinn.errors import ConfigError, RecordingError, SegmentError, SnapshotError
from accpinn.methods.registry import METHODS
from accpinn.model.registry import BASES, FOLLOWING, simulate
from accpinn.recordings import Window
from accpinn.recordings.openacc import read
from accpinn.results.documents import judgement_document
from accpinn.results.messages.summary import which_model
from accpinn.results.publication import write_judgements
from accpinn.results.report import tables_of
from accpinn.segment import Segment
from accpinn.study import Analysis
from accpinn.study.judge import Describes, Subject, blocks, judge, subjects_of, wins
from accpinn.study.judging import Judgements, JudgeProgress, judge_recordings
from accpinn.study.run import run
from accpinn.study.scripts import Script
from accpinn.study.snapshot import prepare_snapshot, to_bytes
from accpinn.study.snapshot import read as read_snapshot
from accpinn.study.store import Store
from accpinn.study.verification import Check, Verification, verify
from tests.methods.test_simulation import TRUTHS
from tests.support.following import driven
from tests.support.openacc_files import csv, metadata, platoon
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


# Many recordings

MODELS_USED = ("cthp", "cthp-s0")


@pytest.fixture(scope="module")
def recordings(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two runs of the same cars, a copy of one of them, and a file that is no recording."""
    place = tmp_path_factory.mktemp("runs")
    for k in (1, 2):
        rows = platoon(3, 1400)
        rows += 0.01 * np.random.default_rng(k).normal(size=(1400, 1)) * [0, 1, 1, 1, 1, 1]
        (place / f"run{k}.csv").write_bytes(csv(rows, metadata(("Lead", "Audi(A8)", "Saloon"))))
    (place / "same.csv").write_bytes((place / "run1.csv").read_bytes())
    (place / "broken.csv").write_bytes(b"Date,1,1,2020\n\0\0\0")
    return place


@pytest.fixture(scope="module")
def judgements(recordings: Path) -> Judgements:
    return judge_recordings(recordings, MODELS_USED)


def test_a_vehicle_of_several_recordings_counts_once(judgements: Judgements) -> None:
    assert (len(judgements), len(judgements.vehicles), judgements.recordings) == (4, 2, 2)
    means = [
        np.concatenate([np.log(c.scores[1].rmse / c.scores[0].rmse) for c in cars]).mean()
        for cars in judgements.vehicles
    ]
    row = next(row for row in judgements.summary() if row.key == "cthp-s0")
    assert row.difference == pytest.approx(np.mean(means))
    assert row.error == pytest.approx(np.std(means, ddof=1) / np.sqrt(2))
    assert not row.is_clear  # of two vehicles
    assert judgements.difference("cthp", "cthp-s0")[0] == pytest.approx(-row.difference)
    assert sum(r.best_in for r in judgements.summary()) == judgements.windows
    assert all(0 < r.mae < r.rmse for r in judgements.summary())
    with pytest.raises(ConfigError, match="is not judged"):
        judgements.summary("idm")


def test_what_is_not_judged_has_a_reason(judgements: Judgements) -> None:
    reasons = {failure.file: failure.reason for failure in judgements.failures}
    assert reasons.keys() == {"broken.csv", "same.csv"}
    assert "run1.csv" in reasons["same.csv"]


def test_many_followers_are_judged_as_each_alone(recordings: Path, judgements: Judgements) -> None:
    subjects = subjects_of(read(recordings / "run2.csv"))
    *_, alone = judge(subjects, MODELS_USED)
    for one, car in zip(alone, judgements[2:4], strict=True):
        for score, other in zip(one.scores, car.scores, strict=True):
            np.testing.assert_allclose(score.rmse, other.rmse, rtol=1e-6)


def test_a_judgement_goes_on_where_it_was_stopped(
    recordings: Path, judgements: Judgements, tmp_path: Path
) -> None:
    """What is kept is not judged again, and what is damaged is."""
    seen: list[JudgeProgress] = []
    first = judge_recordings(
        recordings, MODELS_USED, folder=tmp_path, on_progress=seen.append,
        should_stop=lambda: bool(seen) and seen[-1].finished > 2,
    )  # fmt: skip
    assert not first.is_whole
    assert len(first) == 1
    kept = sorted(tmp_path.glob("*.json"))
    assert len(kept) == 3
    kept[0].write_text("{")
    again = judge_recordings(recordings, MODELS_USED, folder=tmp_path, on_progress=seen.append)
    assert (seen[-1].kept, seen[-1].finished) == (2, 6)
    assert again.is_whole
    pd.testing.assert_frame_equal(again.to_frame("windows"), judgements.to_frame("windows"))
    judge_recordings(
        recordings, (*MODELS_USED, "least-squares"), folder=tmp_path, on_progress=seen.append
    )
    assert (seen[-1].kept, seen[-1].finished, seen[-1].done) == (8, 4, 4)


SCRIPT = """
import accpinn
from dataclasses import replace
print("not on standard output")
def acceleration(p, v, u, theta, xp):
    return theta[0] * (p - theta[1] * v) + theta[2] * (u - v)
parameters = tuple(accpinn.Parameter(*row) for row in (
    ("k", "k", "1/s²", 1e-3, 5.0, 0.1, 1.0), ("T", "T", "s", 0.1, 5.0, 1.2, 0.4),
    ("c", "c", "1/s", 1e-3, 5.0, 0.2, 1.0)))
accpinn.register_model(accpinn.FollowingModel("mine", "Mine", parameters, acceleration))
accpinn.register_method(replace(accpinn.METHODS["least-squares"], key="my-way", title="My way"))
"""


@pytest.fixture
def script(tmp_path: Path) -> Script:
    (tmp_path / "mine.py").write_text(SCRIPT)
    return Script.read(tmp_path / "mine.py")


@pytest.mark.usefixtures("registries")
def test_workers_judge_models_and_methods_of_a_script(
    recordings: Path, judgements: Judgements, script: Script, cluster: str, tmp_path: Path
) -> None:
    keys = (*MODELS_USED, *script.names())
    assert keys[2:] == ("mine", "my-way")
    file = recordings / "run1.csv"
    found = judge_recordings(
        file, keys, scripts=[script], scheduler=cluster, folder=tmp_path / "kept"
    )
    assert found.keys == keys
    pd.testing.assert_series_equal(
        found.to_frame("windows").query("model == 'cthp'").gap_rmse.reset_index(drop=True),
        judgements.to_frame("windows")
        .query("model == 'cthp' and file == 'run1.csv'")
        .gap_rmse.reset_index(drop=True),
    )
    assert found.made.scripts.keys() == {"mine.py"}
    by_method = found[0].scores[3]
    assert by_method.model.key == "cthp"
    assert np.isfinite(by_method.theta).all()
    for key in ("mine", "mine-lag", "my-way"):
        with pytest.raises(ConfigError, match=f"{key} is registered in this process alone"):
            judge_recordings(file, (key,), workers=1)


def test_a_method_is_judged_by_its_estimate_from_the_other_windows(recordings: Path) -> None:
    (subject, *_) = subjects_of(read(recordings / "run1.csv"))
    *_, (judged,) = judge([subject], ["least-squares"])
    (score,) = judged.scores
    others = subject.windows[1:]
    fitted = METHODS["least-squares"].fit(others)
    first = subject.windows[0]
    ahead, own = first.speeds.T
    driven = simulate("cthp", fitted.parameters, first.time, ahead, own[:1], first.gaps[0])
    error = np.sqrt(np.mean((driven.gaps - first.gaps) ** 2))
    assert score.rmse[0] == pytest.approx(error, rel=0.02)  # each 0.4 s, and each sample
    assert "CTHP" in score.title
    with pytest.raises(ConfigError, match="models: no-such is not known"):
        list(judge([subject], ["no-such"]))


@pytest.mark.usefixtures("registries")
def test_a_model_that_fails_on_a_follower_is_told_and_the_others_go_on(recordings: Path) -> None:
    def acceleration(p: Any, v: Any, u: Any, theta: Any, xp: Any) -> Any:
        if np.size(p) > 16:  # fine where it is registered
            raise ZeroDivisionError("of mine")
        return theta[0] * (p - 1.2 * v) + 0.2 * (u - v)

    mine = (Parameter("k", "k", "1/s²", 1e-3, 5.0, 0.1, 1.0),)
    model = FollowingModel("fails", "Fails", mine, acceleration)
    with pytest.raises(RecordingError, match="fails: ZeroDivisionError: of mine"):
        accpinn.judge(recordings / "run1.csv", ["cthp", model])


def test_each_format_of_the_tables_is_written_with_what_it_was_made_with(
    judgements: Judgements, tmp_path: Path
) -> None:
    names = write_judgements(judgements, tmp_path, "cthp-s0")
    assert {*names} == {path.name for path in tmp_path.iterdir()}
    models = pd.read_csv(tmp_path / "models.csv")
    beside = models.set_index("key").beside_reference_percent
    assert np.isnan(beside["cthp-s0"])
    difference, *_ = judgements.difference("cthp", "cthp-s0")
    assert beside["cthp"] == pytest.approx(100 * np.expm1(difference))
    windows = pd.read_csv(tmp_path / "windows.csv")
    assert len(windows) == len(MODELS_USED) * judgements.windows
    made = json.loads((tmp_path / "made_with.json").read_text())
    assert [part["file"] for part in made["recordings"]] == ["run1.csv", "run2.csv"]
    assert made["recordings"][0]["sha256"] == judgements[0].info.sha256
    assert made["origin"]["accpinn"] == accpinn.__version__
    markdown = (tmp_path / "models.md").read_text()
    assert markdown.count("\n|") == 2 + len(MODELS_USED)
