"""What a snapshot says against what its analysis gives: every forged number is found."""

import json
import re
from collections import Counter
from collections.abc import Callable
from copy import deepcopy
from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import pytest

from accpinn import METHODS, Analysis, Parameters, Result, load, preset, run
from accpinn.errors import SnapshotError
from accpinn.evaluation import of_blocks
from accpinn.inference.intervals import from_draws, with_estimates
from accpinn.methods.estimate import Outcome
from accpinn.recordings import Window
from accpinn.recordings.openacc import read
from accpinn.segment import WindowShortened
from accpinn.serial import flatten
from accpinn.study.run import estimate
from accpinn.study.snapshot import DOCUMENT, named, to_bytes
from accpinn.study.verification import HOWEVER_LONG, QUICK, SOLVED, Check, Verification, verify
from tests.support.driving import driven
from tests.support.samples import FOLDER, NOISY
from tests.support.snapshots import (
    arrays_of,
    members,
    platoon,
    put,
    result_for,
    sealed,
    small,
    trained,
    two_windows,
    whole,
    with_parameters,
)

TOLD = ("analysis.source", "analysis.windows", "origin", "created", "name", "note", "digest")
"""What rests on whoever wrote a file without a recording behind it."""
VARYING = ("seconds", "cached")
SMOOTHED = METHODS["savitzky-golay"].title
PART = ("qualities", "uncertainty", "evaluation")


def fault(found: Verification) -> Check:
    """The first check that fails."""
    assert not found.ok
    return next(check for check in found.checks if not check.ok)


def states(found: Verification) -> dict[tuple[str, str], str]:
    return {(check.part, check.method): check.state for check in found.checks}


def with_parts(result: Result, **changes: Any) -> Result:
    return replace(result, parts=replace(result.parts, **changes))


class TestHonest:
    @pytest.mark.parametrize("honest", [small, whole, two_windows])
    def test_all_is_reproduced_or_recomputed_with_the_data(
        self, honest: Callable[[], Result]
    ) -> None:
        asked: list[str] = []
        found = verify(load(to_bytes(honest())), on_refit=lambda name, _: asked.append(name))
        assert found.ok, found.sentence
        assert len(asked) == 1 + len(honest().compared)
        assert {check.part for check in found.unchecked} <= {"data"}
        kinds = states(found)
        assert kinds["fit", ""] == "reproduced"
        assert {kinds[part, ""] for part in PART} == {"recomputed"}
        if honest is whole:
            assert kinds["curves", ""] == "recomputed"
            assert kinds["fit", "Least squares"] == kinds["holdout", SMOOTHED] == "reproduced"

    def test_methods_compared_in_the_first_of_two_windows_have_its_data(self) -> None:
        joint = two_windows()
        (segment, _), asked = joint.segments, joint.analysis
        alone = replace(asked, windows=asked.windows[:1], method="least-squares")
        rows = (estimate(alone, (segment,)),)
        found = verify(named(replace(joint, compared=rows), with_data=True))
        assert found.ok, found.sentence
        assert states(found)["fit", "Least squares"] == "reproduced"

    def test_without_the_data_the_recording_stands_in(self) -> None:
        bare = load(to_bytes(replace(whole(), segments=())))
        found = verify(bare)
        assert found.ok
        assert {check.cure for check in found.unchecked} == {"--recording"}
        assert {*states(found).values()} == {"recomputed", "not checked"}, "curves need no data"
        renamed = replace(platoon(), source="renamed.csv")
        found = verify(bare, renamed, refit_within=QUICK)
        assert found.ok, found.sentence
        assert states(found)["info", ""] == states(found)["facts", ""] == "recomputed"
        assert {check.cure for check in found.unchecked} == {"--refit"}

    def test_a_window_that_was_shortened(self) -> None:
        recording = read(FOLDER / f"{NOISY}.csv")
        window = Window(recording.duration - 60, recording.duration + 240)
        result = run(Analysis.of(recording, [window], method="splines"), recording)
        assert any(isinstance(finding, WindowShortened) for finding in result.info.findings)
        assert verify(load(to_bytes(named(result))), recording).ok

    def test_what_takes_minutes_is_left_to_whoever_asks_for_it(self) -> None:
        """However short a time the file itself tells."""
        settings = preset("paper").to_json()
        fit = replace(whole().fit, config=settings, seconds=0.001)
        analysis = replace(whole().analysis, settings=settings)
        found = verify(replace(whole(), analysis=analysis, fits=(fit,), compared=()))
        (left,) = [check for check in found.unchecked if check.cure == "--refit"]
        assert (left.part, left.seconds > 120) == ("fit", True)

    def test_a_stopped_training_cannot_be_run_again(self) -> None:
        fit = replace(whole().fit, outcome=Outcome.STOPPED)
        found = verify(replace(whole(), fits=(fit,), compared=()), refit_within=HOWEVER_LONG)
        assert found.ok
        assert states(found)["fit", ""] == "not checked"

    @pytest.mark.parametrize(("factor", "ok"), [(1.0 + 1e-5, True), (1.2, False)])
    def test_draws_of_another_processor_pass_and_others_do_not(
        self, factor: float, ok: bool
    ) -> None:
        known = small().uncertainty
        draws = Parameters.of(known.draws.values * factor)
        other = with_estimates(
            from_draws(known.centre, draws, known.level), small().segments[0], small().fit
        )
        assert verify(with_parts(small(), uncertainty=other)).ok == ok

    @pytest.mark.parametrize("factor", [1.0 + 1e-5, 1.1])
    def test_only_parameters_of_an_iterative_training_count_on_another_processor(
        self, factor: float
    ) -> None:
        fit = replace(trained().fit, loss={"total": 1.0})
        fit = replace(fit, parameters=Parameters.of(fit.parameters.values * factor))
        other = replace(whole(), fits=(fit,), compared=())
        found = [check for check in verify(other).checks if check.part == "fit"]
        assert [check.ok for check in found] == [factor < 1.01]


