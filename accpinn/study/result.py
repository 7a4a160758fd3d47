"""What was found: a `Result` holds an analysis, its estimate and its data.

All else follows from these three. Errors outside the windows take the recording, which `with_data`
brings back to a result that was read from a file.
"""

import os
import platform
from collections.abc import Sequence
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from functools import cache, cached_property
from importlib import metadata
from importlib.util import find_spec
from typing import TYPE_CHECKING, Any, Self

import numpy as np
from numpy.typing import NDArray

from accpinn import __version__
from accpinn.arguments import check_level, checked_method
from accpinn.display import Displayed
from accpinn.errors import AccpinnError, ConfigError, ParameterError, SegmentError, shown
from accpinn.evaluation import Evaluation, cross_validate, evaluate
from accpinn.evaluation.closed_loop import ClosedLoop, closed_loop
from accpinn.findings import Finding
from accpinn.inference.coordinates import AT_SPEED, coordinates_of
from accpinn.inference.gain_check import GainCheck, gain_checks
from accpinn.inference.identifiability import identifiability
from accpinn.inference.intervals import LEVEL, Uncertainty, from_draws
from accpinn.inference.measured_growth import Growth, growth_along
from accpinn.inference.model_adequacy import Adequacy, model_forms
from accpinn.inference.prediction import GapBand, gap_band
from accpinn.inference.trust import Trust, trust
from accpinn.inference.typical import posterior_findings
from accpinn.inference.window_posterior import window_posterior
from accpinn.methods import TaskContext
from accpinn.methods.estimate import (
    SPEEDS,
    Estimate,
    History,
    Outcome,
    Posterior,
    Span,
)
from accpinn.methods.registry import METHODS
from accpinn.model.cthp import Parameters, Trajectories
from accpinn.model.registry import time_gap, value_of
from accpinn.recordings import Facts, Recording, ValuesOutOfRange, facts_of
from accpinn.recordings.inconsistency import Inconsistency
from accpinn.recordings.mapped import UnitContradictsHeader
from accpinn.segment import DrivenByHand, Segment, SegmentInfo
from accpinn.segment.quality import Quality, assess_quality
from accpinn.stability import StabilityReport, stability_report
from accpinn.stability.criteria import response, transfer_function
from accpinn.stability.margin import Margins, margins
from accpinn.stability.measured_gain import MeasuredGain, head_to_tail_gain, measured_gain
from accpinn.stability.waves import Waves, waves
from accpinn.stability.what_if import WhatIf
from accpinn.study import Analysis
from accpinn.study.judge import Judgement
from accpinn.units import FloatArray

if TYPE_CHECKING:
    from control import TransferFunction
    from pandas import DataFrame
    from xarray import DataTree

PACKAGES = ("torch", "numpy", "scipy", "pandas", "plotly", "streamlit", "control")
FOLLOWERS, WARNINGS = 5, 3
"""Followers and warnings that `print` lists; of more the number is told."""
NO_XARRAY = 'xarray is not installed; install it by pip install "accpinn[draws]".'


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


