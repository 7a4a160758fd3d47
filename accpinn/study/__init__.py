"""The question: an `Analysis` names data, model, method and settings; its key names the result.

An analysis is a few lines of JSON. Two with equal keys have equal estimates: the key is the SHA-256
of the data read from the recording, the vehicles, the windows, the Case, the excluded
regimes, the model with what is fixed, the method with its version, and the settings. A renamed file
keeps its key.
"""

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from hashlib import sha256
from numbers import Integral, Real
from typing import Any, Self

from accpinn.arguments import checked_method
from accpinn.display import Displayed
from accpinn.errors import ConfigError, SegmentError, shown
from accpinn.methods.registry import METHODS, method_of, recommended_method, segment_for
from accpinn.model.cthp import Case
from accpinn.model.registry import fingerprint
from accpinn.model.spec import RECOMMENDED_SPEC, ModelSpec
from accpinn.recordings import Recording, Window
from accpinn.recordings.mapping import CsvMapping
from accpinn.segment import Segment
from accpinn.segment.cut import DURATION, default_vehicles, parse_vehicles
from accpinn.segment.quality import EXCLUDABLE, exclude_regimes, label_regimes, parse_regimes
from accpinn.units import Seconds

FORMAT = 11
"""Raised whenever equal analyses would have other results for a reason that no method's version
tells, as a change in how windows are cut."""


@dataclass(frozen=True)
class Source:
    """The recording that the data come from."""

    name: str
    """File name; it is no part of the key."""
    sha256: str
    """SHA-256 of the file's bytes, and of the trajectory's name where a file holds several."""
    trajectory: str | None
    """The trajectory of a table with several; None where the file holds one run."""
    data: str
    """SHA-256 of what was read: times, speeds, space-gaps and driver modes."""
    mapping: CsvMapping | None = None
    """The mapping a table was read with, to read it again; the key has `data` in its place."""

    @classmethod
    def of(cls, recording: Recording) -> Self:
        """The source that a recording is."""
        about = (recording.source, recording.sha256, recording.trajectory)
        return cls(*about, recording.data_digest, recording.mapping)


@dataclass(frozen=True)
class Analysis(Displayed):
    """One question: the parameters of these vehicles in these windows, by this method."""

    source: Source
    vehicles: tuple[int, ...]
    """(M+1,) consecutive numbers in the file (1 = first), leader first."""
    windows: tuple[Window, ...]
    """One window, or several that share one likelihood, in s from the recording's first sample."""
    case: Case = "II"
    excluded: tuple[str, ...] = ()
    """Regimes whose instants do not count in the model's equation."""
    spec: ModelSpec = RECOMMENDED_SPEC
    """The model whose parameters are estimated, and what is fixed of it."""
    method: str = "pinn"
    """Key of the method in `METHODS`."""
    settings: dict[str, Any] = field(default_factory=dict)
    """All settings of the method, seed included, ready for JSON; empty for one without any. Where
    none are given they are the defaults."""

    def __post_init__(self) -> None:
        """Take the method's default settings where none are given."""
        if not self.settings and self.method in METHODS:
            object.__setattr__(self, "settings", _settings(self.method, None))

    def __str__(self) -> str:
        """Data, model, method and the settings that differ from the preset, a line each."""
        items = _described(self)
        if preset := self.settings.get("preset"):
            items["method"] += f", preset {preset}"
            changes = {k: v for k, v in self.config.changes().items() if k != "preset"}
            listed = ", ".join(f"{name} = {value}" for name, value in changes.items())
            items["settings"] = listed or "the preset's"
        items["intervals"] = "yes" if self.has_posterior else "no: the estimate is a point"
        lines = [f"  {name}: {text}" for name, text in items.items()]
        return "\n".join(["Analysis", *lines, "More: .key, .settings; accpinn.run answers it"])

    @classmethod
    @checked_method
    def of(
        cls,
        recording: Recording,
        windows: Sequence[Window] = (),
        vehicles: str | Sequence[int] | None = None,
        *,
        case: Case = "II",
        excluded: str | Sequence[str] = (),
        model: str | None = None,
        fixed: Mapping[str, float] | None = None,
        method: str | None = None,
        settings: Any = None,
    ) -> Self:
        """The analysis of a recording, checked as far as that takes no data.

        Args:
            recording: the data.
            windows: by default the first `DURATION`.
            vehicles: consecutive numbers, leader first, also as "1-5"; by default the longest run
                of vehicles with data from the first one on.
            case: "I" for one parameter set, "II" for one per follower.
            excluded: regimes, as `parse_regimes` takes them.
            model: key of the model; by default the method's usual one.
            fixed: parameters of it that keep their values, as {"s0": 4.0}.
            method: key of a method; by default the recommended one of the model.
            settings: an object of the method's own type, or what differs from the preset that it
                names, as {"preset": "fast", "iterations": 100}; None for the defaults.

        Raises:
            AccpinnError: one sentence that names what is not allowed, and what is.
        """
        method = method_of(method or recommended_method(model)).key
        chosen = _settings(method, settings)
        kind = METHODS[method].settings
        config = kind.from_json(chosen) if kind else None
        spec = ModelSpec.of(model or METHODS[method].usual_spec(config).model, fixed)
        METHODS[method].check(spec, config)
        if case not in ("I", "II"):
            raise ConfigError(f"case: {case} is not known; choose I or II.")
        named = parse_regimes(excluded) if excluded else ()
        return cls(
            Source.of(recording),
            vehicles_of(recording, vehicles),
            tuple(windows) or (Window(0.0, DURATION),),
            case,
            tuple(regime for regime in EXCLUDABLE if regime in named),
            spec,
            method,
            chosen,
        )

    def with_method(self, method: str, settings: Any = None) -> Self:
        """The analysis by another method, by default with its default settings.

        A method's usual model becomes the usual one of the other, as does one that it cannot
        estimate.
        """
        changed = replace(self, method=method, settings=_settings(method, settings))
        able = METHODS[method].models(changed.settings)
        usual = METHODS[self.method].models(self.settings)[0]
        keeps = self.spec.model in able and self.spec != ModelSpec(usual)
        return changed if keeps else replace(changed, spec=ModelSpec(able[0]))

    @property
    def window(self) -> Window:
        """The first window, which is the only one but where several were asked for."""
        return self.windows[0]

    @property
    def has_posterior(self) -> bool:
        """Whether the estimate has intervals."""
        return METHODS[self.method].posterior(self.settings) is not None

    @cached_property
    def key(self) -> str:
        """The content address of the result, 64 hexadecimal digits."""
        return self._address(self.settings)

    @cached_property
    def checkpoint_key(self) -> str:
        """Content address of the checkpoint that a training may go on from; empty for others.

        A longer training goes on where a shorter one ends, so the number of iterations is no part.
        """
        resumable = METHODS[self.method].resumable_settings
        shared = resumable(self.settings) if resumable else None
        return self._address(shared) if shared is not None else ""

    def _address(self, settings: dict[str, Any]) -> str:
        content = {
            "format": FORMAT,
            "data": self.source.data,
            "vehicles": self.vehicles,
            "windows": [(float(window.start), float(window.end)) for window in self.windows],
            "case": self.case,
            "excluded": self.excluded,
            "model": self.spec.model,
            "fixed": self.spec.fixed,
            "method": self.method,
            "version": METHODS[self.method].version,
            "settings": settings,
        }
        if code := fingerprint(self.spec.model):  # of a model from somebody's script
            content["code"] = code
        return sha256(json.dumps(content, sort_keys=True).encode()).hexdigest()

    @property
    def config(self) -> Any:
        """The settings as an object of the method's own type; None for a method without any.

        Raises:
            ConfigError: for settings that the method cannot have, as in somebody's file.
        """
        kind = METHODS[self.method].settings
        return kind.from_json(self.settings) if kind else None

    def segments(self, recording: Recording | None) -> tuple[Segment, ...]:
        """(K,) the data of the windows, cut from the recording.

        Raises:
            SegmentError: one sentence of what is wrong with a window, and what would be possible.
        """
        if recording is None:
            raise SegmentError(f"{self.source.name}: the data are not at hand; open the recording.")
        variants, segments = [(self.method, self.settings)], list[Segment]()
        for start, duration in ((window.start, window.duration) for window in self.windows):
            segment = segment_for(variants, recording, start, duration, self.vehicles)
            if self.excluded:
                regimes = label_regimes(segment, recording)
                segment = exclude_regimes(segment, regimes, self.excluded)
            segments.append(segment)
        return tuple(segments)


