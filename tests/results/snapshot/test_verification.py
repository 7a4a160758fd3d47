"""What a snapshot says against what its contents give: every forged figure is found."""

from collections import Counter
from collections.abc import Callable
from copy import deepcopy
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from accpinn.results.messages.snapshot import parameters_rest_on, verification_summary
from accpinn.results.snapshot import ATTRIBUTION, Snapshot, create
from accpinn.results.snapshot.archive import load, seal, to_bytes
from accpinn.results.snapshot.places import PartCheck, compare_parts
from accpinn.results.snapshot.verification import (
    HOWEVER_LONG,
    QUICK,
    RECORDING,
    REFIT,
    Verification,
    refit_seconds,
    verify,
)

from accpinn.errors import SnapshotError
from accpinn.evaluation.evaluation import pooled_holdout_errors
from accpinn.inference.intervals import from_draws, judged
from accpinn.methods import splines
from accpinn.methods.fit import Outcome
from accpinn.methods.pinn.config import preset
from accpinn.model.cthp import Parameters
from accpinn.recordings.openacc import read
from accpinn.recordings.recording import Window
from accpinn.segment.cut import cut
from accpinn.segment.segment import WindowShortened
from accpinn.serial import flatten, read_json, write_json
from tests.support.driving import driven, standing_still
from tests.support.methods import RIVALS as ESTIMATORS
from tests.support.samples import FOLDER, NOISY, PLATOON
from tests.support.snapshots import entries, put, small, small_bytes, trained, whole


def fault(found: Verification) -> PartCheck:
    """The first check that fails."""
    assert not found.ok
    return next(check for check in found.checks if not check.ok)


def kinds(found: Verification) -> set[str]:
    return {one.kind for one in found.unchecked}


def changed(leaf: Any) -> tuple[Any, ...]:
    """Another value of the same kind."""
    if isinstance(leaf, bool):
        return (not leaf,)
    if isinstance(leaf, int | float):
        return (leaf + 1 if isinstance(leaf, int) else leaf * 1.01 + 0.003,)
    return (f"{leaf}x",) if isinstance(leaf, str) else (0.5,)


def with_evaluation(snapshot: Snapshot, **change: Any) -> Snapshot:
    """With another evaluation of the first method compared."""
    first, *others = snapshot.methods
    first = replace(first, evaluation=replace(first.evaluation, **change))
    return replace(snapshot, methods=(first, *others))


class TestCompare:
    @pytest.mark.parametrize(
        ("stored", "found", "place", "count"),
        [
            ({"a": 1.0, "b": (2.0, 3.0)}, {"a": 1.0, "b": (2.0, 3.1)}, "b.1", 3),
            ({"a": 1.0}, {"a": 1.0, "b": 2.0}, "b", 1),
            ({"a": None}, {"a": 1.0}, "a", 1),
            ({"a": True}, {"a": False}, "a", 1),
            ({"a": "one"}, {"a": "two"}, "a", 1),
            ({"a": float("inf")}, {"a": 1e300}, "a", 1),
            ({"a": float("nan")}, {"a": 0.0}, "a", 1),
            ({"a": np.arange(100.0)}, {"a": np.r_[np.arange(99.0), 98.9]}, "a.99", 100),
            ({"a": np.zeros((50, 2))}, {"a": np.zeros((2, 50))}, "a", 100),
        ],
    )
    def test_it_names_the_first_difference(
        self, stored: Any, found: Any, place: str, count: int
    ) -> None:
        done = compare_parts("part", stored, found)
        assert (done.ok, done.place, done.count) == (False, place, count)
        assert done.stored != done.recomputed or "nan" in str(done.stored)

    def test_rounding_and_times_do_not_count(self) -> None:
        stored = {"a": 1.0, "seconds": 5.0, "b": float("nan"), "c": np.full(100, np.inf)}
        found = {"a": 1 + 1e-12, "seconds": 6.0, "b": float("nan"), "c": np.full(100, np.inf)}
        assert compare_parts("part", stored, found).ok
        assert not compare_parts("part", stored, found | {"a": 1 + 1e-6}).ok
        assert compare_parts("part", stored, found | {"a": 1 + 1e-6}, relative=1e-5).ok
        texts, others = {"a": "one", "findings": (1.0,)}, {"a": "two", "findings": (2.0, 3.0)}
        assert compare_parts("part", texts, others, numbers_only=True).ok


