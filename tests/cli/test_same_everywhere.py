"""One parameter set in every document and in Python: the trained estimate is the one shown.

For every method and preset, on two windows: `fit`, its snapshot, `stability` and `simulate` of the
snapshot, and what Python reads from it.
"""

from pathlib import Path

import numpy as np
import pytest

from accpinn import Sinusoid, fit, load, simulate_platoon, stability_report
from accpinn.methods.registry import VARIANTS, variant_of
from tests.support.command import PLATOON, Capture, document

WINDOWS = "10-40,100-130"
TERMS = ("alpha", "beta", "tau", "s0", "lag", "delay")
EXACTLY = {"rel": 1e-9, "abs": 1e-12}
"""Documents hold all digits."""


NONLINEAR = ("pinn-fast", "pinn-paper", "simulation")


@pytest.mark.parametrize(
    ("name", "model"),
    [*((name, None) for name in VARIANTS), *((name, "idm") for name in NONLINEAR)],
)
def test_the_estimate_is_the_same_everywhere(
    name: str, model: str | None, tmp_path: Path, capsys: Capture
) -> None:
    method, config = variant_of(name)
    numbers = "1-2" if model or name == "pinn" else "1-3"  # one follower where each takes long
    preset, few = (config.preset, {}) if config else (None, {})
    if preset in ("fast", "paper"):
        few = {"iterations": 5}
    path = tmp_path / "kept.accpinn.zip"
    options = [part for key, value in {"preset": preset, "model": model, **few}.items() if value
               for part in (f"--{key}", value)]  # fmt: skip
    part = ("--windows", WINDOWS, "--vehicles", numbers, "--method", method)
    fitted = document(capsys, "fit", PLATOON, *part, *options, "--out", path)
    snapshot = load(path)
    expected = snapshot.parameters
    names = dict.fromkeys((*TERMS[:3], *snapshot.estimate.names))

    def of(k: int) -> dict[str, float]:
        return {n: float(snapshot.estimate.values(expected, n)[k]) for n in names}

    for k, row in enumerate(fitted["parameters"]):
        assert {n: row[n] for n in names} == pytest.approx(of(k), **EXACTLY)
    assert ("answer" in fitted) is (snapshot.posterior is not None)
    for k, row in enumerate(fitted.get("answer", ())):
        parameters = {n: of(k)[n] for n in snapshot.estimate.names}
        assert row["parameters"] == pytest.approx(parameters, **EXACTLY)
    report = stability_report(expected)
    vehicles = document(capsys, "stability", path)["vehicles"]
    for k, (row, vehicle) in enumerate(zip(vehicles, snapshot.stability.vehicles, strict=True)):
        terms = {n: float(getattr(expected, n)[k]) for n in TERMS}
        assert {n: row[n] for n in TERMS} == pytest.approx(terms, **EXACTLY)
        peaks = row["peak"]["gain"], vehicle.peak.gain
        assert peaks == pytest.approx([report.vehicles[k].peak.gain] * 2, **EXACTLY)
    if snapshot.uncertainty:
        np.testing.assert_array_equal(snapshot.uncertainty.centre.everything, expected.everything)
    driven = document(capsys, "simulate", path, "--duration", 120, "--followers", len(expected))
    run = simulate_platoon(expected, Sinusoid(duration=120), model=snapshot.estimate.model)
    assert driven["minimum_gap"] == pytest.approx(run.minimum_gap.tolist(), **EXACTLY)
    waves = run.amplitudes.predicted.tolist()
    assert driven["predicted_amplitude"] == pytest.approx(waves, **EXACTLY)
    if model is None:
        again = fit(
            PLATOON, None, None, numbers, windows=WINDOWS, method=method, preset=preset,
            settings=few or None,
        )  # fmt: skip
        np.testing.assert_allclose(again.parameters.everything, expected.everything, rtol=1e-9)
