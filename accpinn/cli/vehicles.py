"""`stability`, `simulate`, `drive`: how vehicles amplify disturbances, and what tells more."""

import argparse
from math import isnan
from pathlib import Path
from typing import Any

from accpinn.channels import PARAMETER_KEYS, PARAMETERS, fields
from accpinn.cli.output import show_result
from accpinn.cli.recordings import JSON, option
from accpinn.errors import ConfigError, SnapshotError
from accpinn.inference.intervals import Uncertainty
from accpinn.model.cthp import TERMS, Parameters
from accpinn.model.published import ParameterSet
from accpinn.platoon import order_of, simulate_platoon
from accpinn.platoon.leader import Sinusoid
from accpinn.results.cast import Cast
from accpinn.results.documents import check_document, drive_document
from accpinn.results.messages import messages
from accpinn.results.messages.estimate import assumption, contradictions
from accpinn.results.messages.next_drive import ABOUT_DRIVE, drive_in_words
from accpinn.results.messages.platoon import (
    disturbance,
    growth_of,
    measured_growth,
    most_amplified,
    smallest_gap,
)
from accpinn.results.messages.stability import (
    about_margin,
    explained,
    headline,
    measured_gain_sentences,
    platoon_reasons,
    reason,
    reasons,
    waves_in_words,
)
from accpinn.results.tables.next_drive import drive_table
from accpinn.results.tables.stability import (
    amplitude_table,
    assessment_table,
    margin_table,
    verdicts_part,
)
from accpinn.stability import VehicleStability, Verdict
from accpinn.stability.margin import VehicleMargin
from accpinn.stability.waves import PARTS, LargestGrowth
from accpinn.study.next_drive import LIMITS, next_drive
from accpinn.study.vehicles import AssessedVehicles, PeakGrowth, assessed_vehicles

PLATOON = ("l2_strict", "l2_weak", "linf_strict", "linf_weak")
GROWTH = ("omega", "gain", "lower", "upper", "model", "is_measured", "level")
MEASURED = ("omega", "gain", "lower", "upper", "coherence", "coherent", "level", "averages")

STABILITY_OPTIONS = (
    option("file", nargs="?", metavar="SNAPSHOT", help="take the estimate of a snapshot instead"),
    *(option(f"--{parameter.key}", type=float, nargs="+", metavar=parameter.key[0].upper(),
             help=f"{parameter.symbol} in {parameter.unit}, one value a vehicle")
      for parameter in PARAMETERS),
    *(option(f"--{term}", type=float, nargs="+", metavar=unit.upper(),
             help=f"of models that have it, in {unit}; one value, or one a vehicle (0)")
      for term, unit in (("s0", "m"), ("lag", "s"), ("delay", "s"))),
    option("--snapshot", metavar="FILE", help="the same as SNAPSHOT"),
    JSON,
)  # fmt: skip
"""α, β, τ with one value a vehicle, first follower first; or a snapshot."""
SIMULATE_OPTIONS = (
    *STABILITY_OPTIONS,
    option("--followers", "--vehicles", dest="vehicles", type=int, metavar="N",
           help="one parameter set is repeated (8)"),
    *(option(f"--{name}", type=float, default=default, help=f"{meaning} ({default:g})")
      for name, default, meaning in (
          ("frequency", 0.25, "of the sinusoid in rad/s"),
          ("amplitude", 1.0, "of the leader's speed in m/s"),
          ("speed", 20.0, "of the equilibrium in m/s"),
          ("settle", 20.0, "steady driving first, in s"),
          ("duration", 500.0, "of the whole run in s"),
      )),
)  # fmt: skip
"""The defaults are the paper's simulation."""
DRIVE_OPTIONS = (
    option("file", metavar="SNAPSHOT", help="a snapshot (.accpinn.zip) of an estimate of a CTHP"),
    option("--vehicle", type=int, metavar="N", help="a follower (the first that is determined)"),
    *(option(f"--{name}", type=float, default=default, help=f"{meaning} ({default:g})")
      for name, default, meaning in (
          ("duration", 120.0, "of the drive in s"),
          ("slowest", 15.0, "least speed of the car ahead in m/s"),
          ("fastest", 33.0, "its largest speed in m/s"),
          ("acceleration", 2.0, "its largest acceleration and braking in m/s²"),
      )),
    option("--out", metavar="CSV", help="write the drive as a table of time and speed"),
    JSON,
)  # fmt: skip


