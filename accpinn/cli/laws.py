"""The options that give parameter sets by hand, shared by the commands that judge or simulate."""

import argparse

from accpinn.cthp import Parameters
from accpinn.errors import ConfigError


def add_law_options(parser: argparse.ArgumentParser) -> None:
    """`--alpha`, `--beta` and `--tau`, each with one value a vehicle, first follower first."""
    for name, symbol, unit in (("alpha", "α", "1/s²"), ("beta", "β", "1/s"), ("tau", "τ", "s")):
        parser.add_argument(
            f"--{name}",
            type=float,
            nargs="+",
            required=True,
            metavar=name[0].upper(),
            help=f"{symbol} in {unit}, one value a vehicle",
        )


def chosen_laws(options: argparse.Namespace) -> tuple[Parameters, ...]:
    """The parameter sets that the options give.

    Raises:
        ConfigError: when the three lists differ in length.
    """
    counts = {name: len(getattr(options, name)) for name in ("alpha", "beta", "tau")}
    if len(set(counts.values())) > 1:
        given = ", ".join(f"{count} of --{name}" for name, count in counts.items())
        raise ConfigError(f"parameters: {given}; give as many of each as there are vehicles.")
    return tuple(
        Parameters(alpha, beta, tau)
        for alpha, beta, tau in zip(options.alpha, options.beta, options.tau, strict=True)
    )
