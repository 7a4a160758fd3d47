"""From a recording to parameters, their uncertainty, string stability and files, in one call.

import accpinn

study = accpinn.fit("recording.csv", start=0, duration=300)
study.save("result.accpinn.zip")
"""

import os
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from numbers import Integral, Real
from pathlib import Path
from typing import TYPE_CHECKING

from accpinn.errors import ConfigError
from accpinn.evaluation.evaluation import Evaluation, evaluate
from accpinn.inference.intervals import Uncertainty, intervals
from accpinn.inference.model_adequacy import Adequacy, model_forms
from accpinn.methods.fit import Fit
from accpinn.methods.method import TaskContext
from accpinn.methods.pinn.config import preset as named_config
from accpinn.methods.registry import method_of, segment_for
from accpinn.methods.store import Store
from accpinn.model.cthp import Case, Parameters
from accpinn.recordings.files import read
from accpinn.recordings.recording import Recording
from accpinn.results.snapshot import Snapshot, create
from accpinn.results.snapshot.archive import load
from accpinn.results.snapshot.saved import save, writable_path, write_whole
from accpinn.results.snapshot.verification import PATIENCE, Verification
from accpinn.results.snapshot.verification import verify as verify_snapshot
from accpinn.segment.cut import DURATION, parse_vehicles
from accpinn.segment.quality import exclude_regimes, label_regimes
from accpinn.segment.segment import Segment
from accpinn.stability.frequency import transfer_function
from accpinn.stability.report import StabilityReport, stability_report
from accpinn.units import Seconds

if TYPE_CHECKING:
    from control import TransferFunction

__all__ = ["Study", "fit", "load", "verify"]


@dataclass(frozen=True, eq=False)
class Study:
    """A window of a recording and one method's fit; all else is computed when it is asked for."""

    recording: Recording
    segment: Segment
    fit: Fit

    @property
    def parameters(self) -> Parameters:
        """α [1/s²], β [1/s], τ [s]: one entry a follower."""
        return self.fit.parameters

    @cached_property
    def uncertainty(self) -> Uncertainty:
        """Intervals of the parameters, and of what follows from them, if the CTHP holds."""
        return intervals(self.segment, self.fit)

    @cached_property
    def adequacy(self) -> Adequacy:
        """Other forms of the model in the same likelihood, with their estimates and intervals.

        It takes about a second a follower. Once computed, snapshot and report contain it, too.
        """
        return model_forms(self.segment, self.fit.case)

    @cached_property
    def evaluation(self) -> Evaluation:
        """Surrogate and closed-loop errors, on the window and outside it."""
        return evaluate(self.segment, self.fit, recording=self.recording)

    @cached_property
    def stability(self) -> StabilityReport:
        """String stability of each follower and of the platoon.

        Raises:
            ParameterError: where the parameters allow no answer.
        """
        return stability_report(self.parameters)

    def transfer_function(self) -> tuple["TransferFunction", ...]:
        """From the speed ahead to the own speed, one python-control object a follower.

        Raises:
            ParameterError: where the parameters allow no answer.
        """
        return tuple(transfer_function(follower) for follower in self.parameters)

    def snapshot(self, name: str = "", note: str = "", with_data: bool = False) -> Snapshot:
        """All of the study in one object, ready to be saved.

        Args:
            name: of the snapshot; may be empty.
            note: of any length up to a few pages; may be empty.
            with_data: whether the window's speeds and space-gaps go in.

        Raises:
            SnapshotError: for a training that diverged, or texts that are too long.
        """
        return create(
            self.segment,
            self.fit,
            recording=self.recording,
            uncertainty=self.uncertainty,
            evaluation=self.evaluation,
            adequacy=vars(self).get("adequacy"),
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
        """Write a snapshot in one step; the arguments are those of `snapshot`.

        Raises:
            SnapshotError: when there is nothing to save, or no file can be written there.
        """
        return save(self.snapshot(name, note, with_data), path)

    def report(self, path: str | os.PathLike[str]) -> Path:
        """Write one web page that needs no network.

        Raises:
            SnapshotError: when there is nothing to report, or no file can be written there.
        """
        from accpinn.results.report import render_report  # plotly's script is read from disk

        place = writable_path(Path(path), "report")
        page = render_report(self.snapshot(with_data=True))
        return write_whole(page.encode(), place, "report")


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
    exclude: str | Sequence[str] = (),
    store: Store | None = None,
    threads: int | None = None,
) -> Study:
    """Estimate α, β and τ from a window of a recording.

    Args:
        recording: a CSV file, or what `read` made of it.
        start: of the window, in s from the recording's first sample.
        duration: of the window, in s.
        vehicles: consecutive numbers, leader first, also as "1-5"; by default the longest run of
            vehicles with data from the first one on.
        case: "I" for one parameter set, "II" for one per follower.
        method: a key of `METHODS`; with "maximum-likelihood" samples may be missing.
        preset: "fast", "calibrated" or "paper", for a method with presets.
        seed: of a method with presets.
        exclude: regimes whose instants do not count, as "catching-up" or ["catching up"].
        store: where a method with presets keeps results and checkpoints; None keeps nothing.
        threads: processor threads; by default the method's choice.

    Raises:
        AccpinnError: one sentence that names what is wrong with file, window or settings.
    """
    estimator = method_of(method)
    if case not in ("I", "II"):
        raise ConfigError(f"case: {case} is not known; choose I or II.")
    _require(start, Real, "start", "seconds, as 0")
    _require(duration, Real, "duration", "seconds, as 300")
    _require(seed, Integral, "seed", "a whole number, as 0")
    source = _recording(recording)
    segment = segment_for([method], source, start, duration, _numbers(vehicles))
    if exclude:
        segment = exclude_regimes(segment, label_regimes(segment, source), exclude)
    settings = named_config(preset, seed=int(seed)) if estimator.settings else None
    context = TaskContext(store=store, threads=threads)
    return Study(source, segment, estimator.fit(segment, case, settings, context))


def verify(
    content: str | os.PathLike[str] | bytes,
    recording: str | os.PathLike[str] | Recording | None = None,
    *,
    refit_within: Seconds = PATIENCE,
) -> Verification:
    """Read a snapshot, compute its results anew, run its methods again and compare.

    Args:
        content: the file's path, or its bytes.
        recording: the CSV file of its data, or what `read` made of it; needed where the data are
            not in the snapshot.
        refit_within: how many seconds running its methods again may be expected to take; 0 for
            none, infinity for all.

    Raises:
        AccpinnError: when one of them cannot be read.
    """
    source = None if recording is None else _recording(recording)
    return verify_snapshot(load(content), source, refit_within=refit_within)


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
