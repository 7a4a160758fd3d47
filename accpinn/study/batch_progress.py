"""How far a batch has got, how long the rest takes, and what it came to.

Each file is a share of the work, split evenly among its tasks; what is known already takes no time.
"""

import time
from collections.abc import Sequence
from dataclasses import dataclass, field

from accpinn.methods.registry import METHODS
from accpinn.units import Seconds

INTERVALS_SECONDS = POOLING_SECONDS = 2.0
"""Of a window's intervals, and of a vehicle's windows taken together, as the typical seconds of
methods."""


@dataclass(frozen=True)
class BatchSummary:
    """What a batch has come to."""

    recordings: int
    """That could be read."""
    refused: int
    """Files, and trajectories of tables, that could not be read."""
    windows: int
    followers: int
    """Over all windows: followers of each."""
    rows: int
    """One a window, follower and method."""
    failed: int
    """Methods on windows that have no result."""
    reused: int
    """Rows that were there already."""
    seconds: Seconds
    stopped: bool
    """Whether it ended early because the caller said so."""
    unknown_names: tuple[str, ...] = ()
    """Of followers whose make and model the package does not know in one spelling."""


@dataclass(frozen=True)
class BatchProgress:
    """How far a batch has got."""

    files: int
    done: float
    """Files, those in work as fractions."""
    windows: int
    """Finished."""
    rows: int
    """Known so far, those reused included."""
    failed: int
    workers: int
    seconds: Seconds
    seconds_left: Seconds | None
    """None as long as nothing is known."""
    vehicles: int = 0
    """Whose windows are taken together at the end; known once all windows are finished."""
    pooled: int = 0
    """Of these, how many are finished."""
    share: float = 0.0
    """Of all the work that is done, 0 to 1."""


@dataclass
class Tally:
    """What a batch has counted so far."""

    files: int
    methods: tuple[str, ...]
    pools_vehicles: bool
    """Whether the windows of each vehicle are taken together at the end."""
    started: float
    """By the monotonic clock."""
    recordings: int = 0
    refused: int = 0
    windows: int = 0
    followers: int = 0
    rows: int = 0
    failed: int = 0
    reused: int = 0
    finished: int = 0
    """Windows."""
    pooled: int = 0
    """Vehicles."""
    is_done: bool = False
    _done: float = 0.0
    """Files, those in work as fractions."""
    _computed: float = 0.0
    """The same without what was known."""
    _shares: dict[str, float] = field(default_factory=dict)
    _vehicles: int = 0
    _pooling_since: float | None = None

    def plan_file(self, keys: Sequence[str]) -> None:
        """A file has these tasks left to do."""
        if not keys:
            self._done += 1.0
        self._shares |= {key: 1.0 / len(keys) for key in keys}

    def plan_pooling(self, vehicles: int) -> None:
        """The windows of so many vehicles are now taken together."""
        self._vehicles, self._pooling_since = vehicles, time.monotonic()

    def finish(self, key: str) -> None:
        """A window's task has ended."""
        share = self._shares.pop(key)
        self._done += share
        self._computed += share
        self.finished += 1

    def summary(self, stopped: bool, unknown_names: tuple[str, ...]) -> BatchSummary:
        """What it came to; the arguments are those of `BatchSummary`."""
        return BatchSummary(
            recordings=self.recordings,
            refused=self.refused,
            windows=self.windows,
            followers=self.followers,
            rows=self.rows,
            failed=self.failed,
            reused=self.reused,
            seconds=round(time.monotonic() - self.started, 3),
            stopped=stopped,
            unknown_names=unknown_names,
        )

    def progress(self, workers: int) -> BatchProgress:
        """How far it has got, with so many workers."""
        pooling = self._pooling_cost() if self.pools_vehicles else 0.0
        done = min(self._done / self.files, 1.0)
        together = 1.0 if self.is_done else self.pooled / max(1, self._vehicles)
        return BatchProgress(
            files=self.files,
            done=min(self._done, self.files),
            windows=self.finished,
            rows=self.rows,
            failed=self.failed,
            workers=workers,
            seconds=time.monotonic() - self.started,
            seconds_left=self._seconds_left(pooling),
            vehicles=self._vehicles,
            pooled=self.pooled,
            share=1.0 if self.is_done else (done + pooling * together) / (1.0 + pooling),
        )

    def _pooling_cost(self) -> float:
        """Of taking vehicles' windows together, against the methods on all windows."""
        every = sum(METHODS[key].typical_seconds for key in self.methods) + INTERVALS_SECONDS
        return POOLING_SECONDS / every

    def _seconds_left(self, pooling: float) -> Seconds | None:
        """By the pace of the stage that runs, and before the last one by its usual cost."""
        now = time.monotonic()
        if self.is_done:
            return 0.0
        if self._pooling_since is not None and self.pooled:
            spent = now - self._pooling_since
            return spent * (self._vehicles - self.pooled) / self.pooled
        if self._computed <= 0:
            return None
        since = self._pooling_since or now
        a_file = (since - self.started) / self._computed
        left = max(0.0, self.files - self._done) * a_file
        return max(0.0, left + pooling * self.files * a_file - (now - since))
