"""The whole way from a recording to a result that can be kept, for scripts and notebooks.

from accpinn import api

study = api.fit("recording.csv", start=0, duration=300)
study.save("result.accpinn.zip")
"""

import os
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from numbers import Integral, Real
from pathlib import Path

from accpinn.errors import ConfigError
from accpinn.evaluation.evaluation import Evaluation, evaluate
from accpinn.inference.intervals import Uncertainty, intervals
from accpinn.methods.fit import Fit
from accpinn.methods.registry import method_of
from accpinn.methods.store import Store
from accpinn.model.cthp import Case, Parameters
from accpinn.recordings.openacc import read
from accpinn.recordings.recording import Recording
from accpinn.results.snapshot.create import create
from accpinn.results.snapshot.file import load, save
from accpinn.results.snapshot.schema import Snapshot
from accpinn.results.snapshot.verification import Verification, check
from accpinn.segment.cut import DURATION, cut
from accpinn.segment.regimes import exclude_regimes, label_regimes, parse_regimes
from accpinn.segment.segment import Segment
from accpinn.segment.vehicles import parse_vehicles
from accpinn.stability.report import StabilityReport, stability_report
from accpinn.units import Seconds

__all__ = ["Study", "fit", "load", "verify"]


@dataclass(frozen=True, eq=False)
class Study:
    """A window of a recording and what one method says of it; the rest is computed when asked."""

    recording: Recording
    segment: Segment
    fit: Fit

    @property
    def parameters(self) -> Parameters:
        """α [1/s²], β [1/s], τ [s] of each follower."""
        return self.fit.parameters

    @cached_property
    def uncertainty(self) -> Uncertainty:
        """What the window leaves open about them."""
        return intervals(self.segment, self.fit)

    @cached_property
    def evaluation(self) -> Evaluation:
        """Errors of both kinds, on the window and on the rest of the recording."""
        return evaluate(self.segment, self.fit, recording=self.recording)

    @cached_property
    def stability(self) -> StabilityReport:
        """Who amplifies disturbances, and why.

        Raises:
            ParameterError: where the parameters allow no answer.
        """
        return stability_report(self.parameters)

    def snapshot(self, name: str = "", note: str = "", with_data: bool = False) -> Snapshot:
        """All of it, ready to be saved; see `snapshot.take`."""
        return create(
            self.segment,
            self.fit,
            recording=self.recording,
            uncertainty=self.uncertainty,
            evaluation=self.evaluation,
            name=name,
            note=note,
            with_data=with_data,
        )

    def save(
        self,
        path: str | os.PathLike[str],
        name: str = "",
        note: str = "",
        with_data: bool = False,
    ) -> Path:
        """Write a snapshot, in one step."""
        return save(self.snapshot(name, note, with_data), path)


def fit(
    recording: str | os.PathLike[str] | Recording,
    start: Seconds = 0.0,
    duration: Seconds = DURATION,
    vehicles: str | Sequence[int] | None = None,
    *,
    case: Case = "II",
    method: str = "pinn",
    preset: str = "fast",
    seed: int = 0,
    leaving_out: str | Sequence[str] = (),
    store: Store | None = None,
    threads: int | None = None,
) -> Study:
    """Learn α, β and τ from a window of a recording.

    Args:
        recording: a CSV file, or what `openacc.read` made of it.
        start: of the window, in s from the recording's first sample.
        duration: of the window, in s.
        vehicles: consecutive numbers, leader first, also as "1-5"; by default all that can be used.
        case: "I" for one parameter set, "II" for one per follower.
        method: a key of `methods.registry.METHODS`.
        preset: of the PiNN, "fast" or "paper".
        seed: of the PiNN.
        leaving_out: regimes whose instants do not count for the law, as "catching up".
        store: where the PiNN's results are kept; None keeps nothing.
        threads: for the PiNN.

    Raises:
        AccpinnError: one sentence of what is wrong with file, window or settings.
    """
    estimator = method_of(method)
    if case not in ("I", "II"):
        raise ConfigError(f"case: {case} is not known; choose I or II.")
    _require(start, Real, "start", "seconds, as 0")
    _require(duration, Real, "duration", "seconds, as 300")
    _require(seed, Integral, "seed", "a whole number, as 0")
    source = _recording(recording)
    segment = cut(source, start, duration, _numbers(vehicles))
    if leaving_out:
        segment = exclude_regimes(
            segment, label_regimes(segment, source), parse_regimes(leaving_out)
        )
    if method == "pinn":
        from accpinn.methods.pinn.config import preset as settings
        from accpinn.methods.pinn.training import train  # torch takes a second to import

        config = settings(preset, seed=int(seed))
        return Study(source, segment, train(segment, case, config, store=store, threads=threads))
    return Study(source, segment, estimator.fit(segment, case))


def verify(
    content: str | os.PathLike[str] | bytes,
    recording: str | os.PathLike[str] | Recording | None = None,
) -> Verification:
    """Read a snapshot, then compute its figures anew.

    Args:
        content: the file's path, or its bytes.
        recording: the CSV file it was learned from, or what `openacc.read` made of it; see
            `snapshot.verify`.

    Raises:
        AccpinnError: when one of them cannot be read.
    """
    return check(load(content), None if recording is None else _recording(recording))


def _recording(source: str | os.PathLike[str] | Recording) -> Recording:
    if isinstance(source, Recording):
        return source
    if not isinstance(source, str | os.PathLike | bytes):
        raise ConfigError(f"recording: {repr(source)[:40]} is not allowed; choose a file's path.")
    return read(source)


def _numbers(vehicles: str | Sequence[int] | None) -> Sequence[int] | None:
    if vehicles is None:
        return None
    if isinstance(vehicles, str):
        return parse_vehicles(vehicles)
    for number in vehicles:
        _require(number, Integral, "vehicles", "whole numbers, as (1, 2)")
    return vehicles


def _require(value: object, kind: type, name: str, allowed: str) -> None:
    if not isinstance(value, kind) or isinstance(value, bool):
        raise ConfigError(f"{name}: {repr(value)[:40]} is not allowed; choose {allowed}.")
