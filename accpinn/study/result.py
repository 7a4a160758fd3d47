"""What was found: a `Result` holds an analysis, its fit, and all that follows from both.

Quality, intervals, errors and further forms of the model are computed when they are first asked
for, and kept. A result read from a file has those that were stored with it; what else follows needs
the data, which `with_data` brings back from the recording.
"""

import os
import platform
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from datetime import UTC, datetime
from functools import cache, cached_property
from importlib import metadata
from importlib.util import find_spec
from typing import TYPE_CHECKING, Any, Self, TypeVar

import numpy as np

from accpinn import __version__
from accpinn.errors import AccpinnError, ConfigError, ParameterError, SegmentError
from accpinn.evaluation import Evaluation, evaluate
from accpinn.evaluation.closed_loop import closed_loop
from accpinn.findings import Finding
from accpinn.inference.answer import Answer, answer
from accpinn.inference.gain_check import GainCheck, gain_checks
from accpinn.inference.identifiability import identifiability
from accpinn.inference.intervals import Uncertainty, intervals
from accpinn.inference.model_adequacy import Adequacy, model_forms
from accpinn.inference.posterior import AT_SPEED
from accpinn.inference.prediction import GapBand, gap_band
from accpinn.inference.window_posterior import parameters_of, window_posterior
from accpinn.methods import TaskContext
from accpinn.methods.estimate import Fit, Outcome, ParameterTrack
from accpinn.methods.registry import METHODS
from accpinn.model.cthp import Parameters, Trajectories
from accpinn.model.registry import FOLLOWING, time_gap, value_of
from accpinn.model.spec import ModelSpec
from accpinn.recordings import Facts, GapContradictsSpeeds, Recording, ValuesOutOfRange, facts_of
from accpinn.segment import DrivenByHand, Segment, SegmentInfo
from accpinn.segment.quality import Quality, assess_quality
from accpinn.stability import StabilityReport, stability_report
from accpinn.stability.criteria import transfer_function
from accpinn.stability.measured_gain import MeasuredGain, measured_gain
from accpinn.study import Analysis
from accpinn.study.judge import Judgement
from accpinn.units import FloatArray

if TYPE_CHECKING:
    from control import TransferFunction
    from pandas import DataFrame
    from xarray import DataTree

T = TypeVar("T")
PACKAGES = ("torch", "numpy", "scipy", "pandas", "plotly", "streamlit", "control")
NO_XARRAY = 'xarray is not installed; install it by pip install "accpinn[draws]".'
TRACK_INSTANTS = 500
"""Instants of a compared method's track that are kept; more are not seen in a figure."""


@dataclass(frozen=True)
class Origin:
    """The program and the machine that made a result; neither host nor user is named."""

    accpinn: str
    """Version."""
    python: str
    """Version."""
    packages: dict[str, str]
    """Versions by name: torch, numpy, scipy, pandas, plotly, streamlit, control."""
    system: str
    """"Linux", "Windows", "Darwin"."""
    processor: str
    """Architecture, as "x86_64"."""
    cores: int


@dataclass
class Parts:
    """What follows from a fit and its data, as far as it was computed."""

    qualities: tuple[Quality, ...] | None = None
    uncertainty: Uncertainty | None = None
    evaluation: Evaluation | None = None
    adequacy: Adequacy | None = None
    answer: Answer | None = None
    gain_checks: tuple[GainCheck, ...] | None = None
    judgements: tuple[Judgement, ...] | None = None
    """How models describe other windows of the recording; made when asked for."""


