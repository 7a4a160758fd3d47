"""All methods on identical data, side by side, with errors and intervals that mean something."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial

from accpinn.assessment import (
    TrackingErrors,
    closed_loop_errors,
    held_out_errors,
    surrogate_errors,
)
from accpinn.cthp import Case
from accpinn.errors import ConfigError
from accpinn.estimators import ESTIMATORS
from accpinn.fit import Fit
from accpinn.pinn.config import FAST, PinnConfig
from accpinn.segment import Segment
from accpinn.store import Store
from accpinn.uncertainty import Uncertainty, intervals

METHODS = ("pinn", *ESTIMATORS)
"""In the order they are shown."""


@dataclass(frozen=True, eq=False)
class Row:
    """What one method says of a segment, and what that is worth."""

    fit: Fit
    uncertainty: Uncertainty
    surrogate: TrackingErrors | None
    """Of the method's own trajectories against the data; None where it has none."""
    closed_loop: TrackingErrors | None
    """Of the law driving behind the measured leader; None where τ is not determined."""
    held_out: TrackingErrors | None
    """Closed loop on the last part of the window, learned from the part before."""


def parse_methods(text: str) -> tuple[str, ...]:
    """The methods of a text as "all" or "pinn,splines".

    Raises:
        ConfigError: for a method that is not known.
    """
    if text == "all":
        return METHODS
    chosen = tuple(part.strip() for part in text.split(","))
    for name in chosen:
        if name not in METHODS:
            raise ConfigError(
                f'methods: "{name}" is not known; choose all or {", ".join(METHODS)}.'
            )
    return chosen


def compare(
    segment: Segment,
    case: Case = "II",
    methods: Sequence[str] = METHODS,
    *,
    config: PinnConfig = FAST,
    store: Store | None = None,
    threads: int | None = None,
) -> Iterator[Row]:
    """Run the methods one by one; each row comes as soon as it is known.

    Args:
        segment: the data.
        case: "I" or "II".
        methods: names from `METHODS`.
        config: of the PiNN.
        store: where the PiNN's results are kept.
        threads: for the PiNN.
    """
    for name in methods:
        estimate = _estimator(name, case, config, store, threads)
        fit = estimate(segment)
        yield Row(
            fit=fit,
            uncertainty=intervals(segment, fit),
            surrogate=surrogate_errors(segment, fit),
            closed_loop=closed_loop_errors(segment, fit),
            held_out=held_out_errors(segment, estimate),
        )


def _estimator(
    name: str, case: Case, config: PinnConfig, store: Store | None, threads: int | None
) -> Callable[[Segment], Fit]:
    if name == "pinn":
        from accpinn.pinn.training import train  # torch takes a second to import

        return partial(train, case=case, config=config, store=store, threads=threads)
    method = ESTIMATORS[name]
    return lambda segment: method(segment, case)
