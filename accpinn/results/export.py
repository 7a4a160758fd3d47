"""Vehicle types of the traffic simulator SUMO.

SUMO's car-following model ACC switches between speed control and three forms of gap control (gap
control, gap closing, collision avoidance), each of them

    dv/dt = gainSpace (p - τ v) + gainSpeed Δv

which is the CTHP with gainSpace = α and gainSpeed = β. The same gains in all three make one CTHP of
them, as long as the space-gap is below 100 m, beyond which SUMO changes to speed control. SUMO's p
is the gap beyond minGap, which is s₀; where s₀ is negative, τ + s₀/v at the vehicle's median speed
stands in place of τ. SUMO holds dv/dt for a step: with the ballistic method and steps of 0.05 s one
follower's amplitude differs from that of the CTHP by less than 1 % up to 0.3 rad/s. A command that
is held for T lags by T/2, so actionStepLength = 2 d is the delay d, and 2 λ stands for a lag λ:
with delays of 0.5 and 0.9 s amplitudes are off by less than 1 % up to 0.2 rad/s and by 7 % at
0.4 rad/s.

Source: Milanés and Shladover, Transportation Research Part C 48 (2014) 285-300, and SUMO's
`MSCFModel_ACC`.
"""

import re
from xml.etree import ElementTree

import numpy as np

from accpinn.errors import ConfigError, ParameterError
from accpinn.findings import joined
from accpinn.inference.coordinates import AT_SPEED
from accpinn.inference.posterior import SLOWEST
from accpinn.model.cthp import Parameters
from accpinn.model.registry import FOLLOWING, IDM, PAPER, following_model
from accpinn.study.result import Result
from accpinn.units import FloatArray, MetresPerSecond, Seconds

SAMPLES = 100
"""Number of posterior draws in a distribution of vehicle types."""
GAP_REGIMES = ("gapControl", "gapClosingControl", "collisionAvoidance")
STEP: Seconds = 0.05
"""Step of the simulation that the vehicle types are meant for."""
NOT_BINDING = {
    "accel": "10",
    "decel": "10",
    "emergencyDecel": "10",
    "maxSpeed": "100",
    "speedDev": "0",
}
"""Limits beside the CTHP: m/s², m/s; wide enough not to interfere."""
ABOUT_ACC = (
    " Car-following model ACC as the {model}: use it with the ballistic step method and steps of"
    " 0.05 s. minGap is the intercept s0, actionStepLength twice the delay. accel, decel and"
    " maxSpeed are set so that they do not interfere; choose realistic ones for traffic. "
)
BELOW = (
    "Where s0 is below zero, minGap is 0 and tau is the time gap tau + s0/v at {speeds} m/s, so"
    " that the response there is not quite that of the model. "
)
ABOUT_IDM = (
    " Car-following model IDM: use it with the ballistic step method and steps of 0.05 s. maxSpeed"
    " is the desired speed v0, on lanes that allow as much; actionStepLength is twice the delay. "
)
SUMO_IDM = {"a": "accel", "b": "decel", "T": "tau", "s0": "minGap", "v0": "maxSpeed"}
"""Names of the IDM's parameters in SUMO."""


