"""Every setting of the PiNN, and its presets: `paper`, `fast` and `calibrated`, the default.

A setting that is not given is the preset's.
"""

import re
from collections.abc import Mapping
from dataclasses import dataclass
from math import isfinite
from numbers import Real
from typing import Any, Literal, NamedTuple, Self, get_args

import msgspec
import numpy as np

from accpinn.channels import PARAMETERS
from accpinn.errors import ConfigError, ParameterError, shown
from accpinn.model.cthp import Parameters
from accpinn.units import FloatArray, Seconds

METHOD_VERSION = 10
"""Raised whenever a change of the method changes its numbers; cached results then expire."""

PresetName = Literal["fast", "calibrated", "paper"]
PRESET_NAMES: tuple[str, ...] = get_args(PresetName)
DEFAULT: PresetName = "calibrated"
"""The preset of whoever names none, in Python, on the command line and on pages."""
QUICK: PresetName = "fast"
"""The preset of many trainings in a row, as of the paper's tables: seconds each."""


class PresetInfo(NamedTuple):
    """A preset's properties for pages, tables and the command line."""

    title: str
    """Its name on pages."""
    description: str
    """One sentence on its estimates."""
    minimises_papers_loss: bool = False
    """Whether its point is the minimum of the paper's Ψ."""
    has_posterior: bool = False
    """Whether its estimates have intervals, by the exact likelihood; samples may then be missing,
    and the model is a CTHP."""
    unused: tuple[str, ...] = ()
    """Settings without effect on its training."""


PRESET_INFOS: dict[PresetName, PresetInfo] = {
    "calibrated": PresetInfo(
        "Recommended",
        "PiNN, calibrated, with intervals.",
        has_posterior=True,
        unused=(
            "learning_rate",
            "weight_initial",
            "initial",
            "weight_physics",
            "weight_data",
            "lbfgs_iterations",
            "test_share",
            "batch",
        ),
    ),
    "fast": PresetInfo(
        "Fast",
        "The paper's loss, solved exactly: a point, biased where disturbances last.",
        True,
        unused=("lbfgs_iterations", "test_share"),
    ),
    "paper": PresetInfo(
        "Paper",
        "The paper's training by gradient, many minutes: a point, biased where disturbances last.",
        True,
        unused=("highest_frequency", "batch"),
    ),
}
"""Every preset, in the order of pages. On pages the default one stands for the recommended method
of the chosen model, whichever that is."""
PAPER_PRESETS = tuple(name for name, info in PRESET_INFOS.items() if info.minimises_papers_loss)
"""Presets whose estimates are the paper's."""
NAMES = "fast, calibrated or paper"
OF_PRESET: Any = None
"""The default of settings in which presets differ, until `PinnConfig` fills in the preset's."""
STRETCH = 1.1
"""Period of the Fourier features, in windows: motions at its ends need not be alike."""
SHORT: Seconds = 200.0
SHORT_FREQUENCY = 0.4
"""Least highest frequency of a shorter window, in Hz. One braking or one jump of a gap weighs more
there; with 0.15 Hz the parameters of a window of 145 s were 3 % off the limit of the loss."""

STARTS = (
    Parameters(1.0, 1.0, 1.0),
    Parameters(0.5, 0.5, 0.5),
    Parameters(0.1, 0.1, 1.0),
    Parameters(0.01, 0.5, 2.0),
    Parameters(2.0, 2.0, 2.0),
)
"""Five initial values; the paper trains from five, and prints only where they end."""
_RANGES: dict[str, tuple[float, float, str]] = {
    "iterations": (1, 1_000_000, ""),
    "seed": (0, 2**32 - 1, ""),
    "lbfgs_iterations": (0, 100_000, ""),
    "test_share": (0, 0.5, ""),
    "highest_frequency": (0.01, 2, " Hz"),
    "batch": (10, 100_000, ""),
    "layers": (1, 6, ""),
    "width": (5, 200, ""),
}
"""Least, most and unit."""


_USUAL: dict[PresetName, dict[str, float]] = {
    "fast": {"iterations": 600, "learning_rate": 0.01, "test_share": 0.0},
    "calibrated": {"iterations": 300, "learning_rate": 0.01, "test_share": 0.0},
    # The paper's parameters converge in around 20,000 iterations for all tests. It divides the data
    # but does not say how; a fifth for the test is usual.
    "paper": {"iterations": 20_000, "learning_rate": 0.001, "test_share": 0.2},
}