def differences(then: Analysis, now: Analysis) -> tuple[str, ...]:
    """The differences between two analyses, a few words each; empty where they are equal."""
    before, after = _described(then), _described(now)
    if then.method == now.method:
        before |= then.settings
        after |= now.settings
    return tuple(
        f"{name.replace('_', ' ')}: {before.get(name, '–')} → {after.get(name, '–')}"
        for name in before | after
        if before.get(name, "–") != after.get(name, "–")
    )


def _described(analysis: Analysis) -> dict[str, Any]:
    return {
        "recording": analysis.source.name,
        "window": ", ".join(map(str, analysis.windows)),
        "vehicles": ", ".join(map(str, analysis.vehicles)),
        "excluded": ", ".join(analysis.excluded) or "nothing",
        "case": analysis.case,
        "model": analysis.spec.in_words,
        "method": analysis.method,
    }


def single_window(start: Seconds = 0.0, duration: Seconds = DURATION) -> tuple[Window]:
    """The window that begins at ``start`` and lasts ``duration``, both in s.

    Raises:
        ConfigError: for what are no numbers.
    """
    _require(start, Real, "start", "seconds, as 0")
    _require(duration, Real, "duration", "seconds, as 300")
    try:
        return (Window(float(start), float(start + duration)),)
    except OverflowError:
        return (Window(math.inf, math.inf),)  # in no recording


def _settings(method: str, given: Any) -> dict[str, Any]:
    """All settings of a method, of which some may be given; none for a method without any."""
    kind = method_of(method).settings
    if kind is None:
        if given:
            raise ConfigError(f"settings: the method {method} has none; leave settings out.")
        return {}
    if given is None or isinstance(given, Mapping):
        given = kind.with_changes(given or {})
    if not isinstance(given, kind):
        raise ConfigError(
            f"settings: {shown(given)} is not allowed; choose a dict of {method}'s settings, as"
            ' {"iterations": 100}.'
        )
    return dict(given.to_json())


def vehicles_of(recording: Recording, vehicles: str | Sequence[int] | None) -> tuple[int, ...]:
    """The numbers of vehicles as a text or numbers name them; by default see `default_vehicles`."""
    if vehicles is None:
        return default_vehicles(recording)
    if isinstance(vehicles, str):
        return parse_vehicles(vehicles)
    for number in vehicles:
        _require(number, Integral, "vehicles", "whole numbers, as (1, 2)")
    return tuple(int(number) for number in vehicles)


def _require(value: object, kind: type, name: str, allowed: str) -> None:
    if not isinstance(value, kind) or isinstance(value, bool):
        raise ConfigError(f"{name}: {shown(value)} is not allowed; choose {allowed}.")
