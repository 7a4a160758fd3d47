"""The options that give parameter sets, by hand or from a snapshot: to be judged or simulated."""

import argparse

from accpinn.errors import ConfigError
from accpinn.model.cthp import Parameters

NAMES = ("alpha", "beta", "tau")


def add_parameter_options(parser: argparse.ArgumentParser) -> None:
    """`--alpha`, `--beta`, `--tau` with one value a vehicle, first follower first; `--snapshot`."""
    for name, symbol, unit in zip(NAMES, "αβτ", ("1/s²", "1/s", "s"), strict=True):
        parser.add_argument(
            f"--{name}",
            type=float,
            nargs="+",
            metavar=name[0].upper(),
            help=f"{symbol} in {unit}, one value a vehicle",
        )
    parser.add_argument(
        "--snapshot", metavar="FILE", help="take the learned parameters of a snapshot instead"
    )


def chosen_parameters(options: argparse.Namespace) -> Parameters:
    """The parameter sets that the options give.

    Raises:
        ConfigError: when they are missing, given twice, or differ in number.
        SnapshotError: when the snapshot cannot be read.
    """
    given = {name: getattr(options, name) for name in NAMES if getattr(options, name)}
    if options.snapshot:
        if given:
            raise ConfigError(f"parameters: give --{next(iter(given))} or --snapshot, not both.")
        from accpinn.results.snapshot.file import load  # not needed for numbers given by hand

        return load(options.snapshot).fit.parameters
    if len(given) < len(NAMES):
        missing = " and ".join(f"--{name}" for name in NAMES if name not in given)
        raise ConfigError(f"parameters: {missing} missing; give all three, or --snapshot FILE.")
    counts = {name: len(values) for name, values in given.items()}
    if len(set(counts.values())) > 1:
        listed = ", ".join(f"{count} of --{name}" for name, count in counts.items())
        raise ConfigError(f"parameters: {listed}; give as many of each as there are vehicles.")
    return Parameters(*given.values())
