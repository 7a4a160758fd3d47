"""Results for other programs: vehicle types of the traffic simulator SUMO, and a parameter card.

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
from typing import TYPE_CHECKING, Any
from xml.etree import ElementTree

import msgspec
import numpy as np

from accpinn.channels import PARAMETERS
from accpinn.errors import ConfigError, ParameterError
from accpinn.findings import Labelled
from accpinn.inference.answer import SPEEDS, Answer, Span
from accpinn.inference.gain_check import GainCheck
from accpinn.inference.posterior import AT_SPEED
from accpinn.inference.trust import Trust
from accpinn.methods.following import LEVEL
from accpinn.model.cthp import Parameters
from accpinn.model.idm import IDM
from accpinn.model.registry import PAPER
from accpinn.recordings.catalogue import make_and_model
from accpinn.results.messages import messages
from accpinn.segment.segment import SegmentInfo
from accpinn.stability.report import stability_at
from accpinn.study.judge import Judgement, ModelScore, wins
from accpinn.study.result import Result
from accpinn.study.snapshot import ATTRIBUTION_TEXT
from accpinn.units import Estimate, FloatArray, MetresPerSecond, Seconds

if TYPE_CHECKING:  # loads pandas, which few commands need
    from accpinn.study.groups import Groups

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
    " Car-following model ACC as the CTHP: use it with the ballistic step method and steps of 0.05"
    " s. minGap is the intercept s0, actionStepLength twice the delay. accel, decel and maxSpeed"
    " are set so that they do not interfere; choose realistic ones for traffic. "
)
ABOUT_IDM = (
    " Car-following model IDM: use it with the ballistic step method and steps of 0.05 s. maxSpeed"
    " is the desired speed v0, on lanes that allow as much; actionStepLength is twice the delay. "
)
SUMO_IDM = {"a": "accel", "b": "decel", "T": "tau", "s0": "minGap", "v0": "maxSpeed"}
"""Names of the IDM's parameters in SUMO."""
CARD_FORMAT = "accpinn parameter card 1"


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
        speeds: (M,) in m/s, at which the time gap holds where s₀ is negative.
        model: whose parameters; the IDM is SUMO's own, others are as linearised.

    Raises:
        ParameterError: where a follower's τ is undetermined.
    """
    root = ElementTree.Element("additional")
    root.append(ElementTree.Comment(ABOUT_IDM if _is_idm(model) else ABOUT_ACC))
    speeds = np.full(len(names), AT_SPEED) if speeds is None else speeds
    for k, (name, speed) in enumerate(zip(names, speeds.tolist(), strict=True)):
        label = _identifier(name, k)
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


def _is_idm(model: str) -> bool:
    return model.split("-")[0] == IDM.key


def _type(
    label: str, parameters: Parameters, speed: MetresPerSecond, model: str
) -> ElementTree.Element:
    alpha, beta, tau, s0, lag, delay = parameters.complete.tolist()
    if _is_idm(model):
        name, values = "IDM", zip(IDM.names, parameters.own.tolist(), strict=False)
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


def _identifier(name: str, follower: int) -> str:
    """As "F1_Audi_A6"."""
    return f"F{follower + 1}_{re.sub(r'[^A-Za-z0-9.-]+', '_', name).strip('_') or 'vehicle'}"


def snapshot_types(snapshot: Result, samples: int = SAMPLES) -> str:
    """The additional file for SUMO of a snapshot: its answer, and draws of the typical value.

    Args:
        snapshot: a result with its answer.
        samples: number of draws in a distribution, evenly chosen; 0 for no distribution.

    Raises:
        ParameterError: where a follower's τ is undetermined.
        ConfigError: for a number of samples that is not allowed.
    """
    if samples < 0:
        raise ConfigError(f"samples: {samples} is not allowed; choose 0 or more.")
    answer = snapshot.answer
    draws = None
    if samples:
        most = len(answer.typical.alpha)
        count = min(samples, most)
        draws = answer.typical[((np.arange(count) + 0.5) * most / count).astype(int)]
    names = snapshot.info.names[1:]
    return sumo_types(names, answer.parameters, draws, answer.speeds, answer.model)


def parameter_card(snapshot: Result) -> dict[str, Any]:
    """The parameters of a snapshot with intervals, provenance and attribution, ready for JSON."""
    info, fit, uncertainty = snapshot.info, snapshot.fit, snapshot.uncertainty
    return {
        "format": CARD_FORMAT,
        "model": {
            "name": "constant time-headway policy",
            "equations": ["dp/dt = Δv", "dv/dt = α (p - τ v) + β Δv"],
            "units": {quantity.key: quantity.unit for quantity in PARAMETERS},
        },
        "level": uncertainty.level,
        "interval_method": uncertainty.method,
        "vehicles": [_card_of(snapshot, k) for k in range(info.followers)],
        "answer": answer_document(info, snapshot.answer),
        "provenance": {
            "source": info.source,
            "sha256": info.sha256,
            "start": info.window.start,
            "duration": info.window.duration,
            "vehicles": list(info.vehicles),
            **{key: snapshot.facts.get(key) for key in ("campaign", "date", "distance_setting")},
            "method": fit.method,
            "case": fit.case,
            "settings": fit.config,
            "outcome": fit.outcome.name.lower(),
            "snapshot": snapshot.id,
            "created": snapshot.created,
            "accpinn": snapshot.origin.accpinn,
        },
        "attribution": ATTRIBUTION_TEXT,
    }


def answer_document(info: SegmentInfo, answer: Answer) -> list[dict[str, Any]]:
    """The answer as every document has it: one entry a follower, ready for JSON."""
    entries = []
    for k, (vehicle, name) in enumerate(zip(info.vehicles[1:], info.names[1:], strict=True)):
        spans = {parameter: answer.span(parameter, k) for parameter in answer.names}
        median = float(answer.speeds[k])
        gaps = {f"{speed * 3.6:.0f}": answer.time_gap(speed, k) for speed in SPEEDS}
        gaps["median"] = answer.time_gap(median, k)
        entries.append(
            {
                "vehicle": vehicle,
                "name": name,
                "model": answer.model,
                **_spans(spans, gaps),
                "median_speed": median,
                "windows": len(answer.windows),
                "windows_differ_p": float(answer.differ[k]),
                "trust": _trust_document(answer.trust[min(k, len(answer.trust) - 1)]),
                "level": answer.level,
            }
        )
    return entries


def _spans(parameters: dict[str, Span], gaps: dict[str, Span]) -> dict[str, Any]:
    """Values and intervals of parameters by name and of time gaps by speed."""
    document: dict[str, Any] = {}
    for prefix, named, spans in (("", "parameters", parameters), ("time_gap_", "time_gap", gaps)):
        document[named] = {key: span.value for key, span in spans.items()}
        document[f"{prefix}intervals"] = {key: [s.lower, s.upper] for key, s in spans.items()}
        document[f"{prefix}further_window"] = {
            key: [s.further_lower, s.further_upper] for key, s in spans.items()
        }
    return document


def groups_document(grouped: "Groups") -> dict[str, Any]:
    """The groups of a batch, ready for JSON."""
    return {
        "by": list(grouped.by),
        "model": grouped.model,
        "level": grouped.level,
        "groups": [
            {
                **dict(zip(grouped.by, group.values, strict=True)),
                "windows": group.windows,
                "vehicles": group.vehicles,
                **_spans(
                    {name: group.span(name) for name in group.names},
                    {f"{speed * 3.6:.0f}": group.time_gap(speed) for speed in SPEEDS},
                ),
                **{name: {key: _estimate(spread) for key, spread in getattr(group, name).items()}
                   for name in ("between_windows", "between_vehicles")},
                "mean_time_gap": {
                    "median": group.mean_time_gap.value,
                    "quartiles": [group.mean_time_gap.lower, group.mean_time_gap.upper],
                },
                "l2_stable": _estimate(group.l2_stable),
                "linf_stable": _estimate(group.linf_stable),
            }
            for group in grouped.groups
        ],
    }  # fmt: skip


def _estimate(of: Estimate) -> dict[str, float]:
    return {"value": of.value, "low": of.lower, "high": of.upper}


def _trust_document(trust: Trust) -> dict[str, Any]:
    document = msgspec.structs.asdict(trust)
    del document["vehicle"]
    return {**document, "reproduced": trust.is_reproduced, "in_words": trust.in_words}


def check_document(check: GainCheck, about: Labelled) -> dict[str, Any]:
    """How far the answer's gain is from the measured one, ready for JSON."""
    return {**msgspec.structs.asdict(check), "sentence": check.sentence(about)}


