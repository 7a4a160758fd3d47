"""`simulate`: a platoon behind a lead vehicle that drives a sinusoid."""

import argparse
from typing import Any

from accpinn.cli.options import add_parameter_options, chosen_parameters, fields
from accpinn.cli.output import print_json, show
from accpinn.errors import ConfigError
from accpinn.model.cthp import Parameters
from accpinn.platoon.leader import Sinusoid
from accpinn.platoon.simulation import PlatoonRun, simulate_platoon
from accpinn.results.messages import messages
from accpinn.results.messages.stability import PLACES
from accpinn.results.tables.stability import amplitude_table

MOST_VEHICLES = 100


def add_options(parser: argparse.ArgumentParser) -> None:
    """Declare the options; their defaults are the paper's simulation."""
    add_parameter_options(parser)
    parser.add_argument(
        "--vehicles", type=int, metavar="N", help="followers; one parameter set is repeated (8)"
    )
    for name, default, meaning in (
        ("frequency", 0.25, "of the sinusoid in rad/s"),
        ("amplitude", 1.0, "of the leader's speed in m/s"),
        ("speed", 20.0, "of the equilibrium in m/s"),
        ("settle", 20.0, "steady driving first, in s"),
        ("duration", 500.0, "of the whole run in s"),
    ):
        parser.add_argument(
            f"--{name}", type=float, default=default, help=f"{meaning} ({default:g})"
        )
    parser.set_defaults(run=run)


def run(options: argparse.Namespace) -> int:
    """Simulate, and print amplitudes and gaps."""
    leader = Sinusoid(
        options.frequency, options.amplitude, options.speed, options.settle, options.duration
    )
    result = simulate_platoon(_platoon(chosen_parameters(options), options.vehicles), leader)
    if options.json:
        print_json(describe(result))
    else:
        show(_text(result))
    return 0


def _platoon(parameters: Parameters, vehicles: int | None) -> Parameters:
    """One set repeated, or the sets in their order."""
    if vehicles is not None and not 1 <= vehicles <= MOST_VEHICLES:
        raise ConfigError(f"vehicles: {vehicles} is not allowed; choose 1 to {MOST_VEHICLES}.")
    count = len(parameters)
    if count == 1:
        return parameters[[0] * (8 if vehicles is None else vehicles)]
    if vehicles not in (None, count):
        raise ConfigError(
            f"vehicles: {count} parameter sets make {count} followers, not {vehicles};"
            " leave the option out, or give one set."
        )
    return parameters


def describe(result: PlatoonRun) -> dict[str, Any]:
    """The run as the command-line contract has it."""
    waves = result.amplitudes
    assert waves is not None  # behind a sinusoid there are some
    return {
        "amplitude": waves.measured.tolist(),
        "predicted_amplitude": waves.predicted.tolist(),
        "settled": waves.settled.tolist(),
        **fields(result, "minimum_gap", "minimum_gap_time"),
        "collisions": [fields(collision, "follower", "time") for collision in result.collisions],
        "warnings": messages(result.findings, PLACES),
    }


def _text(result: PlatoonRun) -> str:
    notes = [f"Note: {warning}" for warning in messages(result.findings, PLACES)]
    return "\n".join([amplitude_table(result).to_text(), *notes])
