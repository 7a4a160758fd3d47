"""The rows of a batch by groups: typical parameters, spread between windows, shares of stable ones.

Within a group the logarithms of α, β and τ over K windows follow the random-effects model of
`study.windows`: a between-window deviation d beside the sampling error of each window, which here
is the deviation of its posterior. The median over windows is exp(μ); its interval is

    exp(μ ± t_{K-1} √(1/Σ w_k))

with d in the weights, so that K windows that differ do not pretend to be one long one. Estimates of
zero have no logarithm and do not count. A group of one window has that window's interval.

The share of followers that are string stable is the mean of the posterior probabilities p_k. For
its interval, the number of stable ones among the K is the sum of independent events with these
probabilities, and given that number S the share has the distribution Beta(S + 1/2, K - S + 1/2)
(Jeffreys); the interval has the quantiles of this mixture. Windows count as independent, so where a
few vehicles make up a group, the interval is that of further windows of these vehicles.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from scipy.optimize import brentq
from scipy.special import betainc, stdtrit

from accpinn.channels import PARAMETER_KEYS
from accpinn.errors import ConfigError
from accpinn.inference.intervals import LEVEL
from accpinn.methods.maximum_likelihood import KEY
from accpinn.methods.registry import METHODS
from accpinn.study.rows import COLUMNS
from accpinn.study.studies import read_rows
from accpinn.study.windows import RandomEffects, random_effects
from accpinn.units import FloatArray

GROUPABLE = (
    "make", "model", "distance_setting", "campaign", "mode", "name", "file", "date", "method",
    "case",
)  # fmt: skip
"""Columns that rows may be grouped by."""
BY = ("make", "model", "distance_setting")
PROBABILITIES = ("p_l2_stable", "p_linf_stable")
TRIMMED_EVERY, NEGLIGIBLE = 128, 1e-18
"""After so many windows, numbers of stable ones with less than that probability are left out."""


@dataclass(frozen=True)
class Typical:
    """A group's value of one parameter."""

    median: float
    """Over windows; nan where no window determines it."""
    low: float
    """Lower end of its interval."""
    high: float
    between: RandomEffects
    """How far windows differ."""


@dataclass(frozen=True)
class Share:
    """A share of a group's followers, 0 to 1; nan where nothing is known."""

    value: float
    low: float
    high: float


@dataclass(frozen=True)
class Group:
    """What the windows of a group say."""

    values: tuple[str, ...]
    """Values of the columns that it is grouped by; empty where a header does not tell."""
    windows: int
    """Followers of windows: K."""
    vehicles: int
    """Different names within a campaign; where a file names none, its vehicles count by number."""
    alpha: Typical
    beta: Typical
    tau: Typical
    mean_time_gap: Share
    """In s: the median, and the quartiles of the windows."""
    l2_stable: Share
    linf_stable: Share

    @property
    def parameters(self) -> tuple[Typical, Typical, Typical]:
        """In the order α, β, τ."""
        return self.alpha, self.beta, self.tau


@dataclass(frozen=True)
class Groups:
    """The groups of a batch."""

    by: tuple[str, ...]
    method: str | None
    """None where rows are grouped by method."""
    level: float
    """Level of all intervals but the quartiles."""
    groups: tuple[Group, ...]


def read_study(study: str | Path) -> pd.DataFrame:
    """The rows of a batch with the columns of `COLUMNS`, also while it runs.

    What is no number, or no probability where one should be, is nan.

    Raises:
        RecordingError: where there is no batch, or its file is damaged.
    """
    frame = pd.DataFrame(read_rows(Path(study)), columns=[column.name for column in COLUMNS])
    for column in COLUMNS:
        if column.kind == "double":
            frame[column.name] = pd.to_numeric(frame[column.name], errors="coerce")
    for name in PROBABILITIES:
        frame[name] = frame[name].where(frame[name].between(0.0, 1.0))
    return frame