class TestHonest:
    def test_all_that_can_be_computed_agrees(self) -> None:
        found = verify(load(to_bytes(whole())), refit_within=QUICK)
        assert found.ok
        assert {check.part for check in found.checks if not check.method} == {
            "attribution", "stability", "fit.surrogate", "quality", "uncertainty",
            "evaluation.surrogate", "evaluation.closed_loop", "evaluation.whiteness",
        }  # fmt: skip
        assert {check.part for check in found.checks if "Least" in check.method} == {
            "uncertainty", "evaluation.closed_loop", "evaluation.holdout", "evaluation.whiteness",
        }  # fmt: skip
        assert all(check.count > 0 and check.place for check in found.checks[1:])
        assert kinds(found) == {"estimate", "data", "remarks"}

    def test_the_recording_stands_in_for_missing_data(self) -> None:
        bare = replace(whole(), segment=None)
        assert {one.cure for one in verify(bare).unchecked} == {"", RECORDING}
        assert whole().info.sha256 in verification_summary(verify(bare), bare.info)
        found = verify(bare, read(FOLDER / f"{PLATOON}.csv"), refit_within=QUICK)
        assert found.ok
        assert {"window", "info", "uncertainty"} <= {check.part for check in found.checks}
        assert RECORDING not in {one.cure for one in found.unchecked}

    def test_a_window_that_was_shortened(self) -> None:
        recording = read(FOLDER / f"{NOISY}.csv")
        segment = cut(recording, recording.duration - 60, 300, (1, 2))
        assert any(isinstance(finding, WindowShortened) for finding in segment.findings)
        kept = create(segment, splines.fit(segment), recording=recording, name="end")
        assert verify(kept, recording).ok

    @pytest.mark.parametrize("honest", [small, whole])
    def test_every_method_finds_the_same_again(self, honest: Callable[[], Snapshot]) -> None:
        asked: list[str] = []
        found = verify(honest(), on_refit=lambda name, _: asked.append(name))
        assert found.ok, verification_summary(found, honest().info)
        assert found.refitted
        assert len(asked) == 1 + len(honest().methods)
        assert REFIT not in {one.cure for one in found.unchecked}

    def test_what_takes_minutes_is_left_to_whoever_asks_for_it(self) -> None:
        """Whatever duration the file itself tells."""
        fit = replace(whole().fit, config=preset("paper").to_json(), seconds=0.001)
        forged = replace(whole(), fit=fit, methods=())
        found = verify(forged)
        assert not found.refitted
        (left,) = [one for one in found.unchecked if one.cure == REFIT]
        assert left.seconds == refit_seconds(forged, forged.segment) > 600
        assert "min)" in verification_summary(replace(found, checks=()), forged.info)

    def test_a_stopped_training_cannot_be_run_again(self) -> None:
        fit = replace(whole().fit, outcome=Outcome.STOPPED)
        found = verify(replace(whole(), fit=fit, methods=()), refit_within=HOWEVER_LONG)
        assert "stopped" in kinds(found)
        assert "refit" not in {check.part for check in found.checks}

    def test_what_has_no_headway_can_be_kept(self) -> None:
        segment, still = driven(duration=30.0), standing_still()
        estimate = ESTIMATORS["least-squares"]
        free = replace(estimate(segment, "II"), parameters=Parameters([0.0], [0.4], [np.nan]))
        for data, fit in ((segment, free), (still, estimate(still, "II"))):
            snapshot = load(to_bytes(create(data, fit, with_data=True)))
            assert snapshot.fit.parameters == fit.parameters
            assert verify(snapshot, refit_within=QUICK).ok


