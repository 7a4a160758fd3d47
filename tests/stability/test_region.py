"""The stable region against the report's verdicts on either side of its boundaries."""

import numpy as np
import pytest

from accpinn import Parameters, stability_report
from accpinn.stability.region import AXES, Plane, stable_region

ENDS: dict[Plane, tuple[float, float]] = {
    "beta": (0.8, 6.0),
    "alpha": (0.3, 6.0),
    "gains": (0.3, 1.5),
}
VEHICLES = {
    "neither": Parameters(0.07, 0.13, 1.2, 4.0),
    "delay": Parameters(0.07, 0.13, 1.2, 4.0, 0.0, 0.5),
    "lag": Parameters(0.07, 0.13, 1.2, 4.0, 0.4),
    "both": Parameters(0.1, 0.4, 2.5, 0.0, 0.2, 0.6),
    "long delay": Parameters(0.1, 0.3, 1.5, 0.0, 0.0, 1.5),
}
ASIDE = 0.012
"""Distance from a boundary at which verdicts are asked for, as a share of the plane's height."""


@pytest.mark.parametrize("plane", AXES)
@pytest.mark.parametrize("name", VEHICLES)
def test_either_side_of_a_boundary_has_the_reports_verdict(plane: Plane, name: str) -> None:
    vehicle, (right, top) = VEHICLES[name], ENDS[plane]
    region, rng = stable_region(vehicle, plane, right, top), np.random.default_rng(0)
    rows, expected = list[np.ndarray](), list[tuple[str, bool]]()
    for norm, limits in (("l2", region.l2), ("linf_exact", region.linf)):
        for k in range(3, len(region.across), 9):
            low, high = limits.lower[k], limits.upper[k]
            points = [(low - ASIDE * top, False), (low + ASIDE * top, low + ASIDE * top < high)]
            points += [(high + ASIDE * top, False)]
            if np.isnan(low):
                points = [(at, False) for at in rng.uniform(0, top, 3)]
            for at, is_stable in points:
                if 0 < at < top:
                    moved = vehicle.complete.copy()
                    moved[[*AXES[plane]]] = region.across[k], at
                    rows.append(moved)
                    expected.append((norm, is_stable))
    assert len(rows) > 30
    report = stability_report(Parameters.of(rows))
    said = [getattr(v, norm).stable for v, (norm, _) in zip(report.vehicles, expected, strict=True)]
    assert said == [is_stable for _, is_stable in expected]


def test_a_long_delay_leaves_no_stable_headway_for_large_gains() -> None:
    region = stable_region(VEHICLES["long delay"], "beta", 0.8, 6.0)
    assert np.isnan(region.l2.lower[-1])
    assert np.isfinite(region.l2.lower[0])
    assert np.isfinite(region.l2.upper[0]), "a delay bounds the headway from above, too"
