"""The page itself: the story's parts put into a template, with every script and style inside."""

import base64
import hashlib
import json
import re
from collections.abc import Iterable
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from typing import Any

from jinja2 import Environment, FileSystemLoader, StrictUndefined, Template
from markupsafe import Markup
from plotly.offline import get_plotlyjs

from accpinn import __version__
from accpinn.results.figures.style import vehicle_colour
from accpinn.results.messages import messages
from accpinn.results.messages import summary as words
from accpinn.results.messages.methods import outcome_message
from accpinn.results.messages.snapshot import check_rows, summary
from accpinn.results.messages.stability import PLACES, reason
from accpinn.results.report import pictures
from accpinn.results.report.pictures import Picture
from accpinn.results.snapshot.create import stability
from accpinn.results.snapshot.schema import Snapshot
from accpinn.results.snapshot.verification import Verification, verify
from accpinn.results.tables.estimates import (
    TITLES,
    intervals_table,
    learned_parameters,
    methods_table,
    parameter_table,
)
from accpinn.results.tables.stability import stability_interval_table, stability_table
from accpinn.results.tables.table import STYLE, Table

HERE = Path(__file__).parent
WIDE = 9
"""Columns beyond which a table is set smaller."""


def render_report(snapshot: Snapshot, verification: Verification | None = None) -> str:
    """The whole page.

    Args:
        snapshot: what it is about.
        verification: what was checked; by default done now, from the snapshot's own contents.
    """
    verification = verification or verify(snapshot)
    if snapshot.stability:  # shown as it follows from the parameters, whatever was stored
        snapshot = replace(snapshot, stability=stability(snapshot.fit))
    script = (HERE / "page.js").read_text(encoding="utf-8")
    shown = list[Picture]()
    story = _story(snapshot, verification, shown)
    document = json.dumps(pictures.all_drawn(shown), ensure_ascii=False, separators=(",", ":"))
    return _template().render(
        story,
        style=Markup((HERE / "page.css").read_text(encoding="utf-8")),
        table_style=Markup(re.sub(r"</?style>", "", STYLE)),
        plotly=Markup(get_plotlyjs()),
        script=Markup(script),
        # Inside a script element only "<" could end it early.
        drawings=Markup(document.replace("<", "\\u003c")),
        policy=_policy(get_plotlyjs(), script),
        version=__version__,
    )


@dataclass(frozen=True)
class Sheet:
    """A table on the page, and as files."""

    html: Markup
    wide: bool
    files: tuple[tuple[str, str, str], ...]
    """Label, file name and data address of each."""


def _story(snapshot: Snapshot, checked: Verification, shown: list[Picture]) -> dict[str, Any]:
    info, evaluation, uncertainty = snapshot.info, snapshot.evaluation, snapshot.uncertainty
    fit, report = snapshot.fit, snapshot.stability
    vehicles = learned_parameters(info, fit)
    paints = [vehicle_colour(number, info.vehicles[0]) for number in info.vehicles]
    motion, run = pictures.motion(snapshot), pictures.platoon(snapshot)
    errors = (evaluation.surrogate, evaluation.closed_loop) if evaluation else (None, None)
    tables = {"parameters": parameter_table(info, fit, snapshot.quality, *errors).coloured(paints)}
    if uncertainty:
        tables["intervals"] = intervals_table(info, uncertainty).coloured(paints[1:])
    if report:
        tables["stability"] = stability_table(vehicles, report).coloured(paints[1:])
    if report and uncertainty:
        table = stability_interval_table(vehicles, uncertainty)
        tables["stability_intervals"] = table.coloured(paints[1:])
    return {
        "snapshot": snapshot,
        "title": words.title(snapshot),
        "summary": words.summary(snapshot),
        "about": words.about_data(snapshot),
        "cautions": words.cautions(snapshot),
        "motion": _placed([motion] if motion else [], shown),
        "sheets": {name: _sheet(table, name) for name, table in tables.items()},
        "uncertainty": uncertainty,
        "fits": _placed(pictures.fits(snapshot), shown),
        "training": _placed(pictures.training(snapshot), shown),
        "reasons": _reasons(snapshot),
        "stability_pictures": _placed(pictures.stability(snapshot), shown),
        "platoon": _placed(run[1] if run else [], shown),
        "run": run[0] if run else None,
        "run_warnings": messages(run[0].findings, PLACES) if run else (),
        "repeated": run[2] if run else "",
        "methods": [
            _sheet(methods_table(info, snapshot.methods, k), f"methods_{k + 1}")
            for k in range(info.followers if snapshot.methods else 0)
        ],
        "checked": checked,
        "verdict": summary(checked, info),
        "checks": check_rows(checked, info),
        "outcome": outcome_message(fit),
        "method": TITLES.get(fit.method, fit.method),
        "settings": [
            (key.replace("_", " "), words.setting(value))
            for key, value in sorted(fit.config.items())
        ],
    }


def _reasons(snapshot: Snapshot) -> list[tuple[str, list[str]]]:
    """Per vehicle, and for the platoon, a sentence for every verdict."""
    report = snapshot.stability
    if report is None:
        return []
    reasons = [
        (label, [reason(verdict, v) for verdict in (v.l2, v.linf_paper, v.linf_exact)])
        for label, v in zip(snapshot.info.labels[1:], report.vehicles, strict=True)
    ]
    if len(report.vehicles) > 1:
        platoon = report.platoon
        weak = (platoon.l2_weak, platoon.linf_weak)
        reasons.append(("The platoon", [reason(verdict, report) for verdict in weak]))
    return reasons


def _placed(new: Iterable[Picture], shown: list[Picture]) -> list[tuple[int, Picture]]:
    """The pictures with their places in the list that the script draws, to which they are added."""
    first = len(shown)
    shown.extend(new)
    return list(enumerate(shown[first:], first))


def _sheet(table: Table, name: str) -> Sheet:
    files = (
        ("CSV", f"{name}.csv", "text/csv", table.to_csv()),
        ("LaTeX", f"{name}.tex", "application/x-tex", table.to_latex()),
    )
    return Sheet(
        Markup(table.to_html()),
        len(table.columns) > WIDE,
        tuple(
            (label, file, f"data:{mime};charset=utf-8;base64,{_base64(text.encode())}")
            for label, file, mime, text in files
        ),
    )


def _base64(content: bytes) -> str:
    return base64.b64encode(content).decode()


def _policy(*scripts: str) -> str:
    """Only these scripts run, and nothing is loaded from anywhere."""
    hashes = (_base64(hashlib.sha256(script.encode()).digest()) for script in scripts)
    allowed = " ".join(f"'sha256-{digest}'" for digest in hashes)
    return (
        f"default-src 'none'; script-src {allowed}; style-src 'unsafe-inline';"
        " img-src data: blob:; base-uri 'none'; form-action 'none'"
    )


@cache
def _template() -> Template:
    made = Environment(
        loader=FileSystemLoader(HERE),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    return made.get_template("page.html")