@dataclass(frozen=True, eq=False)
class Result:
    """The answer to an analysis; see `run`. A snapshot is a result in a file."""

    analysis: Analysis
    infos: tuple[SegmentInfo, ...]
    """(K,) the windows as they were cut, vehicles and origin of the data."""
    facts: Facts
    """What the recording says of itself; empty where it is not known."""
    fits: tuple[Fit, ...]
    """(K,) the fit on each window; parameters are the same on all."""
    origin: Origin
    created: str
    """When it was found, or saved under a name: ISO 8601 in UTC to the second."""
    name: str = ""
    """Given by the user; may be empty."""
    note: str = ""
    """Given by the user; may be empty and may have several lines."""
    parts: Parts = field(default_factory=Parts)
    compared: tuple["Result", ...] = ()
    """Other methods' results on the same data, without curves."""
    segments: tuple[Segment, ...] = ()
    """(K,) the data; empty where they are not at hand."""
    recording: Recording | None = None
    """Where the data were cut from; never in a file."""
    digest: str = ""
    """SHA-256 of the file that it was read from, or was made into; empty before that."""

    def __repr__(self) -> str:
        """Method, file and windows."""
        windows = str(self.info.window) if len(self.infos) == 1 else f"{len(self.infos)} windows"
        return f"<Result: {self.fit.method} on {self.info.source}, {windows}>"

    def __str__(self) -> str:
        """A line on what it is, one or two a follower, what is against it, and what to ask it."""
        lines, known, model = [repr(self)[1:-1]], self.known_answer, self.fit.model
        is_shared = self.info.shares(self.fit.case)
        for k, label in enumerate(("All followers",) if is_shared else self.info.labels[1:]):
            if known:
                gap, speed = known.time_gap(known.stated_speed, k), 3.6 * known.stated_speed
                said = f"{gap.value:.2f} s at {speed:.0f} km/h ({100 * known.level:.0f} % interval"
                said += f" {gap.lower:.2f}–{gap.upper:.2f}). {known.trust[k].in_words}"
                lines.append(f"{label}: {said}")
            names = FOLLOWING[model].names
            values = [f"{name} {value_of(model, self.parameters, name)[k]:.4g}" for name in names]
            lines.append(f"{label}: {', '.join(values)} by {self.fit.method}")
        findings = [found for info in self.infos for found in info.findings]
        kinds = GapContradictsSpeeds | ValuesOutOfRange | DrivenByHand
        unsound = [found for found in findings if isinstance(found, kinds)]
        against = (*unsound, *(known.findings if known else ()))
        lines += dict.fromkeys(finding.sentence(self.info) for finding in against)
        return "\n".join([*lines, "More: .answer, .parameters, .uncertainty, .stability, .draws"])

    @property
    def id(self) -> str:
        """Short name of its file: the first 16 hexadecimal digits of the digest."""
        return self.digest[:16]

    @property
    def fit(self) -> Fit:
        """The fit on the window; on the first one of several."""
        return self.fits[0]

    @property
    def info(self) -> SegmentInfo:
        """The window, or the first one of several."""
        return self.infos[0]

    @property
    def segment(self) -> Segment | None:
        """The data of the window, or of the first one of several; None where not at hand."""
        return self.segments[0] if self.segments else None

    @property
    def parameters(self) -> Parameters:
        """α [1/s²], β [1/s], τ [s]: one entry a follower."""
        return self.fit.parameters

    @property
    def qualities(self) -> tuple[Quality, ...]:
        """(K,) how well the data of each window determine the parameters."""
        return self._part("qualities", lambda: tuple(map(assess_quality, self._every_window)))

    @property
    def quality(self) -> Quality:
        """That of the window, or of the first of several."""
        return self.qualities[0]

    @property
    def mean_time_gaps(self) -> FloatArray:
        """(M,) mean of p/v of each follower in motion, in s; of several windows by samples."""
        gaps = [quality.mean_time_gap for quality in self.qualities]
        samples = [info.samples for info in self.infos]
        return np.asarray(np.average(gaps, axis=0, weights=samples))

    @property
    def uncertainty(self) -> Uncertainty:
        """Intervals of the fit's parameters, and of what follows from them, if its model holds."""
        held = self.analysis.spec.fixed
        return self._part("uncertainty", lambda: intervals(self._every_window, self.fit, held=held))

    @property
    def weaknesses(self) -> tuple[Finding, ...]:
        """Which parameters the data determine only weakly, and what would narrow intervals."""
        about = (self.info, self.quality, self.uncertainty, self.fit.case)
        return identifiability(*about, self.facts.get("duration"))

    @property
    def answer(self) -> Answer:
        """One complete parameter set a follower, the same whatever the method.

        It takes about half a second for each follower and five minutes.
        """

        def compute() -> Answer:
            asked = self.analysis
            return answer(self._every_window, asked.case, asked.model, dict(asked.held))

        return self._part("answer", compute)

    @property
    def known_answer(self) -> Answer | None:
        """The answer where it is stored or the data are at hand; None elsewhere."""
        return self.answer if self.parts.answer or self.segments else None

    @property
    def gain_checks(self) -> tuple[GainCheck, ...]:
        """The answer's |H| held against the measured gain; empty where neither is at hand."""
        if self.parts.gain_checks is None and not self.segments:
            return ()
        return self._part("gain_checks", lambda: gain_checks(self.segments, self.answer))

    @cached_property
    def measured_gains(self) -> tuple[MeasuredGain | None, ...]:
        """Each follower's gain by Welch's method, from all windows; None where too short."""

        def measured(follower: int) -> MeasuredGain | None:
            try:
                return measured_gain(self._every_window, follower)
            except SegmentError:
                return None

        return tuple(map(measured, range(self.info.followers)))

    @property
    def draws(self) -> "DataFrame":
        """The answer's posterior draws, one a row: kind, vehicle, name, draw and parameters.

        ``kind`` is "typical" for the car's typical value and "further window" for what a further
        window of it may have.
        """
        from pandas import DataFrame, concat  # takes a third of a second, which few need

        answer = self.answer
        kinds = {"typical": answer.typical, "further window": answer.further}
        frames = [
            DataFrame(
                {"kind": kind, "vehicle": vehicle, "name": name, "draw": range(len(sets.alpha))}
                | {parameter: answer.values(sets, parameter)[:, k] for parameter in answer.names}
            )
            for kind, sets in kinds.items()
            for k, (vehicle, name) in enumerate(
                zip(self.info.vehicles[1:], self.info.names[1:], strict=True)
            )
        ]
        return concat(frames, ignore_index=True)

    def to_datatree(self) -> "DataTree":
        """The answer's posterior draws for xarray and ArviZ, which are to be installed.

        The groups ``posterior`` (the typical value) and ``further_window`` have parameters by
        chain, draw and vehicle; ``window_posterior`` has those of each window alone, with the
        log-likelihood of its data at each draw in ``window_log_likelihood``, where the data are at
        hand.

        Raises:
            ConfigError: where xarray is not installed.
        """
        try:
            import xarray
        except ImportError:
            raise ConfigError(NO_XARRAY) from None

        answer, asked = self.answer, self.analysis
        names = {"vehicle_name": ("vehicle", list(self.info.names[1:]))}
        along = {"chain": [0], "vehicle": list(self.info.vehicles[1:]), **names}
        units = {p.name: p.unit for p in FOLLOWING[answer.model].parameters}

        def dataset(sets: Parameters, **windows: Any) -> Any:
            """Sets (draw, .., vehicle) by their names."""
            values = {name: (answer.values(sets, name), units[name]) for name in answer.names}
            values["time_gap_100_kmh"] = (time_gap(answer.model, sets, AT_SPEED), "s")
            dims = ("chain", "draw", *windows, "vehicle")
            variables = {
                name: (dims, drawn[None], {"units": unit}) for name, (drawn, unit) in values.items()
            }
            return xarray.Dataset(variables, along | windows)

        groups = {"posterior": dataset(answer.typical), "further_window": dataset(answer.further)}
        if self.segments:
            spec = ModelSpec(answer.model, asked.held)
            windows = [window_posterior(segment, asked.case, spec) for segment in self.segments]
            starts = [segment.window.start for segment in self.segments]
            drawn = np.array([window.drawn for window in windows])  # window, vehicle, draw, feature
            sets = parameters_of(answer.model, np.moveaxis(drawn, 2, 0), answer.speeds)
            groups["window_posterior"] = dataset(sets, window=starts)
            log = np.moveaxis(np.array([window.log_likelihood for window in windows]), 2, 0)[None]
            likelihood = {"speeds_and_gaps": (("chain", "draw", "window", "vehicle"), log)}
            groups["window_log_likelihood"] = xarray.Dataset(likelihood, along | {"window": starts})
        tree = xarray.DataTree.from_dict(groups)
        tree.attrs = {
            "model": answer.model,
            "case": asked.case,
            "source": self.info.source,
            "sha256": self.info.sha256,
            "accpinn": self.origin.accpinn,
        }
        return tree

    def to_netcdf(self) -> bytes:
        """The tree of `to_datatree` as a file in netCDF-4; see there."""
        return bytes(self.to_datatree().to_netcdf(engine="h5netcdf"))

    @property
    def evaluation(self) -> Evaluation:
        """Surrogate and closed-loop errors, on all windows together and outside of them."""
        return self._part(
            "evaluation",
            lambda: evaluate(self._every_window, self.fits, recording=self.recording),
        )

    @property
    def adequacy(self) -> Adequacy:
        """The CTHP beside further forms of the model, which takes about a second a follower."""
        return self._part("adequacy", lambda: model_forms(self._every_window[0], self.fit.case))

    @cached_property
    def stability(self) -> StabilityReport | None:
        """String stability of each follower and of the platoon.

        It is None where τ is undetermined or the parameters allow no report.
        """
        try:
            return stability_report(self.parameters)
        except ParameterError:
            return None

    @cached_property
    def simulated(self) -> Trajectories | None:
        """The closed-loop simulation on the window; None where the data are not at hand."""
        return closed_loop(self.segment, self.fit) if self.segment else None

    @property
    def gap_band(self) -> GapBand | None:
        """The space-gaps that the posterior predicts; None without data or intervals."""
        if self.segment is None or not self.is_finished:
            return None
        return gap_band(self.segment, self.uncertainty, self.fit.case, self.analysis.spec)

    def transfer_function(self) -> tuple["TransferFunction", ...]:
        """From the speed ahead to the own speed, one python-control object a follower.

        Raises:
            ParameterError: where the parameters allow no answer.
        """
        return tuple(transfer_function(follower) for follower in self.parameters)

    @property
    def is_finished(self) -> bool:
        """Whether the estimation came to its end: neither stopped nor diverged."""
        return self.fit.outcome not in (Outcome.STOPPED, Outcome.DIVERGED)

    def with_holdout(self, context: TaskContext | None = None) -> Self:
        """The same, with errors on blocks of the window that the method did not see."""
        config = self.analysis.config

        def estimate(segment: Segment) -> Fit:
            method = METHODS[self.analysis.method]
            asked = self.analysis
            return method.fit(segment, asked.case, config, context, asked.spec)

        evaluation = evaluate(self._every_window, self.fits, estimate, self.recording)
        return replace(self, parts=replace(self.parts, evaluation=evaluation))

    def with_data(self, recording: Recording) -> Self:
        """The same, with the data cut anew from the recording.

        Raises:
            SegmentError: where it is another recording, or what is cut from it differs.
        """
        if self.analysis.source.sha256 != recording.sha256:
            digest = self.analysis.source.sha256
            said = f" with the SHA-256 {digest}" if digest else ""
            raise SegmentError(
                "This is not the recording the result was learned from; that is"
                f" {self.info.source}{said}."
            )
        segments = self.analysis.segments(recording)
        kept = [info.digest for info in self.infos]
        if [segment.info.digest for segment in segments] != kept:
            raise SegmentError(
                "The recording is the same, but the window cut from it differs, as if bridged or"
                " resampled in another way."
            )
        return self.on(segments, recording)

    def on(self, segments: tuple[Segment, ...], recording: Recording | None) -> Self:
        """The same with data that are known to be those of its windows."""
        infos = tuple(segment.info for segment in segments)
        return replace(self, infos=infos, segments=segments, recording=recording)

    def under(self, analysis: Analysis) -> Self:
        """The same fit for an analysis that may ask for another model of the answer."""
        parts, asked = self.parts, self.analysis
        if (analysis.model, analysis.held) != (asked.model, asked.held):
            parts = replace(parts, answer=None, gain_checks=None)
        return replace(self, analysis=analysis, parts=parts)

    def found_in(self, recording: Recording | None) -> Self:
        """The same with the recording's data, where it is this one; else as it is."""
        try:
            return self.with_data(recording) if recording else self
        except AccpinnError:
            return self

    def without_data(self) -> Self:
        """The same without the data, every part but the forms of the model computed before."""
        names = ("qualities", "uncertainty", "evaluation", "answer", "gain_checks")
        parts = replace(self.parts, **{name: getattr(self, name) for name in names})
        return replace(self, parts=parts, segments=(), recording=None)

    def as_row(self) -> Self:
        """The same as a row of a list: without data, curves and weights, its track thinned."""
        fit, track = self.fit, self.fit.track
        if track and len(track.time) > TRACK_INSTANTS:
            kept = np.linspace(0, len(track.time) - 1, TRACK_INSTANTS).round().astype(int)
            deviation = None if track.deviation is None else track.deviation[kept]
            track = ParameterTrack(track.time[kept], track.parameters[kept], deviation)
        fit = replace(fit, surrogate=None, history=None, arrays={}, track=track)
        return replace(self, fits=(fit,), compared=(), segments=(), recording=None)

    def _part(self, name: str, compute: Callable[[], T]) -> T:
        known: T | None = getattr(self.parts, name)
        if known is None:
            known = compute()
            setattr(self.parts, name, known)
        return known

    @property
    def _every_window(self) -> tuple[Segment, ...]:
        if not self.segments:
            raise SegmentError(
                f"{self.info.source}: the data are not at hand; open the recording first."
            )
        return self.segments


