"""What a snapshot says against what its analysis gives: every forged number is found."""

import io
import json
import os
import zipfile
from collections import Counter
from collections.abc import Callable, Iterator
from copy import deepcopy
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import pytest

import accpinn
from accpinn.errors import SnapshotError
from accpinn.methods.estimate import Outcome
from accpinn.methods.findings import BoundActive
from accpinn.methods.pinn.config import preset
from accpinn.methods.registry import METHODS
from accpinn.model.cthp import Parameters
from accpinn.recordings import Window
from accpinn.recordings.openacc import read
from accpinn.segment import WindowShortened
from accpinn.study import Analysis, snapshot_library, verification
from accpinn.study.result import Result
from accpinn.study.run import run
from accpinn.study.snapshot import DOCUMENT, load, prepare_snapshot, to_bytes
from accpinn.study.snapshot_library import Library
from accpinn.study.verification import HOWEVER_LONG, Check, Verification, verify
from tests.support.driving import driven
from tests.support.samples import FOLDER, NOISY
from tests.support.snapshots import (
    altered,
    arrays_of,
    members,
    platoon,
    put,
    result_for,
    sealed,
    small,
    small_bytes,
    trained,
    two_windows,
    whole,
    with_parameters,
)

TOLD = ("analysis.source", "analysis.windows", "origin", "created", "name", "note", "digest")
"""What rests on whoever wrote a file without a recording behind it."""
VARYING = ("seconds", "cached")
TITLES = {key: METHODS[key].title for key in ("least-squares", "savitzky-golay")}


def fault(found: Verification) -> Check:
    """The first check that fails."""
    assert not found.ok
    return next(check for check in found.checks if not check.ok)


def states(found: Verification) -> dict[tuple[str, str], str]:
    return {(check.part, check.method): check.state for check in found.checks}


@cache
def bounded() -> Result:
    """A small one with a bound that is active."""
    made = driven(((0.08, -0.05, 1.5),), duration=20.0, step=0.5)
    result = prepare_snapshot(result_for(made), "bounded")
    assert any(isinstance(one, BoundActive) for one in result.findings)
    return result


def known(**changes: Any) -> Result:
    """The result of two windows with another posterior."""
    result = two_windows()
    return altered(result, posterior=replace(result.posterior, **changes))


