"""All that is known of a result as one zip file: report, snapshot, tables, curves as numbers."""

import io
import re
import zipfile
from collections.abc import Iterator

import pandas as pd

from accpinn.channels import GAP, PARAMETERS, SPEED, TIME
from accpinn.evaluation.closed_loop import closed_loop
from accpinn.methods.fit import History
from accpinn.model.cthp import Trajectories
from accpinn.results.report import render_report, tables_of
from accpinn.segment.segment import SegmentInfo
from accpinn.study.result import Result
from accpinn.study.snapshot import SUFFIX, to_bytes
from accpinn.units import FloatArray

UNCHANGING = (2020, 1, 1, 0, 0, 0)
"""Date of every file, so that equal results make equal bundles."""


def bundle(snapshot: Result) -> bytes:
    """The zip file of a snapshot.

    It holds report.html, the snapshot, each table as CSV and LaTeX, and as CSV the training's
    history and the motion: measured, of the method, and in closed loop where these are known.
    """
    content = io.BytesIO()
    with zipfile.ZipFile(content, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, data in _files(snapshot):
            archive.writestr(zipfile.ZipInfo(name, UNCHANGING), data, zipfile.ZIP_DEFLATED)
    return content.getvalue()


def _files(snapshot: Result) -> Iterator[tuple[str, str | bytes]]:
    yield "report.html", render_report(snapshot)
    yield f"result{SUFFIX}", to_bytes(snapshot)
    for name, table in tables_of(snapshot).items():
        yield f"tables/{name}.csv", table.to_csv()
        yield f"tables/{name}.tex", table.to_latex()
    fit, segment, info = snapshot.fit, snapshot.segment, snapshot.info
    if fit.history:
        yield "training.csv", _history(fit.history, info)
    if segment:
        yield "motion_measured.csv", _motion(info, segment.measured)
        if driven := closed_loop(segment, fit):
            yield "motion_closed_loop.csv", _motion(info, driven)
    if fit.surrogate:
        yield f"motion_{fit.method}.csv", _motion(info, fit.surrogate)


def _motion(info: SegmentInfo, source: Trajectories) -> str:
    """Time, and speed and space-gap of each vehicle; empty where a sample is missing."""
    columns: dict[str, FloatArray] = {_named("time", TIME.unit): info.window.start + source.time}
    for k, number in enumerate(info.vehicles):
        columns[_named(f"speed {number}", SPEED.unit)] = source.speeds[:, k]
        if k:
            columns[_named(f"gap {number}", GAP.unit)] = source.gaps[:, k - 1]
    return _csv(columns)


def _history(history: History, info: SegmentInfo) -> str:
    """Iteration, seconds, terms of the loss, and the parameters of each follower."""
    names = ("iteration", "seconds", "total", "data", "physics", "initial")
    columns: dict[str, FloatArray] = {name: getattr(history, name) for name in names}
    sets = history.parameters.values.shape[1]
    followers = ("all",) if sets == 1 and info.followers > 1 else info.vehicles[1:]
    for k, follower in enumerate(followers):
        for which, quantity in enumerate(PARAMETERS):
            values = history.parameters.values[:, k, which]
            columns[_named(f"{quantity.key} {follower}", quantity.unit)] = values
    return _csv(columns)


def _named(words: str, unit: str) -> str:
    """As in the tables' files: lower-case words and the unit, joined by underscores."""
    spelt = unit.replace("1/s²", "per s2").replace("1/s", "per s").replace("/", " per ")
    return re.sub(r"\W+", "_", f"{words} {spelt}")


def _csv(columns: dict[str, FloatArray]) -> str:
    return pd.DataFrame(columns).to_csv(index=False, float_format="%.9g", lineterminator="\n")