class TestForged:
    def test_stability(self) -> None:
        report = whole().stability
        first = report.vehicles[0]
        first = replace(first, linf_exact=replace(first.linf_exact, value=1.0))
        vehicles = (first, *report.vehicles[1:])
        forged = replace(whole(), stability=replace(report, vehicles=vehicles))
        found = verify(forged, refit_within=QUICK)
        assert (fault(found).part, fault(found).place) == (
            "stability",
            "vehicles.0.linf_exact.value",
        )
        assert fault(found).stored == 1.0

    @pytest.mark.parametrize("figure", ["lower", "draws", "probability_l2"])
    def test_intervals(self, figure: str) -> None:
        uncertainty = small().uncertainty
        value = getattr(uncertainty, figure)
        other = getattr(value, "values", value) * 1.001 + 0.001
        kind = Parameters.of if isinstance(value, Parameters) else np.asarray
        forged = replace(uncertainty, **{figure: kind(other)})
        found = fault(verify(replace(small(), uncertainty=forged)))
        assert found.part == "uncertainty"
        # Forged draws are found by what follows from them.
        assert figure == "draws" or found.place.startswith(figure)

    @pytest.mark.parametrize(("factor", "ok"), [(1.0 + 1e-5, True), (1.2, False)])
    def test_draws_of_another_processor_pass_and_others_do_not(
        self, factor: float, ok: bool
    ) -> None:
        segment, fit, uncertainty = small().segment, small().fit, small().uncertainty
        draws = Parameters.of(uncertainty.draws.values * factor)
        other = judged(from_draws(uncertainty.centre, draws, uncertainty.level), segment, fit)
        found = verify(replace(small(), uncertainty=other))
        assert [check.ok for check in found.checks if check.part == "uncertainty"] == [ok]

    def test_intervals_of_another_method_unless_of_another_version(self) -> None:
        older = replace(small().uncertainty, method="an older one", lower=Parameters([0], [0], [0]))
        origin = replace(small().origin, accpinn="0.0.1")
        found = verify(replace(small(), uncertainty=older, origin=origin))
        assert found.ok
        assert {"intervals", "version"} <= kinds(found)
        assert not verify(replace(small(), uncertainty=older)).ok, "this version has no other"

    @pytest.mark.parametrize("number", [1, 0])
    def test_intervals_that_cannot_be_computed(self, number: int) -> None:
        uncertainty = small().uncertainty
        odd = replace(uncertainty, draws=uncertainty.draws[:number])
        assert fault(verify(replace(small(), uncertainty=odd))).reason

    def test_errors_of_a_method_compared(self) -> None:
        errors = whole().methods[0].evaluation.closed_loop
        better = replace(errors, gap_mae=errors.gap_mae / 2)
        found = fault(verify(with_evaluation(whole(), closed_loop=better), refit_within=QUICK))
        assert (found.part, found.method) == ("evaluation.closed_loop", "Least squares")
        found = fault(verify(with_evaluation(whole(), holdout=None), refit_within=QUICK))
        assert found.part == "evaluation.holdout", "it follows from the blocks"

    def test_blocks_but_not_those_held_out_otherwise(self) -> None:
        blocks = whole().methods[0].evaluation.blocks

        def changed(**change: Any) -> Verification:
            own = tuple(replace(block, **change) for block in blocks)
            pooled = pooled_holdout_errors(own)
            first = with_evaluation(whole(), blocks=own, holdout=pooled).methods[0]
            plain = create(whole().segment, first.fit, evaluation=first.evaluation, with_data=True)
            return verify(plain)

        assert fault(changed(errors=blocks[0].errors)).part == "evaluation.blocks"
        elsewhere = changed(window=Window(1.0, 2.0))
        assert elsewhere.ok
        assert "blocks" in kinds(elsewhere)

    def test_errors_outside_the_window(self) -> None:
        recording = read(FOLDER / f"{PLATOON}.csv")
        honest = create(*trained(), recording=recording)
        assert verify(honest, recording, refit_within=QUICK).ok
        errors = honest.evaluation.out_of_window
        better = replace(errors, gap_mae=errors.gap_mae / 2)
        forged = replace(honest, evaluation=replace(honest.evaluation, out_of_window=better))
        found = verify(forged, recording, refit_within=QUICK)
        assert fault(found).part == "evaluation.out_of_window"

    def test_another_recording_or_other_names(self) -> None:
        found = verify(replace(whole(), segment=None), read(FOLDER / f"{NOISY}.csv"))
        assert fault(found).part == "recording"
        assert "not the recording" in verification_summary(found, whole().info)
        info = replace(whole().info, names=("Lada",) * 5)
        bare = replace(whole(), info=info, segment=None)
        found = verify(bare, read(FOLDER / f"{PLATOON}.csv"), refit_within=QUICK)
        assert fault(found).part == "info"

    @pytest.mark.parametrize("name", ["evaluation", "uncertainty", "stability"])
    def test_a_removed_part(self, name: str) -> None:
        found = fault(verify(replace(small(), **{name: None})))
        assert found.part.startswith(name)
        assert found.stored is None

    def test_weights_that_give_other_curves(self) -> None:
        fit = whole().fit
        zero = {name: np.zeros_like(values) for name, values in fit.arrays.items()}
        for arrays in (zero, {}):
            forged = replace(whole(), fit=replace(fit, arrays=arrays), segment=None)
            assert fault(verify(forged)).part == "fit.surrogate"
        assert not verify(replace(whole(), fit=replace(fit, surrogate=None), segment=None)).ok

    def test_texts_but_not_those_of_other_versions(self) -> None:
        forged = load(seal(entries(small_bytes()) | {ATTRIBUTION: b"All is well."}))
        assert fault(verify(forged)).part == "attribution"
        assert "All is well." in verification_summary(verify(forged), forged.info)
        older = replace(forged, origin=replace(small().origin, accpinn="0.0.9"))
        assert verify(older).ok
        assert "version" in kinds(verify(older))

    @pytest.mark.parametrize("honest", [small, whole])
    def test_a_headway_no_method_found_with_all_that_follows_from_it(
        self, honest: Callable[[], Snapshot]
    ) -> None:
        segment, fit = honest().segment, honest().fit
        shorter = Parameters.of(fit.parameters.values * [1, 1, 0.6])
        forged = create(segment, replace(fit, parameters=shorter, seconds=1e9), with_data=True)
        believed = verify(forged, refit_within=QUICK)
        assert believed.ok
        assert dict(believed.ways)["fit.parameters.0.2"] == "told"
        assert "only told" in parameters_rest_on(believed, forged.info)
        found = fault(verify(load(to_bytes(forged))))
        assert (found.part, found.way) == ("refit", "refitted")
        assert "fit.parameters.0.2" in found.wrong

    def test_every_figure_that_is_changed_is_found_or_only_told(self) -> None:
        """One leaf of the whole tree after the other, sealed anew."""
        parts = entries(small_bytes())
        trees = {name: read_json(text) for name, text in parts.items() if name.endswith(".json")}
        changes = [
            (name, place, other)
            for name, tree in trees.items()
            for place, leaf in flatten(tree)
            for other in changed(leaf)
        ]
        assert len(changes) > 250
        met = Counter[str]()
        for name, place, other in changes:
            tree = deepcopy(trees[name])
            put(tree, place.split("."), other)
            try:
                forged = load(seal(parts | {name: write_json(tree)}))
            except SnapshotError:
                met["refused"] += 1
                continue
            part = name.removesuffix(".json")
            at = place if part == "snapshot" else f"{part}.{place}"
            found = verify(forged)
            answer = "found" if not found.ok else dict(found.ways)[at]
            assert answer in ("found", "told"), (at, other)
            met[answer] += 1
        assert min(met[answer] for answer in ("refused", "found", "told")) > 10