class TestHonest:
    @pytest.mark.parametrize("honest", [small, whole, two_windows, bounded])
    def test_all_is_reproduced_from_the_file_alone(self, honest: Callable[[], Result]) -> None:
        asked: list[str] = []
        found = verify(load(to_bytes(honest())), on_refit=lambda name, _: asked.append(name))
        has_file = bool(honest().analysis.source.sha256)
        assert found.ok is True, found.sentence
        assert len(asked) == 1 + len(honest().compared)
        assert {check.part for check in found.unchecked} == ({"data"} if has_file else set())
        kinds = states(found)
        assert kinds["estimate", ""] == "reproduced"
        assert (("posterior", "") in kinds) == (honest is two_windows)
        if honest is whole:
            for title in TITLES.values():
                assert kinds["estimate", title] == kinds["holdout", title] == "reproduced"
        agreeing = sum(check.numbers for check in found.checks)
        assert f"{agreeing:,} of {agreeing:,} numbers" in found.mark
        assert (found.mark[0], found.accpinn) == ("✓", accpinn.__version__)
        assert found.has_recording is False

    def test_with_the_recording_the_data_are_compared_too(self) -> None:
        bare = load(to_bytes(whole()))
        renamed = replace(platoon(), source="renamed.csv")
        found = verify(bare, renamed, refit_within=0.0)
        assert found.ok is None, found.sentence
        assert found.has_recording
        assert states(found)["info", ""] == states(found)["facts", ""] == "reproduced"
        assert {check.cure for check in found.unchecked} == {"--refit"}
        (left,) = verify(bare, own_only=True).checks
        assert (left.part, left.state, left.method) == ("estimate", "reproduced", "")

    def test_a_window_that_was_shortened(self) -> None:
        recording = read(FOLDER / f"{NOISY}.csv")
        window = Window(recording.duration - 60, recording.duration + 240)
        result = run(Analysis.of(recording, [window], method="splines"), recording)
        assert any(isinstance(finding, WindowShortened) for finding in result.info.findings)
        assert verify(load(to_bytes(prepare_snapshot(result))), recording).ok

    def test_what_takes_minutes_is_left_to_whoever_asks_for_it(self) -> None:
        """However short a time the file itself tells."""
        settings = preset("paper").to_json()
        slow = altered(whole(), settings=settings, seconds=0.001)
        slow = replace(slow, analysis=replace(slow.analysis, settings=settings), compared=())
        found = verify(slow)
        (left,) = [check for check in found.unchecked if check.cure == "--refit"]
        assert (left.part, left.seconds > 120) == ("estimate", True)

    def test_a_stopped_training_cannot_be_run_again(self) -> None:
        stopped = replace(altered(whole(), outcome=Outcome.STOPPED), compared=())
        found = verify(stopped, refit_within=HOWEVER_LONG)
        assert found.ok is None
        assert states(found)["estimate", ""] == "not checked"

    def test_another_processors_training_agrees_up_to_its_tolerance(self) -> None:
        """It ends elsewhere by a little, and gets there by another way."""
        estimate, factor = trained().estimate, 1 + 1e-5
        assert METHODS["pinn"].tolerance > 1e-5
        values = Parameters.of(estimate.parameters.values * factor)
        loss = {name: factor * value for name, value in estimate.loss.items()}
        (curves,) = estimate.curves
        moved = replace(curves, gaps=curves.gaps + 1e-3)
        history = replace(estimate.history, total=1.1 * estimate.history.total)
        other = altered(
            trained(), parameters=values, loss=loss, curves=(moved,), history=history, iterations=19
        )
        assert verify(other, platoon()).ok

    @pytest.mark.usefixtures("honest_again")
    @pytest.mark.parametrize(("factor", "ok"), [(1.0 + 1e-5, True), (1.2, False)])
    def test_draws_of_another_processor_pass_and_others_do_not(
        self, factor: float, ok: bool
    ) -> None:
        for name in ("typical", "further"):
            draws = getattr(two_windows().posterior, name).everything * factor
            assert verify(known(**{name: Parameters.of(draws)})).ok == ok


@pytest.fixture
def honest_again(monkeypatch: pytest.MonkeyPatch) -> None:
    """What running two windows again gives, which `TestHonest` has seen."""
    monkeypatch.setattr(verification, "estimate", lambda *_, **__: two_windows().estimate)


def compared(**changes: Any) -> Result:
    """With another estimate by the first method compared, or other blocks."""
    first, *others = whole().compared
    return replace(whole(), compared=(replace(first, **changes), *others))