def result_of(
    analysis: Analysis,
    segments: tuple[Segment, ...],
    fits: tuple[Fit, ...],
    recording: Recording | None = None,
) -> Result:
    """The result of fits that exist already, one for each of the windows' segments (K,)."""
    return Result(
        analysis=analysis,
        infos=tuple(segment.info for segment in segments),
        facts=facts_of(recording),
        fits=fits,
        origin=origin(),
        created=now(),
        segments=segments,
        recording=recording,
    )


def has_xarray() -> bool:
    """Whether the libraries for `Result.to_netcdf` are installed."""
    return all(find_spec(name) for name in ("xarray", "h5netcdf", "h5py"))


def now() -> str:
    """The time in UTC, ISO 8601 to the second."""
    return datetime.now(UTC).strftime("%Y-%m-%dT%H:%M:%SZ")


def origin() -> Origin:
    """This program on this machine."""
    return Origin(
        accpinn=__version__,
        python=platform.python_version(),
        packages={package: _version(package) for package in PACKAGES},
        system=platform.system(),
        processor=platform.machine(),
        cores=os.cpu_count() or 1,
    )


@cache  # looking one up reads a file
def _version(package: str) -> str:
    try:
        return metadata.version(package)
    except metadata.PackageNotFoundError:
        return "not installed"
