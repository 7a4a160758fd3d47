"""What a method is called wherever people read it."""

from collections.abc import Mapping
from typing import Any

from accpinn.fit import Fit, Outcome
from accpinn.pinn.config import PRESETS

TITLES = {
    "pinn": "PiNN",
    "least-squares": "Least squares",
    "savitzky-golay": "Savitzky-Golay",
    "splines": "Splines",
    "simulation": "Simulation",
    "recursive": "Recursive",
    "particle": "Particle filter",
    "dual-ukf": "Dual UKF",
}


def method_name(method: str, config: Mapping[str, Any], outcome: Outcome) -> str:
    """What a fit is called beside others; a PiNN also by its preset and by what was changed."""
    if method != "pinn":
        return TITLES.get(method, method)
    name = str(config.get("preset", ""))
    usual = PRESETS[name].to_json() if name in PRESETS else {}
    said = [f"{name} preset", *(["own options"] if dict(config) != usual else [])]
    said += ["stopped"] if outcome is Outcome.STOPPED else []
    return f"{TITLES[method]} ({', '.join(said)})"


def name_of(fit: Fit) -> str:
    """The same of a fit."""
    return method_name(fit.method, fit.config, fit.outcome)