class TestForged:
    def test_a_method_compared_and_the_blocks_held_out(self) -> None:
        first = whole().compared[0]
        better = Parameters.of(first.parameters.values * 1.01)
        found = fault(verify(compared(estimate=replace(first.estimate, parameters=better))))
        assert (found.part, found.method) == ("estimate", TITLES["least-squares"])
        blocks = tuple(
            replace(one, errors=replace(one.errors, gap_mae=one.errors.gap_mae / 2))
            for one in first.blocks
        )
        found = fault(verify(compared(blocks=blocks)))
        assert (found.part, found.state) == ("holdout", "reproduced")
        assert "gap MAE" in found.stored

    def test_another_recording_or_other_names(self) -> None:
        found = verify(whole(), read(FOLDER / f"{NOISY}.csv"))
        assert fault(found).part == "data"
        assert "not the recording" in found.sentence
        names = ("Lada",) * 5
        (segment,) = whole().segments
        info = replace(whole().info, names=names)
        renamed = replace(whole(), infos=(info,), segments=(replace(segment, names=names),))
        assert fault(verify(renamed, platoon(), refit_within=0.0)).part == "info"

    def test_other_data_with_all_that_follows_from_them(self) -> None:
        """Whole in itself, so only the recording tells."""
        (segment,) = trained().segments
        moved = replace(segment, gaps=segment.gaps + 1.0)
        forged = result_for(moved)
        assert [check.part for check in verify(forged).unchecked] == ["data"]
        found = fault(verify(forged, platoon()))
        assert found.part == "data"
        assert "the window cut from it differs" in found.sentence

    def test_a_headway_no_method_found_with_all_that_follows_from_it(self) -> None:
        forged = load(to_bytes(with_parameters(small(), [1, 1, 0.6])))
        believed = verify(forged, refit_within=0.0)
        assert believed.ok is None
        assert states(believed)["estimate", ""] == "not checked"
        found = fault(verify(forged))
        assert (found.part, found.state) == ("estimate", "reproduced")
        assert found.stored != found.computed
        assert found.stored.startswith(f"τ {forged.parameters.tau[0]:.4g}"[:6])
        words = verify(forged)
        assert words.mark.startswith("✗")
        assert found.stored in words.sentence, "what differs first"

    @pytest.mark.usefixtures("honest_again")
    @pytest.mark.parametrize(
        "change",
        [
            lambda e: {"parameters": Parameters.of(1.01 * e.parameters.everything)},
            lambda e: {"windows": Parameters.of(1.1 * e.windows.everything)},
            lambda e: {"curves": tuple(replace(c, gaps=c.gaps + 0.1) for c in e.curves)},
            lambda e: {"arrays": {name: 2 * array for name, array in e.arrays.items()}},
            lambda e: {"arrays": {}},
            lambda e: {"arrays": e.arrays | {"unknowns": 1.1 * e.arrays["unknowns"]}},
            lambda e: {"loss": e.loss | {"data": 0.5 * e.loss["data"]}},
            lambda e: {"driven": e.driven * [[1.0], [1.1]]},
            lambda e: {"speeds": 1.001 * e.speeds},
            lambda e: {"findings": (BoundActive(2, ("β",), (0.1, 0.1, 0.1)),)},
        ],
        ids="parameters windows curves weights none disturbance loss driven speeds finding".split(),
    )
    def test_whatever_an_iterative_training_says_but_its_course(
        self, change: Callable[[Any], dict[str, Any]]
    ) -> None:
        forged = altered(two_windows(), **change(two_windows().estimate))
        assert METHODS["pinn"].tolerance > 1e-6, "digits depend on the processor"
        assert fault(verify(forged)).part == "estimate"

    @pytest.mark.usefixtures("honest_again")
    @pytest.mark.parametrize(
        "change",
        [
            lambda p: {"level": 0.8},
            lambda p: {"method": "by magic"},
            lambda p: {"typical": p.typical[::2]},
            lambda p: {"windows_lower": Parameters.of(0.9 * p.windows_lower.everything)},
            lambda p: {"windows_gap": 1.02 * p.windows_gap},
            lambda p: {"differ": 0.5 * p.differ},
            lambda p: {"draws": 2.0 * p.draws},
            lambda p: {"followers_differ": 0.01},
        ],
        ids="level method fewer window gap differ draws followers".split(),
    )
    def test_whatever_a_posterior_says(self, change: Callable[[Any], dict[str, Any]]) -> None:
        found = fault(verify(known(**change(two_windows().posterior))))
        assert (found.part, found.differing > 0) == ("posterior", True)

    @pytest.mark.parametrize("honest", [small, bounded])
    def test_every_number_that_is_changed_is_found(self, honest: Callable[[], Result]) -> None:
        """One field of the whole tree after the other, of a list one member, sealed anew."""
        data = to_bytes(honest())
        tree, arrays = json.loads(members(data)[DOCUMENT]), arrays_of(data)
        met, missed = Counter[str](), []
        fields = {tuple(n for n in place if not n.isdigit()): (place, leaf)
                  for place, leaf in leaves(tree)}  # fmt: skip
        for place, leaf in fields.values():
            if ".".join(place).startswith(TOLD) or place[-1] in VARYING:
                continue
            forged = deepcopy(tree)
            put(forged, place, other_than(leaf))
            try:
                result = load(sealed(json.dumps(forged).encode(), arrays))
            except SnapshotError:
                met["refused"] += 1
                continue
            is_found = not verify(result).ok
            met["found"] += is_found
            if not is_found:
                missed.append((place, leaf))
        assert missed == []
        assert met["found"] >= 7
        assert met["refused"] >= 40


