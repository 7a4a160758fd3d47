"""`stability`: what vehicles with given parameters do to disturbances, one by one and together."""

import argparse
from typing import Any

from accpinn.cli.options import PARAMETER_NAMES, add_parameter_options, chosen_parameters, fields
from accpinn.cli.output import print_json, show
from accpinn.model.cthp import Parameters
from accpinn.model.published import ParameterSet
from accpinn.results.messages.stability import TITLES, reason
from accpinn.results.tables.stability import answer, stability_table
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
            "head_to_tail_peaks": [vars(peak) for peak in platoon.peaks],
            "head_to_tail_linf": platoon.linf.gain.tolist(),
            "head_to_tail_linf_error": platoon.linf.error.tolist(),
            **{name: _verdict(getattr(platoon, name), report) for name in PLATOON},
        },
    }


def _vehicle(vehicle: VehicleStability) -> dict[str, Any]:
    smallest = vehicle.smallest_tau
    found = {
        "l2": {"criterion": vehicle.l2.value},
        "linf_paper": {"criterion": vehicle.linf_paper.value},
        "linf_exact": {"gain": vehicle.linf_gain},
    }
    return {
        **fields(vehicle.parameters, *PARAMETER_NAMES),
        **{name: one | _verdict(getattr(vehicle, name), vehicle) for name, one in found.items()},
        **fields(vehicle, "crossover", "overshoot", "damping_ratio"),
        "peak": vars(vehicle.peak),
        "poles": [[pole.real, pole.imag] for pole in vehicle.poles],
        "smallest_tau": smallest and vars(smallest),
    }


def _verdict(verdict: Verdict, of: VehicleStability | StabilityReport) -> dict[str, Any]:
    return {**fields(verdict, "stable", "marginal"), "reason": reason(verdict, of)}


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
