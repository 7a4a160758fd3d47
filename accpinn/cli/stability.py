"""`stability`: what vehicles with given parameters do to disturbances, one by one and together."""

import argparse
from typing import Any

from accpinn.cli.output import print_json, show, table
from accpinn.cli.parameters import add_parameter_options, chosen_parameters
from accpinn.results.messages.stability import TITLES, reason
from accpinn.stability.frequency import Peak
from accpinn.stability.report import (
    StabilityReport,
    VehicleStability,
    Verdict,
    stability_report,
)


def add_options(parser: argparse.ArgumentParser) -> None:
    """Declare the command's options."""
    add_parameter_options(parser)
    parser.add_argument("--json", action="store_true", help="one JSON document")
    parser.set_defaults(run=run)


def run(options: argparse.Namespace) -> int:
    """Judge, and print the verdicts."""
    result = stability_report(chosen_parameters(options))
    if options.json:
        print_json(describe(result))
    else:
        show(_text(result))
    return 0


def describe(result: StabilityReport) -> dict[str, Any]:
    """The report as the command-line contract has it."""
    platoon = result.platoon
    return {
        "vehicles": [_vehicle(vehicle) for vehicle in result.vehicles],
        "platoon": {
            "head_to_tail_peaks": [_peak(peak) for peak in platoon.peaks],
            "head_to_tail_linf": platoon.linf.gain.tolist(),
            "head_to_tail_linf_error": platoon.linf.error.tolist(),
            "l2_strict": _verdict(platoon.l2_strict, result),
            "l2_weak": _verdict(platoon.l2_weak, result),
            "linf_strict": _verdict(platoon.linf_strict, result),
            "linf_weak": _verdict(platoon.linf_weak, result),
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
        "smallest_tau": None
        if smallest is None
        else {
            "l2": smallest.l2,
            "linf_paper": smallest.linf_paper,
            "linf_exact": smallest.linf_exact,
        },
    }


def _peak(peak: Peak) -> dict[str, Any]:
    return {"gain": peak.gain, "db": peak.db, "omega": peak.omega}


def _verdict(verdict: Verdict, of: VehicleStability | StabilityReport) -> dict[str, Any]:
    why = reason(verdict, of)
    return {"stable": verdict.stable, "marginal": verdict.marginal, "reason": why}


def _text(result: StabilityReport) -> str:
    head = ["vehicle", "α (1/s²)", "β (1/s)", "τ (s)", "L₂", "L∞ paper", "L∞ exact", "‖h‖₁"]
    head += ["peak (dB)", "at (rad/s)", "below (rad/s)"]
    rows = []
    for number, vehicle in enumerate(result.vehicles, 1):
        parameters = vehicle.parameters
        rows.append(
            [
                str(number),
                f"{parameters.alpha:.4f}",
                f"{parameters.beta:.4f}",
                f"{parameters.tau:.3f}",
                _answer(vehicle.l2),
                _answer(vehicle.linf_paper),
                _answer(vehicle.linf_exact),
                f"{vehicle.linf_gain:.4f}",
                f"{vehicle.peak.db:.2f}",
                f"{vehicle.peak.omega:.3f}" if vehicle.peak.omega else "-",
                f"{vehicle.crossover:.3f}" if vehicle.crossover else "-",
            ]
        )
    lines = [table(head, rows), ""]
    for number, vehicle in enumerate(result.vehicles, 1):
        for verdict in (vehicle.l2, vehicle.linf_paper, vehicle.linf_exact):
            lines.append(
                f"Vehicle {number}, {TITLES[verdict.criterion]}: {reason(verdict, vehicle)}"
            )
    if len(result.vehicles) > 1:
        platoon = result.platoon
        for verdict in (
            platoon.l2_strict,
            platoon.l2_weak,
            platoon.linf_strict,
            platoon.linf_weak,
        ):
            title, why = TITLES[verdict.criterion], reason(verdict, result)
            lines.append(f"Platoon, {title}: {_answer(verdict)}. {why}")
    return "\n".join(lines)


def _answer(verdict: Verdict) -> str:
    return ("YES" if verdict.stable else "NO") + (" (marginal)" if verdict.marginal else "")