def _chosen(options: argparse.Namespace) -> AssessedVehicles:
    """The vehicles that the options give, or those of a snapshot.

    Raises:
        ConfigError: when they are missing, given twice, or differ in number.
        SnapshotError: when the snapshot cannot be read, or determines nothing.
    """
    given = {name: getattr(options, name) for name in (*PARAMETER_KEYS, *TERMS)}
    given = {name: values for name, values in given.items() if values}
    if options.file and options.snapshot:
        raise ConfigError("snapshot: give one snapshot, not two.")
    if path := options.file or options.snapshot:
        for name in given:
            raise ConfigError(f"parameters: give --{name} or --snapshot, not both.")
        from accpinn.study.snapshot import load  # not needed for numbers given by hand

        subject = assessed_vehicles(load(path))
        if not subject.has_report:
            raise SnapshotError(
                f"{path}: its data determine no parameters, so nothing follows for string"
                " stability; estimate them from a longer window with more braking."
            )
        return subject
    missing = [f"--{name}" for name in PARAMETER_KEYS if name not in given]
    if missing:
        listed = " and ".join(missing)
        raise ConfigError(f"parameters: {listed} missing; give all three, or --snapshot FILE.")
    counts = {name: len(values) for name, values in given.items()}
    count = counts["alpha"]
    if not count == counts["beta"] == counts["tau"]:
        listed = ", ".join(f"{counts[name]} of --{name}" for name in PARAMETER_KEYS)
        raise ConfigError(f"parameters: {listed}; give as many of each as there are vehicles.")
    for name, number in counts.items():
        if number not in (1, count):
            raise ConfigError(f"parameters: {number} of --{name}; give one, or {count}.")
    labels = tuple(f"Vehicle {k + 1}" for k in range(count))
    return AssessedVehicles(ParameterSet("parameters given", labels, Parameters(**given)))


def run_stability(options: argparse.Namespace) -> int:
    """Assess vehicles one by one and together, and print the verdicts."""
    subject = _chosen(options)
    show_result(options, lambda: _describe_report(subject), lambda: _report_text(subject))
    return 0


def _describe_report(subject: AssessedVehicles) -> dict[str, Any]:
    """The report as the command-line contract has it."""
    report, snapshot = subject.report, subject.result
    platoon, numbers = report.platoon, subject.vehicles.vehicles[1:]
    gains = snapshot.measured_gains if snapshot else [None] * len(numbers)
    uncertainty, waves = subject.uncertainty, subject.waves
    checks = {c.vehicle: c for c in subject.checks}
    growth = subject.measured_growth(range(len(numbers)))
    return {
        "vehicles": [
            {"label": subject.vehicles.labels[k]}
            | _describe_vehicle(vehicle)
            | {"margin": _describe_margin(subject.margins.vehicles[k], uncertainty is not None)}
            | ({"waves": _describe_waves(waves.vehicles[k])} if waves else {})
            | (_describe_uncertainty(uncertainty, k) if uncertainty else {})
            | {
                "measured": gain and fields(gain, *MEASURED),
                "growth": _describe_growth(subject.growths[k]),
                "measured_check": checks.get(number)
                and check_document(checks[number], subject.vehicles),
            }
            for k, (vehicle, gain, number) in enumerate(
                zip(report.vehicles, gains, numbers, strict=True)
            )
        ],
        "platoon": {
            "margin": subject.margins.platoon and subject.margins.platoon.value,
            "growth": _describe_growth(subject.platoon_growth),
            "measured": snapshot
            and (measured := snapshot.head_to_tail_gain)
            and fields(measured, *MEASURED),
            "measured_growth": growth and fields(growth, *GROWTH),
            "explanation": explained(subject) or None,
            "head_to_tail_peaks": [vars(peak) for peak in platoon.peaks],
            "head_to_tail_linf": platoon.linf.gain.tolist(),
            "head_to_tail_linf_error": platoon.linf.error.tolist(),
            **{
                name: _verdict(verdict, why)
                for name, (verdict, why) in zip(PLATOON, platoon_reasons(subject), strict=True)
            },
        },
    }


def _describe_growth(growth: PeakGrowth) -> dict[str, Any]:
    """The largest growth, with an interval where it has one."""
    has_ends = not isnan(growth.gain.lower)
    return {
        "gain": growth.gain.value,
        "interval": [growth.gain.lower, growth.gain.upper] if has_ends else None,
        "omega": growth.omega,
        "model_gain": growth.model,
        "is_measured": growth.is_measured,
    }


def _describe_vehicle(vehicle: VehicleStability) -> dict[str, Any]:
    smallest = vehicle.smallest_tau
    verdicts = (
        ("l2", vehicle.l2, {"criterion": vehicle.l2.value}),
        ("linf_paper", vehicle.linf_paper, {"criterion": vehicle.linf_paper.value}),
        ("linf_exact", vehicle.linf_exact, {"gain": vehicle.linf_gain}),
    )
    return {
        **fields(vehicle.parameters, *PARAMETER_KEYS, *TERMS),
        **{key: criterion | _verdict(v, reason(v, vehicle)) for key, v, criterion in verdicts},
        **fields(vehicle, "crossover", "onset", "overshoot", "damping_ratio"),
        "peak": vars(vehicle.peak),
        "poles": [[pole.real, pole.imag] for pole in vehicle.poles],
        "smallest_tau": smallest and vars(smallest),
    }