def group(
    rows: pd.DataFrame,
    by: Sequence[str] = BY,
    method: str | None = None,
    level: float = LEVEL,
) -> Groups:
    """Group the rows of a batch.

    Args:
        rows: as `read_study` gives them, or some of these.
        by: columns, from `GROUPABLE`.
        method: whose estimates; by default maximum likelihood where it has some, else the first.
        level: of the intervals, above 0 and below 1.

    Raises:
        ConfigError: for a column, a method or a level that is not allowed.
    """
    for name in by:
        if name not in GROUPABLE:
            raise ConfigError(f"by: {name[:40]} is not known; choose from {', '.join(GROUPABLE)}.")
    if not 0.0 < level < 1.0:
        raise ConfigError(f"level: {level:g} is not allowed; choose above 0 and below 1, as 0.9.")
    chosen = None if "method" in by and method is None else _method(rows, method)
    part = rows if chosen is None else rows[rows["method"] == chosen]
    labels = part[list(by)].fillna("").astype(str) if by else part[[]]
    keys = pd.Series(list(labels.itertuples(index=False, name=None)), part.index, object)
    groups = [_group(key, members, level) for key, members in part.groupby(keys)]
    return Groups(tuple(by), chosen, level, tuple(groups))


def _method(rows: pd.DataFrame, method: str | None) -> str | None:
    known = list(dict.fromkeys(rows["method"]))
    if method is None:
        return next((key for key in (KEY, *METHODS, *known) if key in known), KEY)
    if known and method not in known:
        raise ConfigError(f"method: {method[:40]} has no rows; choose {', '.join(known)}.")
    return method


def _group(key: Iterable[Any], rows: pd.DataFrame, level: float) -> Group:
    alpha, beta, tau = (_typical(rows, name, level) for name in PARAMETER_KEYS)
    gaps = rows["mean_time_gap"].dropna()
    who = rows[["campaign", "name"]].fillna("")
    who["sha256"] = rows["sha256"].where(rows["make"].fillna("") == "", "")
    quartiles = gaps.quantile([0.5, 0.25, 0.75]).tolist() if len(gaps) else [np.nan] * 3
    return Group(
        values=tuple(map(str, key)),
        windows=len(rows),
        vehicles=len(who.drop_duplicates()),
        alpha=alpha,
        beta=beta,
        tau=tau,
        mean_time_gap=Share(*quartiles),
        l2_stable=share(rows["p_l2_stable"].dropna().to_numpy(), level),
        linf_stable=share(rows["p_linf_stable"].dropna().to_numpy(), level),
    )


def _typical(rows: pd.DataFrame, name: str, level: float) -> Typical:
    values, errors = (rows[column].to_numpy(float) for column in (name, f"{name}_error"))
    logs = np.log(np.where(values > 0, values, np.nan))
    effects = random_effects(logs, errors, level)
    if effects.windows < 2:
        counts = np.isfinite(values) & np.isfinite(errors)
        known = rows[counts & (values > 0)] if effects.windows else rows[counts]
        if len(known) != 1:
            return Typical(np.nan, np.nan, np.nan, effects)
        value, low, high = known[[name, f"{name}_low", f"{name}_high"]].to_numpy(float)[0].tolist()
        return Typical(value, low, high, effects)
    reach = float(stdtrit(effects.windows - 1, (1 + level) / 2)) * effects.error
    with np.errstate(over="ignore"):  # two windows that differ widely set no upper limit
        ends = np.exp(effects.mean + np.array([-reach, reach]))
    return Typical(effects.typical, float(ends[0]), float(ends[1]), effects)


def share(probabilities: FloatArray, level: float = LEVEL) -> Share:
    """The share of stable followers, from the probability (K,) of each to be stable."""
    count = len(probabilities)
    if not count:
        return Share(np.nan, np.nan, np.nan)
    weights, least = np.ones(1), 0  # of each possible number of stable ones, from the least on
    for k, p in enumerate(probabilities, 1):
        weights = np.convolve(weights, [1.0 - p, p])
        if k % TRIMMED_EVERY == 0:
            counting = np.flatnonzero(weights > NEGLIGIBLE)
            least += int(counting[0])
            weights = weights[counting[0] : counting[-1] + 1]
    stable = least + np.arange(len(weights))

    def quantile(tail: float) -> float:
        def beyond(x: float) -> float:
            return float(weights @ betainc(stable + 0.5, count - stable + 0.5, x)) - tail

        return float(brentq(beyond, 0.0, 1.0, xtol=1e-9))

    tail, value = (1.0 - level) / 2.0, float(np.mean(probabilities))
    # A share of 0 or 1 is an end of its interval.
    return Share(value, min(quantile(tail), value), max(quantile(1.0 - tail), value))
