"""One window is trained as it was before trainings took several: numbers of that version."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from accpinn import Estimate, Segment
from accpinn.methods.pinn.config import PAPER
from accpinn.model.registry import FOLLOWING
from accpinn.model.spec import ModelSpec
from accpinn.units import FloatArray
from tests.methods.test_simulation import TRUTHS
from tests.support.driving import MIXED, driven
from tests.support.following import driven as followed
from tests.support.methods import WEIGHTED, train

SHORT = replace(PAPER, iterations=20)
IDM = ModelSpec("idm")


def platoon() -> Segment:
    return driven(MIXED, noise=0.05)


def masked() -> Segment:
    segment = platoon()
    return replace(segment, mask=segment.time[:, None] % 20 >= np.array([2.0, 3.0, 4.0]))


def by_idm() -> Segment:
    (segment,) = followed(FOLLOWING["idm"], TRUTHS["idm"][:1], 3, noise=0.03, seconds=60.0)
    return segment


FORMER: dict[str, tuple[Callable[[], Estimate], list[list[float]]]] = {
    "fast": (
        lambda: train(platoon()),
        [
            [0.08004955823313711, 0.12022537173497203, 1.5001239190320819],
            [0.11001495804310317, 0.2999348444650218, 1.2002779668388337],
            [0.04997120045505343, 0.24953585992545435, 0.9998815574632521],
        ],
    ),
    "fast, Case I, weights and mask": (
        lambda: train(masked(), "I", WEIGHTED),
        3 * [[0.03046062003847612, 0.25630632416482285, 1.2697329996222568]],
    ),
    "fast, idm": (
        lambda: train(by_idm(), spec=IDM),
        [[1.1650368954827, 1.5036333596868, 1.057991423266, 3.41074546296, 37.64700655047]],
    ),
    "fast, idm-lag": (
        lambda: train(by_idm(), spec=ModelSpec("idm-lag")),
        [[1.1800324105, 1.5118725492, 1.0753073584, 3.1695712893, 37.764768263, 0.19590251023]],
    ),
    "paper": (
        lambda: train(platoon(), config=replace(SHORT, lbfgs_iterations=10)),
        [
            [0.714755136724307, 0.9134982240902101, 1.4855863455680107],
            [0.8408858101371588, 0.9732967400797459, 1.169240651743576],
            [0.960733239575762, 0.9744598267934248, 0.9252930288799928],
        ],
    ),
    "paper, idm": (
        lambda: train(by_idm(), config=SHORT, spec=IDM),
        [[0.9897211248682, 2.0250801898248, 1.0983400788011, 3.9906062498745, 38.0319999079]],
    ),
}


@pytest.mark.parametrize("kind", FORMER)
def test_its_parameters_are_the_same(kind: str) -> None:
    estimate, former = FORMER[kind]
    np.testing.assert_allclose(own_values(estimate()), former, rtol=1e-6)


def own_values(estimate: Estimate) -> FloatArray:
    """(M, n) the parameters in the order of their names."""
    return np.column_stack([estimate.values(estimate.parameters, n) for n in estimate.names])
