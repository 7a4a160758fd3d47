"""Whether a method finds what a snapshot says it found: its weights' curves, and the method anew.

On one machine a method gives the same to the last digit. Another processor rounds otherwise, and
the network's training carries that on, so there its parameters count and no more.
"""

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from accpinn.errors import AccpinnError, ConfigError
from accpinn.evaluation.cross_validation import Block, cross_validate
from accpinn.evaluation.evaluation import Evaluation
from accpinn.methods.fit import Fit, Outcome
from accpinn.methods.registry import METHODS
from accpinn.model.cthp import Trajectories
from accpinn.results.snapshot.agreement import Check, compared
from accpinn.results.snapshot.content import Snapshot
from accpinn.results.snapshot.create import light
from accpinn.results.snapshot.recompute import mae
from accpinn.results.tables.names import name_of
from accpinn.segment.segment import Segment
from accpinn.units import Seconds

SAME = 1e-6
"""Methods that solve or filter agree to this share on any machine."""
INSTANTS = 300
"""At which the network's curves are computed."""
BLOCK_TOLERANCE: Seconds = 1e-3
DRAWN = 1e-4
"""m and m/s by which they may differ."""


def network_curve(fit: Fit) -> Iterator[Check]:
    """Whether the network's stored curves are what its weights give; nothing for other methods."""
    redraw = METHODS[fit.method].redraw
    if redraw is None:
        return
    name = "Network's curves"
    if fit.surrogate is None:
        yield Check(name, "missing", "from the weights", False, "The curves are missing.")
        return
    time = fit.surrogate.time
    some = np.unique(np.linspace(0, len(time) - 1, INSTANTS).round().astype(int))
    try:
        drawn = redraw(fit, time[some], float(time[-1]))
    except ConfigError as fault:
        yield Check(name, "stored", "not possible", False, str(fault))
        return
    apart = _apart(fit.surrogate, drawn, some)
    ok = apart <= DRAWN
    sentence = "They are what the weights give." if ok else f"They differ by up to {apart:.3g}."
    ends = [f"last gap {curves.gaps[-1, -1]:.3f} m" for curves in (fit.surrogate, drawn)]
    yield Check(name, ends[0], ends[1], ok, sentence)


def _apart(stored: Trajectories, drawn: Trajectories, some: NDArray[np.int_]) -> float:
    with np.errstate(invalid="ignore", over="ignore"):
        speeds = np.abs(stored.speeds[some] - drawn.speeds).max()
        return float(max(speeds, np.abs(stored.gaps[some] - drawn.gaps).max()))


def repeatable(fit: Fit) -> str:
    """Why a method cannot be run again; empty where it can."""
    if fit.outcome is Outcome.STOPPED:
        return "its training was stopped by hand"
    if "started_from" in fit.config:
        return "its training began from weights that are not in the snapshot"
    return ""


def refitted(snapshot: Snapshot, segment: Segment) -> Iterator[Check]:
    """Every method of the snapshot run again on the data, also without the blocks held out."""
    fit, worth = snapshot.fit, snapshot.evaluation
    if not repeatable(fit):
        yield from _again("", fit, worth, segment)
    for row in snapshot.rows:
        if not repeatable(row.fit):
            yield from _again(f", {name_of(row.fit)}", row.fit, row.evaluation, segment)


def _again(ending: str, fit: Fit, worth: Evaluation | None, segment: Segment) -> Iterator[Check]:
    name = f"Method run again{ending}"
    try:
        found = _estimate(segment, fit)
        yield _same_fit(name, fit, light(found) if ending else found)
        if worth and worth.blocks:
            blocks = cross_validate(segment, lambda part: _estimate(part, fit))
            yield from _same_blocks(f"held out{ending}", worth.blocks, blocks, fit)
    except (AccpinnError, ValueError) as fault:
        yield Check(name, _law(fit), "not possible", False, str(fault))


def _same_blocks(
    ending: str, stored: Sequence[Block], computed: Sequence[Block], fit: Fit
) -> Iterator[Check]:
    """Blocks of the same time; versions that hold out others are not called wrong for it."""
    now = {round(block.window.start, 3): block for block in computed}
    for k, old in enumerate(stored, start=1):
        name, new = f"Block {k} {ending}", now.get(round(old.window.start, 3))
        if new is None or abs(new.window.duration - old.window.duration) > BLOCK_TOLERANCE:
            sentence = "Not compared, as other blocks were held out then."
            yield Check(name, mae(old.errors), "not computed", True, sentence)
            continue
        texts = mae(old.errors), mae(new.errors)
        yield compared(name, texts, old.errors, new.errors, _tolerance(fit))


def _estimate(segment: Segment, fit: Fit) -> Fit:
    """The same method with the same settings, on a segment."""
    method = METHODS[fit.method]
    settings = method.settings.from_json(fit.config) if method.settings else None
    return method.fit(segment, fit.case, settings)


def _same_fit(name: str, old: Fit, new: Fit) -> Check:
    texts = _law(old), _law(new)
    whole = compared(name, texts, _bare(old), _bare(new), SAME)
    if whole.ok or _tolerance(old) == SAME:
        return whole
    parameters = compared(name, texts, old.parameters, new.parameters, _tolerance(old))
    if not parameters.ok:
        return parameters
    sentence = "The parameters agree; other figures of the training differ, as between processors."
    return replace(parameters, sentence=sentence)


def _bare(fit: Fit) -> Fit:
    """Without what differs from run to run."""
    history = fit.history
    if history is not None:
        history = replace(history, seconds=np.zeros_like(history.seconds))
    return replace(fit, seconds=0.0, cached=False, findings=(), history=history)


def _tolerance(fit: Fit) -> float:
    return METHODS[fit.method].tolerance


def _law(fit: Fit) -> str:
    law = fit.parameters[0]
    return f"α {law.alpha:.6g}, β {law.beta:.6g}, τ {law.tau:.6g}"
