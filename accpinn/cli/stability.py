"""`stability`: what vehicles with given parameters do to disturbances, one by one and together."""

import argparse
from typing import Any

from accpinn.cli.options import add_parameter_options, chosen_parameters
from accpinn.cli.output import print_json, show
from accpinn.model.cthp import Parameters
from accpinn.model.published import ParameterSet
from accpinn.results.messages.stability import TITLES, reason
from accpinn.results.tables.stability import answer, stability_table
from accpinn.stability.frequency import Peak
from accpinn.stability.report import (
    StabilityReport,
    VehicleStability,
    Verdict,
    stability_report,
)

PLATOON = ("l2_strict", "l2_weak", "linf_strict", "linf_weak")


def add_options(parser: argparse.ArgumentParser) -> None:
    """Declare the command's options."""
    add_parameter_options(parser)
    parser.set_defaults(run=run)


def run(options: argparse.Namespace) -> int:
    """Assess, and print the verdicts."""
    parameters = chosen_parameters(options)
    report = stability_report(parameters)
    if options.json:
        print_json(describe(report))
    else:
        show(_text(parameters, report))
    return 0


def describe(report: StabilityReport) -> dict[str, Any]:
    """The report as the command-line contract has it."""
    platoon = report.platoon
    return {
        "vehicles": [_vehicle(vehicle) for vehicle in report.vehicles],
        "platoon": {
            "head_to_tail_peaks": [_peak(peak) for peak in platoon.peaks],
            "head_to_tail_linf": platoon.linf.gain.tolist(),
            "head_to_tail_linf_error": platoon.linf.error.tolist(),
            **{name: _verdict(getattr(platoon, name), report) for name in PLATOON},
        },
    }


def _vehicle(vehicle: VehicleStability) -> dict[str, Any]:
    parameters, smallest = vehicle.parameters, vehicle.smallest_tau
    return {
        "alpha": parameters.alpha,
        "beta": parameters.beta,
        "tau": parameters.tau,
        "l2": {"criterion": vehicle.l2.value, **_verdict(vehicle.l2, vehicle)},
        "linf_paper": {
            "criterion": vehicle.linf_paper.value,
            **_verdict(vehicle.linf_paper, vehicle),
        },
        "linf_exact": {"gain": vehicle.linf_gain, **_verdict(vehicle.linf_exact, vehicle)},
        "peak": _peak(vehicle.peak),
        "crossover": vehicle.crossover,
        "overshoot": vehicle.overshoot,
        "damping_ratio": vehicle.damping_ratio,
        "poles": [[pole.real, pole.imag] for pole in vehicle.poles],
        "smallest_tau": smallest and dict(vars(smallest)),
    }


def _peak(peak: Peak) -> dict[str, Any]:
    return {"gain": peak.gain, "db": peak.db, "omega": peak.omega}


def _verdict(verdict: Verdict, of: VehicleStability | StabilityReport) -> dict[str, Any]:
    why = reason(verdict, of)
    return {"stable": verdict.stable, "marginal": verdict.marginal, "reason": why}


def _text(parameters: Parameters, report: StabilityReport) -> str:
    labels = tuple(f"Vehicle {k + 1}" for k in range(len(parameters)))
    table = stability_table(ParameterSet("parameters given", labels, parameters), report)
    lines = [table.to_text(), ""]
    for label, vehicle in zip(labels, report.vehicles, strict=True):
        for verdict in (vehicle.l2, vehicle.linf_paper, vehicle.linf_exact):
            lines.append(f"{label}, {TITLES[verdict.criterion]}: {reason(verdict, vehicle)}")
    if len(labels) > 1:
        for name in PLATOON:
            verdict = getattr(report.platoon, name)
            title, why = TITLES[verdict.criterion], reason(verdict, report)
            lines.append(f"Platoon, {title}: {answer(verdict)}. {why}")
    return "\n".join(lines)