class TestKept:
    def test_it_stays_with_the_file_and_the_version_and_with_nothing_else(
        self, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        library = Library(tmp_path)
        name = library.add(small())
        assert library.verification(name) is None
        snapshot = library.read(name)
        found = verify(snapshot)
        library.keep_verification(snapshot, found)
        assert Library(tmp_path).verification(name) == found
        library.delete(name)
        assert library.verification(name) is None
        library.restore(name)
        assert library.verification(name) == found
        os.utime(library.path(name), (0, 0))
        assert library.verification(name) == found, "the same content"
        whole = library.path(name).read_bytes()
        library.path(name).write_bytes(whole + b"x")
        assert library.verification(name) is None
        library.path(name).write_bytes(whole)
        with monkeypatch.context() as patch:
            patch.setattr(snapshot_library, "__version__", "later")
            assert library.verification(name) is None
        assert library.verification(name) == found

    def test_a_failure_takes_the_place_of_any_and_less_that_of_none(self, tmp_path: Path) -> None:
        library = Library(tmp_path)
        snapshot = library.read(library.add(small()))
        found, partial = verify(snapshot), verify(snapshot, refit_within=0.0)
        failed = replace(found, checks=(replace(found.checks[0], ok=False), *found.checks[1:]))
        for checked, stays in ((partial, None), (found, found), (partial, found),
                               (failed, failed), (partial, failed), (found, found)):  # fmt: skip
            library.keep_verification(snapshot, checked)
            assert library.verification(snapshot.id) == stays
        absent = load(to_bytes(bounded()))
        library.keep_verification(absent, found)
        assert library.verification(absent.id) is None

    def test_a_file_brings_no_mark_of_its_own(self, tmp_path: Path) -> None:
        library = Library(tmp_path)
        data = small_bytes()
        claimed = io.BytesIO(data)
        with zipfile.ZipFile(claimed, "a") as archive:
            archive.writestr("result.accpinn.zip.verified", b"{}")
        with pytest.raises(SnapshotError, match="belongs in none"):
            library.add(claimed.getvalue())
        tree = json.loads(members(data)[DOCUMENT])
        tree["verification"] = {"checks": [], "ok": True}
        try:
            name = library.add(sealed(json.dumps(tree).encode(), arrays_of(data)))
        except SnapshotError:
            name = library.add(data)
        assert library.verification(name) is None


def leaves(tree: Any, place: tuple[str, ...] = ()) -> Iterator[tuple[tuple[str, ...], Any]]:
    """The leaves of a tree of objects and lists with their places."""
    if not isinstance(tree, dict | list) or not tree:
        yield place, tree
        return
    for name, part in tree.items() if isinstance(tree, dict) else enumerate(tree):
        yield from leaves(part, (*place, str(name)))


def other_than(leaf: Any) -> Any:
    """Another value of the same kind."""
    if isinstance(leaf, bool):
        return not leaf
    if isinstance(leaf, int | float):
        return leaf + 1 if isinstance(leaf, int) else leaf * 1.1 + 0.01
    return f"{leaf}x" if isinstance(leaf, str) else 0.5