def _describe_uncertainty(uncertainty: Uncertainty, k: int) -> dict[str, Any]:
    """Probabilities and intervals of a vehicle's stability."""
    spans = {name: getattr(uncertainty, name) for name in ("peak_gain", "linf_gain")}
    return {
        "probability_l2": uncertainty.probability_l2[k],
        "probability_linf": uncertainty.probability_linf[k],
        "level": uncertainty.level,
        "intervals": {name: [span.lower[k], span.upper[k]] for name, span in spans.items()},
    }


def _describe_margin(margin: VehicleMargin, with_intervals: bool) -> dict[str, Any]:
    """The time gap and the margins of a vehicle in s.

    An infinite margin becomes null; the state tells why.
    """
    norms = {
        name: {
            "smallest": norm.smallest.value,
            "margin": norm.distance.value,
            "state": norm.state.name.lower(),
            **({"interval": [norm.distance.lower, norm.distance.upper]} if with_intervals else {}),
        }
        for name, norm in (("l2", margin.l2), ("linf_exact", margin.linf))
    }
    return {"time_gap": margin.time_gap.value, **norms}


def _describe_waves(growth: LargestGrowth) -> list[dict[str, float]]:
    """The growth of waves of each size, in m/s."""
    rows = zip(*(getattr(growth, part).tolist() for part in PARTS), strict=True)
    return [dict(zip(PARTS, row, strict=True)) for row in rows]


def _verdict(verdict: Verdict, why: str) -> dict[str, Any]:
    return {**fields(verdict, "stable", "marginal"), "reason": why}


def _report_text(subject: AssessedVehicles) -> str:
    vehicles, lines = subject.vehicles, [verdicts_part(assessment_table(subject)).to_text(), ""]
    lines += [margin_table(subject).to_text(), about_margin(subject), ""]
    if subject.result:
        lines += [headline(subject), assumption(subject.result)]
        lines += [explained(subject)] if explained(subject) else []
    lines += [waves_in_words(subject.waves)] if subject.waves else []
    lines += contradictions(subject.result)
    lines += measured_gain_sentences(subject.checks, vehicles)
    for k, (label, verdicts) in enumerate(reasons(subject)):
        for verdict, why in verdicts:
            title = verdict.criterion.value
            of_platoon = f"Platoon, {title}: {verdict.word}. {why}"
            lines.append(f"{label}, {title}: {why}" if k < len(vehicles) else of_platoon)
    return "\n".join(lines)


def run_simulate(options: argparse.Namespace) -> int:
    """Simulate a platoon behind a sinusoidal leader, and print amplitudes and gaps."""
    leader = Sinusoid(
        options.frequency, options.amplitude, options.speed, options.settle, options.duration
    )
    subject = _chosen(options)
    vehicles = subject.vehicles
    count = 8 if options.vehicles is None and len(vehicles) == 1 else options.vehicles
    order = order_of(len(vehicles), count)
    result = simulate_platoon(vehicles.parameters[order], leader, model=vehicles.model)
    cast = Cast(vehicles, tuple(order))
    warnings = (*messages(result.findings, cast), *contradictions(subject.result, order))

    def document() -> dict[str, Any]:
        waves, grows = result.amplitudes, growth_of(subject, cast, result)
        assert waves is not None  # behind a sinusoid there are some
        measured = waves.measured.tolist()
        return {
            # After a collision it means nothing.
            "amplitude": measured[: result.survivors] + [None] * (len(measured) - result.survivors),
            "predicted_amplitude": waves.predicted.tolist(),
            "growth_interval": grows and [grows.lower, grows.upper],
            "settled": waves.settled.tolist(),
            **fields(result, "minimum_gap", "minimum_gap_time"),
            "collisions": [fields(event, "follower", "time") for event in result.collisions],
            "warnings": warnings,
        }

    def text() -> str:
        labels = [cast.label(k) for k in range(len(result.largest_deviation))]
        growth = disturbance(result, cast, growth_of(subject, cast, result))
        measured = measured_growth(subject, cast, result)
        extremes = most_amplified(result), smallest_gap(result, cast)
        sentences = filter(None, (growth, measured, *extremes))
        notes = [f"Note: {warning}" for warning in warnings]
        return "\n".join([amplitude_table(result, labels).to_text(), "", *sentences, *notes])

    show_result(options, document, text)
    return 0


def run_drive(options: argparse.Namespace) -> int:
    """Propose the drive of the car ahead that narrows a follower's intervals most."""
    from accpinn.study.snapshot import load, writable_path, write_file

    place = None if options.out is None else writable_path(Path(options.out), "drive")
    limits = {name: getattr(options, name) for name in LIMITS}
    proposed = next_drive(load(options.file), vehicle=options.vehicle, **limits)
    if place:
        write_file(proposed.to_csv().encode(), place, "drive")

    def text() -> str:
        table = drive_table(proposed)
        return "\n".join([drive_in_words(proposed), "", table.to_text(), ABOUT_DRIVE])

    show_result(options, lambda: drive_document(proposed), text)
    return 0