def sumo_types(
    names: tuple[str, ...],
    parameters: Parameters,
    draws: Parameters | None = None,
    speeds: FloatArray | None = None,
    model: str = PAPER,
) -> str:
    """An additional file for SUMO: one `vType` a follower, and a distribution over its draws.

    Args:
        names: (M,) of the followers; what XML does not allow in an identifier becomes "_".
        parameters: (M,)
        draws: (n, M) of equal weight; without them, and for followers whose draws are nan, there is
            no distribution.
        speeds: (M,) in m/s, at which the time gap holds where s₀ is negative; at least `SLOWEST`.
        model: whose parameters; the IDM is SUMO's own, others are as linearised.

    Raises:
        ParameterError: where a follower's τ is undetermined.

    Examples:
        >>> import accpinn
        >>> cars = accpinn.Parameters([0.08], [0.3], [1.2])
        >>> accpinn.sumo_types(("A car",), cars).count("<vType ")
        1
    """
    following_model(model)
    shapes = [(len(names), 6)] * 2
    given = [parameters.complete.shape, shapes[0] if draws is None else draws.complete.shape[1:]]
    is_one_each = speeds is None or np.shape(speeds) == (len(names),)
    if given != shapes or not is_one_each:
        count = len(names)
        raise ParameterError(
            f"sumo_types: {count} names go with {count} parameter sets, {count} speeds, and draws"
            f" (n, {count}); give as many of each."
        )
    root = ElementTree.Element("additional")
    speeds = np.full(len(names), AT_SPEED) if speeds is None else speeds.clip(min=SLOWEST)
    root.append(ElementTree.Comment(_about(model, parameters, draws, speeds)))
    for k, (name, speed) in enumerate(zip(names, speeds.tolist(), strict=True)):
        allowed = re.sub(r"[^A-Za-z0-9.-]+", "_", name).strip("_")
        label = f"F{k + 1}_{allowed or 'vehicle'}"
        if not np.isfinite(parameters[k].values).all():
            raise ParameterError(f"{name}: τ is undetermined, so SUMO cannot use the parameters.")
        root.append(_type(label, parameters[k], speed, model))
        if draws is None or not np.isfinite(draws[:, k].values).all():
            continue
        mixture = ElementTree.SubElement(root, "vTypeDistribution", id=f"{label}_samples")
        count = len(draws.alpha)
        for i in range(count):
            member = _type(f"{label}_{i}", draws[i, k], speed, model)
            member.set("probability", f"{1 / count:.12g}")
            mixture.append(member)
    ElementTree.indent(root)
    return ElementTree.tostring(root, encoding="unicode", xml_declaration=False) + "\n"


def _about(model: str, parameters: Parameters, draws: Parameters | None, speeds: FloatArray) -> str:
    """What the file holds, and how it is used."""
    if _is_idm(model):
        return ABOUT_IDM
    listed = joined([f"{speed:.1f}" for speed in speeds])
    below = any((sets.s0 < 0).any() for sets in (parameters, draws) if sets is not None)
    following = FOLLOWING[model]
    kind = "CTHP" if following.is_linear else f"{following.title}, linearised at {listed} m/s"
    return ABOUT_ACC.format(model=kind) + (BELOW.format(speeds=listed) if below else "")


def _is_idm(model: str) -> bool:
    return model.split("-")[0] == IDM.key


def _type(
    label: str, parameters: Parameters, speed: MetresPerSecond, model: str
) -> ElementTree.Element:
    alpha, beta, tau, s0, lag, delay = parameters.complete.tolist()
    if _is_idm(model):
        name, values = "IDM", zip(IDM.names, parameters.nonlinear.tolist(), strict=False)
        own = {key: f"{value:.12g}" for key, value in values}
        settings = {SUMO_IDM[key]: value for key, value in own.items() if key in SUMO_IDM}
        settings |= {"emergencyDecel": str(max(10.0, float(own["b"]))), "speedDev": "0"}
    else:
        name, tau = "ACC", max(0.0, tau + min(0.0, s0) / speed)
        settings = {"tau": f"{tau:.12g}"}
        for regime in GAP_REGIMES:
            gains = {"GainSpace": f"{alpha:.12g}", "GainSpeed": f"{beta:.12g}"}
            settings |= {f"{regime}{key}": value for key, value in gains.items()}
        settings |= NOT_BINDING | {"minGap": f"{max(0.0, s0):.12g}"}
    steps = round(2 * (lag + delay) / STEP)
    if steps > 1:
        settings["actionStepLength"] = f"{steps * STEP:.12g}"
    return ElementTree.Element("vType", {"id": label, "carFollowModel": name, **settings})


def snapshot_types(snapshot: Result, samples: int = SAMPLES) -> str:
    """The additional file for SUMO of a snapshot: its estimate, and draws where it has a posterior.

    The samples are the number of draws in a distribution, evenly chosen; 0 for none.

    Raises:
        ParameterError: where a follower's τ is undetermined.
        ConfigError: for a number of samples that is not allowed.
    """
    if samples < 0:
        raise ConfigError(f"samples: {samples} is not allowed; choose 0 or more.")
    estimate, known, draws = snapshot.estimate, snapshot.posterior, None
    if samples and known:
        most = len(known.typical.alpha)
        count = min(samples, most)
        draws = known.typical[((np.arange(count) + 0.5) * most / count).astype(int)]
    names = snapshot.info.names[1:]
    return sumo_types(names, estimate.parameters, draws, estimate.speeds, estimate.model)