def judgement_document(judged: Judgement) -> dict[str, Any]:
    """The models of one follower as the command line and files have them, ready for JSON."""
    low, speed, high = judged.speeds
    return {
        "vehicle": judged.info.vehicles[1],
        "name": judged.info.names[1],
        "windows": [[window.start, window.duration] for window in judged.windows],
        "speeds": {"low": low, "median": speed, "high": high},
        "models": [
            _score_document(score, speed, share)
            for score, share in zip(judged.scores, wins([judged]), strict=True)
        ],
        "best": judged.ranked[0].model.key,
        "clear": judged.is_clear,
        "sentences": messages(judged.findings, judged.info),
    }


def _score_document(score: ModelScore, speed: MetresPerSecond, share: float) -> dict[str, Any]:
    model, vehicle = score.model, stability_at(score.model, score.theta, speed)
    named = zip(model.names, score.theta, score.lower, score.upper, score.determined, strict=True)
    return {
        "model": model.key,
        "title": model.title,
        "parameters": {
            name: {"value": value, "interval": [low, high], "determined": bool(known)}
            for name, value, low, high, known in named
        },
        "level": LEVEL,
        "gap_rmse": score.rmse.tolist(),
        "time_gap_rmse": score.time_gap_rmse.tolist(),
        "collided": score.collided.tolist(),
        "wins": float(share),
        "gain_error": score.gain_error,
        "stability": vehicle
        and {
            "speed": speed,
            "peak_db": vehicle.peak.db,
            "l2_stable": vehicle.l2.stable,
            "linf_gain": vehicle.linf_gain,
        },
    }


def _card_of(snapshot: Result, k: int) -> dict[str, Any]:
    uncertainty, name = snapshot.uncertainty, snapshot.info.names[k + 1]
    make, model = make_and_model(name)
    card: dict[str, Any] = {
        "vehicle": snapshot.info.vehicles[k + 1],
        "name": name,
        "make": make,
        "model": model,
    }
    sets = (snapshot.parameters, uncertainty.lower, uncertainty.upper)
    ends = (parameters[k].values.tolist() for parameters in sets)
    for quantity, value, low, high in zip(PARAMETERS, *ends, strict=True):
        card[quantity.key] = {"value": value, "low": low, "high": high, "unit": quantity.unit}
    card["probability_l2_stable"] = float(uncertainty.probability_l2[k])
    card["probability_linf_stable"] = float(uncertainty.probability_linf[k])
    return card
