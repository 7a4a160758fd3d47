"""The paper's tables on the real recordings, learned anew: how near, and where not.

Source of the printed values: Apostolakis and Ampountolas, IEEE TVT 2024, Tables I (experiment 1),
II and III. The tolerances are stated per parameter. They are wide for β of AstaZero's second
follower, whose printed value (.1470) is 12 % above the limit that the loss has on this recording.
"""

import os
from functools import cache

import numpy as np
import pytest

from accpinn.evaluation.closed_loop import surrogate_errors
from accpinn.methods import splines
from accpinn.methods.fit import Fit
from accpinn.methods.pinn.config import preset
from accpinn.model.cthp import Case
from accpinn.recordings.openacc import read
from accpinn.segment.cut import cut
from accpinn.segment.segment import Segment
from accpinn.stability.report import stability_report
from tests.support.methods import train

RECORDINGS = {
    "Casale": ("Casale/part7.csv", 0.0),
    "AstaZero": ("AstaZero/ASta_040719_platoon5.csv", 320.0),
}
TABLE_I = np.array([[0.0104, 0.0718, 1.52]])
TABLE_II = np.array([[0.0627, 0.2630, 1.17]] * 4)
TABLE_III = np.array(
    [[0.0612, 0.1200, 1.19], [0.1000, 0.1470, 1.17], [0.0766, 0.2220, 1.16], [0.0409, 0.4450, 1.16]]
)
PRINTED = [
    pytest.param("Casale", "II", TABLE_I, (0.01, 0.01, 0.005), id="Table I"),
    pytest.param("AstaZero", "I", TABLE_II, (0.03, 0.02, 0.005), id="Table II"),
    pytest.param("AstaZero", "II", TABLE_III, (0.06, 0.13, 0.01), id="Table III"),
]
SURROGATE_GAP_MAE = 0.05
"""In m; the paper prints 0.25 to 0.54 m."""


@cache
def segment(campaign: str) -> Segment:
    file, start = RECORDINGS[campaign]
    return cut(read(os.path.join(os.environ["OPENACC_DIR"], file)), start, 300)


@cache
def learned(campaign: str, case: Case, seed: int = 0) -> Fit:
    return train(segment(campaign), case, preset("fast", seed=seed), threads=1)


pytestmark = pytest.mark.usefixtures("openacc_dir")


@pytest.mark.parametrize(("campaign", "case", "printed", "tolerance"), PRINTED)
def test_the_tables_of_the_paper_are_the_limit_of_the_loss(
    campaign: str, case: Case, printed: np.ndarray, tolerance: tuple[float, ...]
) -> None:
    found = learned(campaign, case)
    off = np.abs(found.parameters.values / printed - 1.0)
    assert (off <= tolerance).all(), off
    limit = splines.fit(segment(campaign), case).parameters.values
    off = np.abs(found.parameters.values / limit - 1.0)
    assert (off <= (0.01, 0.02, 0.01)).all(), off
    errors = surrogate_errors(segment(campaign), found)
    assert (errors.gap_mae < SURROGATE_GAP_MAE).all()


def test_verdicts_of_table_iii() -> None:
    """L2 NO for all; by the paper's L∞ criterion YES for the Tesla alone, exactly for none."""
    vehicles = stability_report(learned("AstaZero", "II").parameters).vehicles
    assert [v.l2.stable for v in vehicles] == [False] * 4
    assert [v.linf_paper.stable for v in vehicles] == [False, False, False, True]
    assert [v.linf_exact.stable for v in vehicles] == [False] * 4


def test_seeds_agree() -> None:
    """Table I's five experiments differ in the third decimal; seeds here far less."""
    tables = np.array([learned("Casale", "II", seed).parameters.values[0] for seed in range(3)])
    spread = np.ptp(tables, axis=0) / tables.mean(axis=0)
    assert (spread < 0.002).all(), spread
    assert (spread > 0).any(), "the seed has no effect at all"