@dataclass(frozen=True)
class PinnConfig:
    """The settings that determine a training: equal configs give equal results."""

    preset: PresetName = DEFAULT
    """The training that runs; see `PRESETS`."""
    iterations: int = OF_PRESET
    """Adam iterations at most, or of `calibrated` rounds of its search; `fast` and `calibrated` end
    earlier once they have converged."""
    seed: int = 0
    """Seed of the network's initial weights, the minibatches and the train/test split."""
    initial: Parameters = STARTS[0]
    """Before the first iteration; the paper's notebooks start at ones. Another model than the CTHP
    starts at the `nonlinear` of these, or at its typical values where there are none."""
    weight_physics: tuple[float, float] = (1.0, 1.0)
    """Q: weights of the squared residuals of dp/dt and dv/dt in Ψ_F."""
    weight_initial: float = 0.0
    """R: weight of Ψ_R, the squared error at the first instant; the authors' notebooks use 1."""
    weight_data: tuple[float, float] = (1.0, 1.0)
    """S: weights of the squared errors of space-gap and speed in Ψ_D."""
    learning_rate: float = OF_PRESET
    """Adam's, not of `calibrated`; the paper's is 0.001."""
    lbfgs_iterations: int = 0
    """`paper` only: L-BFGS iterations after Adam, which the paper suggests but does not report."""
    test_share: float = OF_PRESET
    """`paper` only: share of instants, drawn at random, kept out of training."""
    highest_frequency: float = 0.15
    """In Hz, not of `paper`: the input features reach from a cycle per window or less to here, and
    in windows under 200 s to 0.4 Hz at least."""
    batch: int = 300
    """Random instants per Adam iteration of `fast`."""
    layers: int = 3
    """Hidden layers; the paper's network has three."""
    width: int = 60
    """Neurons of each; the paper's has sixty."""

    def __post_init__(self) -> None:
        """Fill in what the preset decides, and refuse what cannot be trained.

        Raises:
            ConfigError: naming the setting, its range and the value given.
        """
        is_known = isinstance(self.preset, str) and self.preset in PRESET_NAMES
        _require(is_known, "preset", NAMES, self.preset)
        for setting, value in _USUAL[self.preset].items():
            if getattr(self, setting) is OF_PRESET:
                object.__setattr__(self, setting, value)
        for setting, (least, most, unit) in _RANGES.items():
            given, allowed = getattr(self, setting), f"{least:,} to {most:,}{unit}"
            _require(_is_number(given) and least <= given <= most, _title(setting), allowed, given)
        is_set = isinstance(self.initial, Parameters)
        _require(is_set, "initial", "Parameters, as Parameters(1, 1, 1)", self.initial)
        initial = self.initial.values
        lowest, highest = np.transpose([(q.lowest, q.highest) for q in PARAMETERS])
        ranges = ", ".join(f"{q.symbol} from {q.lowest:g} to {q.highest:g}" for q in PARAMETERS)
        inside = initial.shape == (3,) and bool(((initial >= lowest) & (initial <= highest)).all())
        _require(inside, "initial", f"three numbers: {ranges}", initial.tolist())
        for setting in ("weight_physics", "weight_data"):
            pair = getattr(self, setting)
            is_pair = isinstance(pair, tuple) and [*map(_is_number, pair)] == [True, True]
            _require(is_pair, _title(setting), "a tuple of two numbers", pair)
        _require(_is_number(self.weight_initial), "weights", "numbers", self.weight_initial)
        weights = (*self.weight_physics, self.weight_initial, *self.weight_data)
        _require(all(isfinite(w) and w >= 0 for w in weights), "weights", "0 or more", weights)
        _require(min(self.weight_data) > 0, "data weights S", "above 0", self.weight_data)
        _require(min(self.weight_physics) > 0, "physics weights Q", "above 0", self.weight_physics)
        _require(
            _is_number(self.learning_rate) and 0 < self.learning_rate <= 1,
            "learning rate",
            "above 0 and at most 1",
            self.learning_rate,
        )
        if self.preset == "calibrated":
            _require(
                (self.weight_physics, self.weight_data, self.weight_initial) == ((1, 1), (1, 1), 0),
                "weights",
                "those of the preset, as the evidence determines them",
                weights,
            )
        if self.preset != "paper":
            for setting in ("lbfgs_iterations", "test_share"):
                given = getattr(self, setting)
                allowed = "0, or the paper preset, which has it"
                _require(not given, _title(setting), allowed, given)

    def angular_frequencies(self, duration: Seconds) -> FloatArray:
        """(n,) of the Fourier features in rad/s for a window in s; empty for the preset `paper`.

        They are whole cycles of a period that is longer than the window, up to the highest
        frequency (in short windows at least `SHORT_FREQUENCY`), and at least four. Half cycles per
        window would be twice as many features for the same motions.
        """
        period = STRETCH * duration
        least = SHORT_FREQUENCY if duration < SHORT else 0.0
        count = max(4, round(period * max(least, self.highest_frequency)))
        count = 0 if self.preset == "paper" else count
        return np.arange(1, count + 1, dtype=np.float64) * (2 * np.pi / period)

    @classmethod
    def default(cls) -> Self:
        """The settings of whoever chooses none."""
        return cls()

    @classmethod
    def with_changes(cls, changes: Mapping[str, Any]) -> Self:
        """The preset that the changes name, else the default one, with the other changes.

        Raises:
            ConfigError: for a setting that there is not, or one outside its range.
        """
        usual = preset(changes.get("preset", DEFAULT)).to_json()
        for name in changes:
            if name not in usual:
                raise ConfigError(
                    f"settings: {str(name)[:40]} is not known; choose from {', '.join(usual)}."
                )
        given = {name: _plain(value) for name, value in changes.items()}
        return cls.from_json(usual | given)

    def to_json(self) -> dict[str, Any]:
        """All settings, with lists in place of tuples and parameters."""
        document: dict[str, Any] = msgspec.json.decode(msgspec.json.encode(self, enc_hook=_numbers))
        return document

    @classmethod
    def from_json(cls, settings: dict[str, Any]) -> Self:
        """The settings that `to_json` gave, also where they come from someone else's file.

        Raises:
            ConfigError: when they are another method's, or outside their ranges.
        """
        if settings.keys() != FAST.to_json().keys():
            raise ConfigError("settings: these are not the PiNN's; choose a preset instead.")
        try:
            return msgspec.convert(settings, cls, dec_hook=lambda _, values: Parameters.of(values))
        except (TypeError, ValueError, ParameterError) as fault:
            place = re.search(r"\$\.(\w+)", str(fault))
            name = place[1] if place else "initial"
            raise ConfigError(
                f"settings: {name} = {shown(settings[name])} is not allowed; the presets have"
                f" {FAST.to_json()[name]}."
            ) from None

    def changes(self) -> dict[str, Any]:
        """The settings that differ from the preset, as in `to_json`."""
        usual = PRESETS[self.preset].to_json()
        return {name: value for name, value in self.to_json().items() if value != usual[name]}


