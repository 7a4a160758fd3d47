"""The paper's tables on the real recordings, learned anew: how near, and where not.

Source of the printed values: Apostolakis and Ampountolas, IEEE TVT 2024, Tables I (experiment 1),
II and III. The tolerances are stated per parameter. They are wide for β of AstaZero's second
follower, whose printed value (.1470) is 12 % above the limit that the loss has on this recording.
"""

from functools import cache
from pathlib import Path

import numpy as np
import pytest

from accpinn.evaluation.closed_loop import surrogate_errors
from accpinn.methods import splines
from accpinn.methods.estimate import Estimate
from accpinn.methods.pinn.config import preset
from accpinn.methods.registry import METHODS
from accpinn.model.cthp import Case
from accpinn.model.published import ASTAZERO, ASTAZERO_ALIKE, CASALE, ParameterSet
from accpinn.recordings import Recording
from accpinn.recordings.openacc import read
from accpinn.segment import Segment
from accpinn.segment.cut import cut
from accpinn.study import Analysis, single_window
from tests.support.methods import train

LIMIT_I = [[0.01045, 0.07176, 1.5222]]
LIMIT_II = [[0.0638, 0.2604, 1.171]] * 4
LIMIT_III = [
    [0.0615, 0.1197, 1.197], [0.1058, 0.1291, 1.176], [0.0766, 0.2299, 1.152],
    [0.0410, 0.4327, 1.155],
]  # fmt: skip
"""The limits of the loss published with the method, right to one unit of their last digit."""
PRINTED = [
    pytest.param("Casale", "II", CASALE, (0.01, 0.01, 0.005), LIMIT_I, 1.5e-4, id="Table I"),
    pytest.param(
        "AstaZero", "I", ASTAZERO_ALIKE, (0.03, 0.02, 0.005), LIMIT_II, 1e-3, id="Table II"
    ),
    pytest.param("AstaZero", "II", ASTAZERO, (0.06, 0.13, 0.01), LIMIT_III, 1e-3, id="Table III"),
]
SURROGATE_GAP_MAE = 0.05
"""In m; the paper prints 0.25 to 0.54 m."""


@pytest.fixture(scope="module")
def segments(casale: Recording, astazero: Recording) -> dict[str, Segment]:
    return {"Casale": cut(casale, 0, 300), "AstaZero": cut(astazero, 320, 300)}


@cache
def learned(segment: Segment, case: Case, seed: int = 0) -> Estimate:
    return train(segment, case, preset("fast", seed=seed), threads=1)


@pytest.mark.parametrize(("campaign", "case", "printed", "tolerance", "limit", "unit"), PRINTED)
def test_the_tables_of_the_paper_are_the_limit_of_the_loss(
    segments: dict[str, Segment], campaign: str, case: Case, printed: ParameterSet,
    tolerance: tuple[float, ...], limit: list[list[float]], unit: float,
) -> None:  # fmt: skip
    segment = segments[campaign]
    estimate = learned(segment, case)
    off = np.abs(estimate.parameters.values / printed.parameters.values - 1.0)
    assert (off <= tolerance).all(), off
    reached = splines.METHOD.fit(segment, case).parameters.values
    assert (np.abs(reached - limit) <= unit * np.array([0.1, 0.1, 1])).all()
    off = np.abs(estimate.parameters.values / reached - 1.0)
    assert (off <= (0.01, 0.02, 0.01)).all(), off
    (errors,) = surrogate_errors((segment,), estimate)
    assert (errors.gap_mae < SURROGATE_GAP_MAE).all()


def test_the_likelihood_of_standing_vehicles_has_the_larger_maximum(openacc_dir: Path) -> None:
    """Other maxima lie 110 and 528 lower, with another noise of the gap."""
    recording = read(openacc_dir / "ZalaZone" / "handling_part10.csv")
    for vehicles, window, likelihood in (
        ((5, 6), single_window(0.0, 60.0), 157.3),
        ((4, 5), single_window(20.7, 214.3), 34.1),
    ):
        analysis = Analysis.of(recording, window, vehicles, model="cthp")
        segments = analysis.segments(recording)
        estimate = METHODS["pinn"].fit(segments, "II", analysis.config, spec=analysis.spec)
        assert estimate.loss["log_likelihood"] == pytest.approx(likelihood, abs=0.1)


def test_seeds_agree(segments: dict[str, Segment]) -> None:
    """Table I's five experiments differ in the third decimal; seeds here far less."""
    fits = [learned(segments["Casale"], "II", seed) for seed in (0, 1)]
    tables = np.array([fit.parameters.values[0] for fit in fits])
    spread = np.ptp(tables, axis=0) / tables.mean(axis=0)
    assert (spread < 0.002).all(), spread
    assert (spread > 0).any(), "the seed has no effect at all"