@dataclass(frozen=True, eq=False)
class Result(Displayed):
    """What came of an analysis; see `run`. A snapshot is a result in a file.

    What follows from analysis, estimate and data is computed when it is first asked for, and kept.
    """

    analysis: Analysis
    estimate: Estimate
    """What the method found."""
    segments: tuple[Segment, ...]
    """(K,) the data of the windows; empty in a row of a list."""
    infos: tuple[SegmentInfo, ...]
    """(K,) the windows as they were cut, vehicles and origin of the data."""
    facts: Facts
    """What the recording's file says of itself; empty where it is not known."""
    origin: Origin
    created: str
    """When it was found, or saved under a name: ISO 8601 in UTC to the second."""
    name: str = ""
    """Given by the user; may be empty."""
    note: str = ""
    """Given by the user; may be empty and may have several lines."""
    blocks: tuple[ClosedLoop, ...] = ()
    """Parts of the data that were held out in turn; empty where none was."""
    compared: tuple["Result", ...] = ()
    """Other methods' results on the same data."""
    judgements: tuple[Judgement, ...] = ()
    """How models describe other windows of the recording; made when asked for."""
    recording: Recording | None = None
    """Where the data were cut from, where it is at hand; never in a file."""
    digest: str = ""
    """SHA-256 of the file that it was read from, or was made into; empty before that."""

    def __repr__(self) -> str:
        """Method, file and windows."""
        windows = str(self.info.window) if len(self.infos) == 1 else f"{len(self.infos)} windows"
        return f"<Result: {self.estimate.method} on {self.info.source}, {windows}>"

    def __str__(self) -> str:
        """What it is and how it ended, a line a follower, what is against it, and what to ask it.

        An estimation that did not converge says so first.
        """
        estimate, title = self.estimate, self.estimate.following.title
        preset = estimate.settings.get("preset")
        first = f"{repr(self)[1:-1]}: {f'preset {preset}, ' if preset else ''}{title}"
        is_whole = estimate.outcome in (Outcome.CONVERGED, Outcome.SOLVED, Outcome.FILTERED)
        ended = estimate.outcome.value
        lines = [f"{first}; {ended.partition(':')[0].lower()}"] if is_whole else [ended, first]
        is_shared, speed = self.info.shares(estimate.case), estimate.stated_speed
        labels = ("All followers",) if is_shared else self.info.labels[1:]
        for k, label in enumerate(labels[:FOLLOWERS]):
            gap = estimate.time_gap(speed, k)
            ends = f" ({100 * estimate.level:.0f} % interval {gap.lower:.2f}–{gap.upper:.2f})" if (
                estimate.level
            ) else ""  # fmt: skip
            values = [
                f"{n} {estimate.values(estimate.parameters, n)[k]:.4g}" for n in estimate.names
            ]
            car = f"{gap.value:.2f} s at {3.6 * speed:.0f} km/h{ends}; {', '.join(values)}"
            lines.append(f"{label}: {car}. {self.trust[k].in_words}")
        if (more := len(labels) - FOLLOWERS) > 0:
            lines.append(f"and {more} more follower{'s' * (more > 1)}: .to_frame()")
        if not estimate.posterior:
            lines.append("A point, without intervals; the default method has them.")
        warnings = [*dict.fromkeys(finding.sentence(self.info) for finding in self.warnings)]
        lines += warnings[:WARNINGS]
        if (more := len(warnings) - WARNINGS) > 0:
            lines.append(f"and {more} more warning{'s' * (more > 1)}: .warnings")
        return "\n".join([*lines, "More: .to_frame(), .posterior, .stability, .evaluation"])

    @property
    def id(self) -> str:
        """Short name of its file: the first 16 hexadecimal digits of the digest."""
        return self.digest[:16]

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
        """(M,) the estimate: one entry a follower."""
        return self.estimate.parameters

    @property
    def posterior(self) -> Posterior | None:
        """What is known beside the estimate; None for a point."""
        return self.estimate.posterior

    @property
    def curves(self) -> tuple[Trajectories, ...]:
        """(K,) the method's own curves in each window; empty for a method without."""
        return self.estimate.curves

    @property
    def history(self) -> History | None:
        """The course of the estimation; None for a method without iterations."""
        return self.estimate.history

    @cached_property
    def qualities(self) -> tuple[Quality, ...]:
        """(K,) how well the data of each window determine the parameters."""
        return tuple(map(assess_quality, self.segments))

    @property
    def quality(self) -> Quality:
        """That of the window, or of the first of several."""
        return self.qualities[0]

    @cached_property
    def mean_time_gaps(self) -> FloatArray:
        """(M,) mean of p/v of each follower in motion, in s; of several windows by samples."""
        gaps = [quality.mean_time_gap for quality in self.qualities]
        samples = [info.samples for info in self.infos]
        return np.asarray(np.average(gaps, axis=0, weights=samples))

    @cached_property
    def uncertainty(self) -> Uncertainty | None:
        """Intervals, probabilities and bands that follow from the posterior; None for a point."""
        posterior = self.posterior
        return (
            from_draws(self.parameters, posterior.typical, posterior.level) if posterior else None
        )

    @cached_property
    def trust(self) -> tuple[Trust, ...]:
        """What the windows say of each follower's estimate; one where all followers share it."""
        estimate, followers = self.estimate, range(self.info.followers)
        is_shared = self.info.shares(estimate.case)
        rows = [tuple(followers)] if is_shared else [(k,) for k in followers]
        numbers = (0,) if is_shared else self.info.vehicles[1:]
        windows = estimate.windows
        return tuple(
            trust(
                self.segments,
                number,
                row,
                estimate.model,
                estimate.parameters[row[0]],
                None if windows is None else windows[:, row[0]],
                estimate.stated_speed,
            )
            for number, row in zip(numbers, rows, strict=True)
        )

    @property
    def findings(self) -> tuple[Finding, ...]:
        """What the estimate and its posterior should be read with."""
        return (
            *self.estimate.findings,
            *posterior_findings(self.estimate, self.info.vehicles),
        )

    @property
    def warnings(self) -> tuple[Finding, ...]:
        """What the data have against any estimate from them, and what `findings` says."""
        of_data = [found for info in self.infos for found in info.findings]
        kinds = Inconsistency | ValuesOutOfRange | UnitContradictsHeader | DrivenByHand
        return (*(found for found in of_data if isinstance(found, kinds)), *self.findings)

    @property
    def weaknesses(self) -> tuple[Finding, ...]:
        """Which parameters the data determine only weakly, and what would narrow intervals."""
        if self.uncertainty is None:
            return ()
        about = (self.info, self.quality, self.uncertainty, self.estimate.case)
        return identifiability(*about, self.facts.get("duration"))

    @cached_property
    def gain_checks(self) -> tuple[GainCheck, ...]:
        """The estimate's |H| beside the measured gain; empty for a point."""
        return gain_checks(self.segments, self.uncertainty) if self.uncertainty else ()

    @cached_property
    def measured_gains(self) -> tuple[MeasuredGain | None, ...]:
        """Each follower's gain by Welch's method, from all windows; None where too short.

        It is measured beside the estimate's response; see `stability.measured_gain`.
        """

        def measured(follower: int) -> MeasuredGain | None:
            try:
                model = self.parameters[[follower]]
                return measured_gain(self.segments, follower, reference=model)
            except SegmentError:
                return None

        return tuple(map(measured, range(self.info.followers)))

    @cached_property
    def head_to_tail_gain(self) -> MeasuredGain | None:
        """The gain from the leader to the last follower, likewise; None where too short."""
        try:
            return head_to_tail_gain(self.segments, reference=self.parameters)
        except SegmentError:
            return None

    @checked_method
    def measured_growth(self, order: Sequence[int] | None = None) -> Growth | None:
        """How disturbances grow along a platoon: measured where the data hold it, else modelled.

        Args:
            order: the place of each car of the platoon, 0 for the first follower; by default all
                followers in their order.

        Returns:
            The gain over frequency with its band, beside the model's; None where the data are not
            at hand, or a car's model has no bounded gain.

        Raises:
            ParameterError: for a follower that there is not.

        Examples:
            >>> import accpinn
            >>> result = accpinn.fit(accpinn.sample("motorway"), vehicles="1-3", method="splines")
            >>> growth = result.measured_growth()
            >>> growth.peak.value > 1, growth.is_peak_measured
            (True, True)
        """
        places = range(self.info.followers) if order is None else tuple(order)
        if not places or not all(place in range(self.info.followers) for place in places):
            raise ParameterError(
                f"order: {shown(order)} is not allowed; choose followers from 0 to"
                f" {self.info.followers - 1}."
            )
        if not self.segments:
            return None
        return growth_along([self.measured_gains[k] for k in places], self.parameters[[*places]])

    @property
    def _known_posterior(self) -> Posterior:
        if self.posterior is None:
            raise ConfigError(
                f"posterior: the method {self.estimate.method} has none; choose the PiNN's preset"
                " calibrated, or simulation."
            )
        return self.posterior

    def to_datatree(self) -> "DataTree":
        """The posterior's draws for xarray and ArviZ, which are to be installed.

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

        estimate, posterior, analysis = self.estimate, self._known_posterior, self.analysis
        names = {"vehicle_name": ("vehicle", list(self.info.names[1:]))}
        along = {"chain": [0], "vehicle": list(self.info.vehicles[1:]), **names}
        units = {p.name: p.unit for p in estimate.following.parameters}

        def dataset(sets: Parameters, **windows: Any) -> Any:
            """Sets (draw, .., vehicle) by their names."""
            values = {name: (estimate.values(sets, name), units[name]) for name in estimate.names}
            values["time_gap_100_kmh"] = (time_gap(estimate.model, sets, AT_SPEED), "s")
            dims = ("chain", "draw", *windows, "vehicle")
            variables = {
                name: (dims, drawn[None], {"units": unit}) for name, (drawn, unit) in values.items()
            }
            return xarray.Dataset(variables, along | windows)

        kind = METHODS[analysis.method].posterior(analysis.settings)
        assert kind is not None  # as there is a posterior
        groups = {
            "posterior": dataset(posterior.typical),
            "further_window": dataset(posterior.further),
        }
        windows = [window_posterior(s, analysis.case, analysis.spec, kind) for s in self.segments]
        starts = [segment.window.start for segment in self.segments]
        drawn = np.array([window.drawn for window in windows])  # window, vehicle, draw, feature
        space = coordinates_of(estimate.model)
        sets = space.parameters(np.moveaxis(drawn, 2, 0), estimate.speeds)
        groups["window_posterior"] = dataset(sets, window=starts)
        log = np.moveaxis(np.array([window.log_likelihood for window in windows]), 2, 0)[None]
        likelihood = {"speeds_and_gaps": (("chain", "draw", "window", "vehicle"), log)}
        groups["window_log_likelihood"] = xarray.Dataset(likelihood, along | {"window": starts})
        tree = xarray.DataTree.from_dict(groups)
        tree.attrs = {
            "model": estimate.model,
            "case": analysis.case,
            "source": self.info.source,
            "sha256": self.info.sha256,
            "accpinn": self.origin.accpinn,
        }
        return tree

    def to_netcdf(self) -> bytes:
        """The tree of `to_datatree` as a file in netCDF-4; see there."""
        return bytes(self.to_datatree().to_netcdf(engine="h5netcdf"))

    @cached_property
    def evaluation(self) -> Evaluation:
        """Errors of curves and of the closed-loop simulation, in the windows and outside."""
        return evaluate(self.segments, self.estimate, self.recording, self.blocks)

    @cached_property
    def adequacy(self) -> Adequacy:
        """The CTHP beside further forms of the model, which takes about a second a follower."""
        return model_forms(self.segments[0], self.estimate.case)

    @cached_property
    def stability(self) -> StabilityReport | None:
        """String stability of each follower and of the platoon.

        It is None where τ is undetermined or the parameters allow no report.
        """
        try:
            return stability_report(self.parameters)
        except ParameterError:
            return None

    @property
    def assessed_speeds(self) -> FloatArray:
        """(M,) speeds in m/s at which margins are stated.

        It is that at which the estimate states its time gaps, and under a model that is no CTHP
        each follower's median speed, at which it is linearised.
        """
        estimate = self.estimate
        if not estimate.following.is_linear:
            return estimate.speeds
        return np.full(self.info.followers, estimate.stated_speed)

    @checked_method
    def margin(self, speed: float | None = None) -> Margins:
        """How much time gap separates each follower, and the platoon, from string stability.

        Args:
            speed: in m/s; by default that at which the estimate states its time gaps, and under a
                model that is no CTHP each follower's median speed. Such a model is linearised
                there.

        Raises:
            ParameterError: for a speed at which a follower has no equilibrium, or that is none.

        Examples:
            >>> import accpinn
            >>> result = accpinn.fit(accpinn.sample("motorway"), vehicles="1-3", method="splines")
            >>> result.margin(25.0).to_frame().state_l2.tolist()
            ['too_short', 'too_short']
        """
        estimate, uncertainty = self.estimate, self.uncertainty
        model, parameters = estimate.following, self.parameters
        draws = uncertainty.draws if uncertainty else None
        if speed is not None and not (np.isfinite(speed) and speed > 0):
            raise ParameterError(f"speed: {speed:g} m/s is not allowed; choose one above zero.")
        if speed is not None and not model.is_linear:
            for row in parameters.nonlinear:
                model.linearised(row, speed)
            parameters = model.linearisations(parameters.nonlinear.T, speed)
            draws = draws and model.linearisations(np.moveaxis(draws.nonlinear, -1, 0), speed)
        at: Any = self.assessed_speeds if speed is None else speed
        level = uncertainty.level if uncertainty else LEVEL
        info = self.info
        return margins(parameters, at, draws, level, info.names[1:], info.vehicles[1:])

    @checked_method
    def what_if(
        self, *, time_gap: float = 0.0, delay: float = 0.0, feedforward: float = 0.0,
        latency: float = 0.0,
    ) -> WhatIf:  # fmt: skip
        """How the followers would pass on disturbances with another control, see `WhatIf`.

        Args:
            time_gap: in s, added to that of each follower.
            delay: in s, added likewise.
            feedforward: share of the acceleration of the car ahead that is commanded as well.
            latency: age of that acceleration in s.

        Raises:
            ParameterError: for a change that is beyond any vehicle.

        Examples:
            >>> import accpinn
            >>> result = accpinn.fit(accpinn.sample("motorway"), vehicles="1-3", method="splines")
            >>> result.what_if(feedforward=1.0).peaks.gain.tolist()
            [1.0, 1.0]
        """
        names = self.info.names[1:]
        return WhatIf(self.parameters, time_gap, delay, feedforward, latency, names)

    @checked_method
    def waves(self, speed: float | None = None) -> Waves:
        """How much waves grow from the vehicle ahead to each follower, by size and direction.

        Under a CTHP all waves grow alike; under other models the lower half of a sinusoid (braking)
        may grow otherwise than the upper half, and a large one otherwise than a small one.

        Args:
            speed: mean speed in m/s; by default each follower's median speed.

        Raises:
            ParameterError: for a speed at which a follower has no equilibrium, or that is none.

        Examples:
            >>> import accpinn
            >>> result = accpinn.fit(accpinn.sample("motorway"), vehicles="1-2", method="splines")
            >>> frame = result.waves(25.0).to_frame()
            >>> bool((frame.braking / frame.harmonic).round(2).eq(1.0).all())
            True
        """
        if speed is not None and not (np.isfinite(speed) and speed > 0):
            raise ParameterError(f"speed: {speed:g} m/s is not allowed; choose one above zero.")
        model, info, followers = self.estimate.following, self.info, self.info.followers
        values = [value_of(model.key, self.parameters, name) for name in model.names]
        speeds = self.estimate.speeds if speed is None else np.full(followers, speed)
        return waves(model, np.transpose(values), speeds, info.names[1:], info.vehicles[1:])

    @cached_property
    def simulated(self) -> tuple[Trajectories | None, ...]:
        """(K,) the closed-loop simulation of each window; None where it cannot be simulated."""
        return tuple(closed_loop(segment, self.estimate) for segment in self.segments)

    @cached_property
    def gap_band(self) -> GapBand | None:
        """The space-gaps that the posterior predicts in the first window; None for a point."""
        if self.uncertainty is None:
            return None
        return gap_band(self.segments[0], self.estimate, self.uncertainty)

    @checked_method
    def to_frame(self, level: float = LEVEL) -> "DataFrame":
        """The estimate as a pandas frame, one row a follower.

        Columns are vehicle (number in the file), name, method, preset, model and outcome; then the
        time gap at 50 and 100 km/h in s and the model's parameters, each with its interval's ends
        in ``.._low`` and ``.._high``, nan without a posterior. ``.._extrapolated`` is true of a
        time gap at a speed that no window holds, and ``.._determined`` is false of a parameter of
        which the data say no more than was known of cars beforehand.

        Args:
            level: of the intervals, above 0 and below 1.

        Raises:
            ConfigError: for another level.

        Examples:
            >>> import accpinn
            >>> result = accpinn.fit(accpinn.sample("motorway"), vehicles="1-2", method="splines")
            >>> frame = result.to_frame()
            >>> frame.method[0], frame.model[0], frame.outcome[0]
            ('splines', 'cthp', 'solved')
            >>> frame[["alpha", "alpha_low", "time_gap_at_100_kmh_s_extrapolated"]].shape
            (1, 3)
        """
        from pandas import DataFrame

        estimate = self.estimate
        check_level(level)
        rows = []
        for k, (vehicle, name) in enumerate(
            zip(self.info.vehicles[1:], self.info.names[1:], strict=True)
        ):
            row: dict[str, Any] = {
                "vehicle": vehicle,
                "name": name,
                "method": estimate.method,
                "preset": estimate.settings.get("preset"),
                "model": estimate.model,
                "outcome": estimate.outcome.name.lower(),
            }
            for speed in SPEEDS:
                key = f"time_gap_at_{3.6 * speed:.0f}_kmh_s"
                row |= _with_ends(key, estimate.time_gap(speed, k, level))
                row[f"{key}_extrapolated"] = not estimate.is_driven(speed, k)
            for parameter in estimate.names:
                row |= _with_ends(parameter, estimate.span(parameter, k, level))
                row[f"{parameter}_determined"] = estimate.is_determined(parameter, k)
            rows.append(row)
        return DataFrame(rows)

    @checked_method
    def frequency_response(self, omega: FloatArray | Sequence[float]) -> NDArray[np.complex128]:
        """(K, M) each follower's H(jω), from the speed ahead to the own speed.

        A delay in the loop is its Padé approximant, as in `transfer_functions`.

        Args:
            omega: (K,) frequencies in rad/s, zero or more.

        Raises:
            ParameterError: for frequencies that are none, or where the parameters allow none.

        Examples:
            >>> import accpinn
            >>> result = accpinn.fit(accpinn.sample("motorway"), vehicles="1-3", method="splines")
            >>> abs(result.frequency_response([0.01, 0.1, 1.0])).shape
            (3, 2)
        """
        at = np.asarray(omega, float)
        if at.ndim != 1 or not (np.isfinite(at) & (at >= 0)).all():
            raise ParameterError(
                f"omega: {shown(omega)} is not allowed; choose frequencies in rad/s, zero or"
                " more, along one axis."
            )
        return np.asarray(response(self.parameters, at).T)

    def transfer_functions(self) -> tuple["TransferFunction", ...]:
        """From the speed ahead to the own speed, one python-control object a follower.

        They are rational, so a delay d becomes its Padé approximant of second order. Its gain is
        that of the delay, and its phase is off by 0.001 rad at ωd = 1, 0.03 rad at 2 and 0.2 rad at
        3. For a CTHP with α = 0.08 1/s², β = 0.3 1/s and τ = 1.2 s that makes H wrong by at most
        0.0003 up to 2 rad/s with a delay of 0.5 s, by 0.008 with one of 1 s, and its peak by less
        than 0.001 % with either.

        Raises:
            ParameterError: where the parameters allow none.

        Examples:
            >>> import accpinn
            >>> result = accpinn.fit(accpinn.sample("motorway"), vehicles="1-2", method="splines")
            >>> (system,) = result.transfer_functions()
            >>> len(system.poles())
            2
        """
        return tuple(transfer_function(follower) for follower in self.parameters)

    @property
    def is_finished(self) -> bool:
        """Whether the estimation came to its end: neither stopped nor diverged."""
        return self.estimate.is_finished

    def with_holdout(self, context: TaskContext | None = None) -> Self:
        """The same, with errors on parts of the data that the method did not see."""
        analysis = self.analysis
        method, config = METHODS[analysis.method], analysis.config

        def estimated(segments: tuple[Segment, ...]) -> Estimate:
            return method.fit(segments, analysis.case, config, context, analysis.spec)

        return replace(self, blocks=cross_validate(self.segments, estimated))

    @checked_method
    def with_data(self, recording: Recording) -> Self:
        """The same with the recording at hand, from which its data were cut.

        Raises:
            ConfigError: for what is no recording.
            SegmentError: where it is another recording, or what is cut from it differs.
        """
        if self.analysis.source.sha256 != recording.sha256:
            digest = self.analysis.source.sha256
            named = f" with the SHA-256 {digest}" if digest else ""
            raise SegmentError(
                "This is not the recording the result was learned from; that is"
                f" {self.info.source}{named}."
            )
        segments = self.analysis.segments(recording)
        digests = [info.digest for info in self.infos]
        if [segment.info.digest for segment in segments] != digests:
            raise SegmentError(
                "The recording is the same, but the window cut from it differs, as if bridged or"
                " resampled in another way."
            )
        return self.on(segments, recording)

    def on(self, segments: tuple[Segment, ...], recording: Recording | None) -> Self:
        """The same with data that are known to be those of its windows."""
        infos = tuple(segment.info for segment in segments)
        return replace(self, infos=infos, segments=segments, recording=recording)

    def found_in(self, recording: Recording | None) -> Self:
        """The same with the recording at hand, where it is this one; else as it is."""
        try:
            return self.with_data(recording) if recording else self
        except AccpinnError:
            return self


def _with_ends(name: str, span: Span) -> dict[str, float]:
    """A value and the ends of its interval as columns."""
    return {name: span.value, f"{name}_low": span.lower, f"{name}_high": span.upper}


def result_of(
    analysis: Analysis,
    segments: tuple[Segment, ...],
    estimate: Estimate,
    recording: Recording | None = None,
) -> Result:
    """The result of an estimate that exists already, of the windows' segments (K,)."""
    return Result(
        analysis=analysis,
        infos=tuple(segment.info for segment in segments),
        facts=facts_of(recording),
        estimate=estimate,
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