def evaluated(result: Result, **changes: Any) -> Result:
    """With another evaluation of the first method compared."""
    first, *others = result.compared
    changed = with_parts(first, evaluation=replace(first.evaluation, **changes))
    return replace(result, compared=(changed, *others))


def better(errors: Any) -> Any:
    return replace(errors, gap_mae=errors.gap_mae / 2)


class TestForged:
    def test_errors_of_a_method_compared_and_blocks_held_out(self) -> None:
        evaluation = whole().compared[0].evaluation
        for changes in ({"closed_loop": better(evaluation.closed_loop)}, {"holdout": None}):
            found = fault(verify(evaluated(whole(), **changes), refit_within=QUICK))
            assert (found.part, found.method) == ("evaluation", "Least squares")
        own = tuple(replace(one, errors=better(one.errors)) for one in evaluation.blocks)
        forged = evaluated(whole(), blocks=own, holdout=of_blocks(own))
        found = fault(verify(forged))
        assert (found.part, found.state) == ("holdout", "reproduced")

    def test_errors_outside_the_window(self) -> None:
        evaluation = trained().evaluation
        evaluation = replace(evaluation, out_of_window=better(evaluation.out_of_window))
        bare = load(to_bytes(named(with_parts(trained(), evaluation=evaluation))))
        assert fault(verify(bare, platoon(), refit_within=QUICK)).part == "evaluation"

    def test_another_recording_or_other_names(self) -> None:
        found = verify(replace(whole(), segments=()), read(FOLDER / f"{NOISY}.csv"))
        assert fault(found).part == "data"
        assert "not the recording" in found.sentence
        info = replace(whole().info, names=("Lada",) * 5)
        bare = replace(whole(), infos=(info,), segments=())
        assert fault(verify(bare, platoon(), refit_within=QUICK)).part == "info"

    def test_weights_that_give_other_curves(self) -> None:
        zero = {name: np.zeros_like(values) for name, values in whole().fit.arrays.items()}
        for arrays in (zero, {}):
            forged = replace(whole().fit, arrays=arrays)
            found = verify(replace(whole(), fits=(forged,), segments=()))
            assert fault(found).part == "curves"

    def test_a_headway_no_method_found_with_all_that_follows_from_it(self) -> None:
        forged = load(to_bytes(with_parameters(small(), [1, 1, 0.6])))
        believed = verify(forged, refit_within=QUICK)
        assert believed.ok
        assert states(believed)["fit", ""] == "not checked"
        found = fault(verify(forged))
        assert (found.part, found.state) == ("fit", "reproduced")
        assert found.stored != found.computed
        assert found.stored.startswith(f"τ {forged.parameters.tau[0]:.4g}"[:6])

    @pytest.mark.parametrize(("name", "factor"), [("unknowns", 3.0), ("disturbance", 10.0)])
    def test_disturbances_that_no_likelihood_has(self, name: str, factor: float) -> None:
        fit = (said := likely()).fit
        arrays = fit.arrays | {name: factor * fit.arrays[name]}
        forged = replace(said, fits=(replace(fit, arrays=arrays),))
        assert METHODS["maximum-likelihood"].tolerance > SOLVED, "digits depend on the processor"
        assert verify(said).ok
        assert fault(verify(forged)).part == "disturbances"

    def test_a_term_of_the_estimate_that_its_intervals_do_not_have(self) -> None:
        uncertainty = (said := likely()).uncertainty
        centre = Parameters.of(uncertainty.centre.complete * [1, 1, 1, 10, 1, 3])
        forged = with_parts(said, uncertainty=replace(uncertainty, centre=centre))
        assert fault(verify(forged, refit_within=QUICK)).part == "uncertainty"

    def test_every_number_that_is_changed_is_found(self) -> None:
        """One field of the whole tree after the other, of a list one member, sealed anew."""
        forms = result_for(driven(duration=20.0, step=0.5)).adequacy
        data = to_bytes(with_parts(small(), adequacy=forms))
        tree, arrays = json.loads(members(data)[DOCUMENT]), arrays_of(data)
        met, missed = Counter[str](), []
        fields = {re.sub(r"\.\d+", "", place): (place, leaf) for place, leaf in flatten(tree)}
        for place, leaf in fields.values():
            if place.startswith(TOLD) or place.endswith(VARYING):
                continue
            forged = deepcopy(tree)
            put(forged, place.split("."), other_than(leaf))
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
        assert met["found"] >= 40
        assert met["refused"] >= 5


@cache
def likely() -> Result:
    """Of maximum likelihood, with its data."""
    made = driven(duration=60.0, step=0.5)
    return named(result_for(made, "maximum-likelihood"), "likely", with_data=True)


def other_than(leaf: Any) -> Any:
    """Another value of the same kind."""
    if isinstance(leaf, bool):
        return not leaf
    if isinstance(leaf, int | float):
        return leaf + 1 if isinstance(leaf, int) else leaf * 1.1 + 0.01
    return f"{leaf}x" if isinstance(leaf, str) else 0.5