def _plain(value: Any) -> Any:
    """A setting as JSON has it, where it is an object of this package or of numpy."""
    if isinstance(value, Parameters):
        return _numbers(value)
    if isinstance(value, np.ndarray | np.generic):
        return value.tolist()
    return value


def _title(setting: str) -> str:
    return setting.replace("_", " ").replace("lbfgs", "L-BFGS")


def _numbers(parameters: Parameters) -> list[float]:
    values = parameters.values if parameters.is_linear else parameters.everything
    numbers: list[float] = values.tolist()
    return numbers


def _require(good: bool, setting: str, allowed: str, given: object) -> None:
    if not good:
        raise ConfigError(f"{setting}: {shown(given)} is not allowed; choose {allowed}.")


def _is_number(value: Any) -> bool:
    return isinstance(value, Real) and not isinstance(value, bool)


CYCLE = 50
"""Adam iterations of the preset `fast` between exact solves."""
USUAL_ROUNDS, USUAL_CYCLES = {True: 8, False: 15}, {True: 1.5, False: 4.0}
"""Its usual numbers of exact rounds and of cycles, for the paper's model and for any other."""

FAST = PinnConfig("fast")
"""Fourier input features, exact output layer and parameters, Adam on the hidden layers."""

CALIBRATED = PinnConfig("calibrated")
"""Parameters by the network's evidence in place of its loss, unbiased where disturbances last."""

PAPER = PinnConfig("paper")
"""Raw time in, full batch, double precision, everything by Adam, as in the paper's section V.B."""

PRESETS: dict[str, PinnConfig] = {"fast": FAST, "calibrated": CALIBRATED, "paper": PAPER}


def preset(name: str, **changes: Any) -> PinnConfig:
    """A preset with some settings changed.

    Raises:
        ConfigError: for an unknown preset, or a setting outside its range.

    Examples:
        >>> import accpinn
        >>> accpinn.preset("fast", iterations=100, width=40).changes()
        {'iterations': 100, 'width': 40}
    """
    if not isinstance(name, str) or name not in PRESETS:
        given = shown(name).strip("'")
        raise ConfigError(f"preset: {given} is not known; choose {NAMES}.")
    return PinnConfig.with_changes({"preset": name, **changes}) if changes else PRESETS[name]
