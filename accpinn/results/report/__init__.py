"""The report: a snapshot as one web page that needs no network, for people without accpinn.

The story's parts are put into a template, with every script and style inside. Its figures are those
of the app's pages, with legends and with rounded numbers.
"""

import base64
import hashlib
import html
import json
import re
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import cache
from math import isfinite
from pathlib import Path
from typing import Any

import numpy as np
import plotly.graph_objects as go
from jinja2 import Environment, FileSystemLoader, StrictUndefined, Template
from markupsafe import Markup
from plotly.offline import get_plotlyjs

from accpinn import __version__
from accpinn.channels import GAP, PARAMETER_KEYS, SPEED
from accpinn.errors import ParameterError
from accpinn.evaluation.closed_loop import closed_loop
from accpinn.inference.prediction import gap_band
from accpinn.platoon.leader import Sinusoid
from accpinn.platoon.simulation import PlatoonRun, simulate_platoon
from accpinn.results.figures import platoon as platoon_figures
from accpinn.results.figures import stability as stability_figures
from accpinn.results.figures.style import (
    POINTS,
    composed,
    curve,
    stack,
    thinned,
    vehicle_colours,
    with_legend,
)
from accpinn.results.figures.training import loss_history, parameter_history, tracking
from accpinn.results.messages import messages
from accpinn.results.messages import summary as words
from accpinn.results.messages.stability import BY_ESTIMATES, PLACES, Places, reason
from accpinn.results.tables.estimates import (
    TITLES,
    learned_parameters,
    methods_table,
    model_form_table,
    name_of,
    parameter_table,
    row_vehicles,
)
from accpinn.results.tables.stability import (
    stability_interval_table,
    stability_table,
    without_parameters,
)
from accpinn.results.tables.table import STYLE, Table
from accpinn.results.tables.verification import verification_table
from accpinn.study.result import Result
from accpinn.study.verification import QUICK, Verification, verify

HERE = Path(__file__).parent
WIDE = 9
"""Number of columns beyond which a table is set smaller."""
FOLLOWERS = 8
"""Followers of the simulated platoon where only one is known."""
DIGITS = 5
"""Significant digits of every number drawn; a screen shows four."""
ALL_POINTS, FEWEST_POINTS = 70_000, 150
"""Points of all lines together, and of a single line at least. The page is to stay below 6 MB, of
which plotly takes 5."""


@dataclass(frozen=True, eq=False)
class Picture:
    """A figure with a name for its file and a caption."""

    name: str
    figure: go.Figure
    caption: str

    def drawn(self, points: int) -> dict[str, Any]:
        """Data and layout for plotly, rounded, with about so many points a line at most."""
        # A whole figure would hand out its numbers as bytes in base 64; its parts do not.
        layout = {
            key: _roomy(part) if key[1:5] == "axis" else part
            for key, part in self.figure.layout.to_plotly_json().items()
            if key != "template"
        }
        traces = [_coarse(trace.to_plotly_json(), points) for trace in self.figure.data]
        return {"name": self.name, "data": _plain(traces), "layout": _plain(layout)}


def render_report(snapshot: Result, verification: Verification | None = None) -> str:
    """The whole page.

    Args:
        snapshot: what it is about.
        verification: what was checked; by default done now, from the snapshot's own contents,
            without running its methods again.
    """
    verification = verification or verify(snapshot, refit_within=QUICK)
    script = (HERE / "page.js").read_text(encoding="utf-8")
    shown = list[Picture]()
    story = _story(snapshot, verification, shown)
    document = json.dumps(_all_drawn(shown), ensure_ascii=False, separators=(",", ":"))
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


def tables_of(snapshot: Result) -> dict[str, Table]:
    """Every table of a report by its name, with the vehicles' colours."""
    info, evaluation, uncertainty = snapshot.info, snapshot.evaluation, snapshot.uncertainty
    fit, report, adequacy = snapshot.fit, snapshot.stability, snapshot.parts.adequacy
    errors = (evaluation.surrogate, evaluation.closed_loop) if evaluation else (None, None)
    paints = vehicle_colours(info.vehicles)
    first = parameter_table(info, fit, snapshot.quality, *errors, uncertainty)
    rows = vehicle_colours(info.vehicles, row_vehicles(info, fit.case))
    tables = {"parameters": first.coloured(rows)}
    forms = adequacy.forms if adequacy else ()
    for k in range(info.followers if forms else 0):
        tables[f"forms_{k + 1}"] = model_form_table(info, forms, k)
    if report:
        vehicles = learned_parameters(info, fit)
        tables["stability"] = stability_table(vehicles, report, uncertainty).coloured(paints[1:])
        if uncertainty:
            table = stability_interval_table(vehicles, uncertainty)
            tables["stability_intervals"] = table.coloured(paints[1:])
    for k in range(info.followers if snapshot.compared else 0):
        tables[f"methods_{k + 1}"] = methods_table(info, snapshot.compared, k)
    return tables


def _story(snapshot: Result, checked: Verification, shown: list[Picture]) -> dict[str, Any]:
    info, uncertainty, fit = snapshot.info, snapshot.uncertainty, snapshot.fit
    motion, run = motion_picture(snapshot), platoon_pictures(snapshot)
    adequacy = snapshot.parts.adequacy
    sheets = {name: _sheet(table, name) for name, table in tables_of(snapshot).items()}
    fits, responses = [*fit_pictures(snapshot)], [*stability_pictures(snapshot)]
    first_page = [*fits[:1], *responses[:1]]
    return {
        "first_page": _placed(first_page, shown),
        "snapshot": snapshot,
        "title": words.title(snapshot),
        "summary": words.summary(snapshot),
        "about": words.about_data(snapshot),
        "cautions": words.cautions(snapshot),
        "motion": _placed([motion] if motion else [], shown),
        "sheets": sheets,
        "uncertainty": uncertainty,
        "conditional": words.conditional(adequacy, info),
        "forms": messages(adequacy.findings if adequacy else (), info),
        "fits": _placed(fits[1:], shown),
        "band": words.BAND if snapshot.segment and uncertainty else "",
        "training": _placed(training_pictures(snapshot), shown),
        "by_estimates": BY_ESTIMATES if uncertainty else "",
        "reasons": _reasons(snapshot),
        "stability_pictures": _placed(responses[1:], shown),
        "platoon": _placed(run[1] if run else [], shown),
        "run": run[0] if run else None,
        "run_warnings": messages(run[0].findings, _places(snapshot)) if run else (),
        "repeated": run[2] if run else "",
        "form_sheets": [sheet for name, sheet in sheets.items() if name.startswith("forms_")],
        "methods": [sheet for name, sheet in sheets.items() if name.startswith("methods_")],
        "checked": checked,
        "verdict": checked.sentence,
        "checks": Markup(verification_table(checked).to_html()),
        "outcome": fit.outcome.value,
        "method": TITLES.get(fit.method, fit.method),
        "settings": [
            (key.replace("_", " "), words.setting(value))
            for key, value in sorted(fit.config.items())
        ],
    }


def _reasons(snapshot: Result) -> list[tuple[str, list[str]]]:
    """For each vehicle, and for the platoon, sentences that say what the table does not.

    The table has all that is to be said about a vehicle's L₂ verdict.
    """
    report = snapshot.stability
    if report is None:
        return []
    reasons = [
        (label, [reason(verdict, v) for verdict in (v.linf_paper, v.linf_exact)])
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


def _sheet(table: Table, name: str) -> dict[str, Any]:
    """A table on the page, and as files: label, file name and data address of each."""
    files = (
        ("CSV", f"{name}.csv", "text/csv", table.to_csv()),
        ("LaTeX", f"{name}.tex", "application/x-tex", table.to_latex()),
    )
    return {
        # The first page has α, β and τ; they would not leave the verdicts room.
        "html": Markup((without_parameters(table) if name == "stability" else table).to_html()),
        "wide": len(table.columns) > WIDE,
        "files": [
            (label, file, f"data:{mime};charset=utf-8;base64,{_base64(text.encode())}")
            for label, file, mime, text in files
        ],
    }


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


def motion_picture(snapshot: Result) -> Picture | None:
    """Gaps and speeds of the window: the data, or else the method's own curves."""
    source = snapshot.segment.measured if snapshot.segment else snapshot.fit.surrogate
    if source is None:
        return None
    info, traces = snapshot.info, []
    time = info.window.start + source.time
    for k, (label, colour) in enumerate(
        zip(info.labels, vehicle_colours(info.vehicles), strict=True)
    ):
        name = html.escape(label) + (" (leader)" if k == 0 else "")
        drawn = [(2, source.speeds[:, k], SPEED)]
        drawn += [(1, source.gaps[:, k - 1], GAP)] if k else []
        traces += [
            curve(time, values, panel, name=name, legendgroup=name, showlegend=panel == 2,
                  line={"color": colour, "width": 1.8}, mode="lines",
                  hovertemplate=f"%{{y:.2f}} {channel.unit}")
            for panel, values, channel in drawn
        ]  # fmt: skip
    words = (
        "Measured space-gaps and speeds."
        if snapshot.segment
        else "The data are not part of this report: these are the method's own trajectories."
    )
    figure = composed(traces, 460, "motion", grid=stack(0.5, 0.5), channels=(GAP, SPEED))
    return Picture("motion", with_legend(figure), words)


def fit_pictures(snapshot: Result) -> Iterator[Picture]:
    """Per follower: the method's curve, with the data and the closed loop where these are known."""
    fit, segment, uncertainty = snapshot.fit, snapshot.segment, snapshot.uncertainty
    if segment is None and fit.surrogate is None:
        return
    driven = closed_loop(segment, fit) if segment else None
    predicted = gap_band(segment, uncertainty, fit.case) if segment and uncertainty else None
    disturbance, info = fit.arrays.get("disturbance"), snapshot.info
    for k, label in enumerate(info.labels[1:]):
        figure = tracking(
            segment or info, k, fit.surrogate, driven, name_of(fit), predicted=predicted,
            disturbance=disturbance,
        )  # fmt: skip
        said = words.about_curves(info, fit, k, predicted)
        caption = " ".join(said) or f"{label}: space-gap and speed."
        yield Picture(f"fit_{k + 1}", figure, caption)


def training_pictures(snapshot: Result) -> Iterator[Picture]:
    """Loss and parameters over the iterations."""
    history = snapshot.fit.history
    if history is None:
        return
    yield Picture("loss", loss_history(history), "")
    for which, name in enumerate(PARAMETER_KEYS):
        yield Picture(name, parameter_history(history, which, snapshot.info), "")


def stability_pictures(snapshot: Result) -> Iterator[Picture]:
    """Bode magnitude, criteria along the platoon, and the map around the last vehicle."""
    report, uncertainty = snapshot.stability, snapshot.uncertainty
    if report is None:
        return
    vehicles = learned_parameters(snapshot.info, snapshot.fit)
    bode = stability_figures.bode(vehicles, report, uncertainty)
    words = (
        "Bode magnitude from the speed of the vehicle ahead to the vehicle's own. Diamonds: peaks."
        " Rings: below that frequency the vehicle amplifies."
        + (f" Shaded: {100 * uncertainty.level:.0f} % intervals." if uncertainty else "")
    )
    yield Picture("bode", with_legend(bode), words)
    if len(vehicles) > 1:
        words = (
            "Criteria (stable above 0) and gains (stable at 1) along the platoon; dotted: from the"
            " leader to that follower."
        )
        chart = stability_figures.criteria_by_vehicle(vehicles, report)
        yield Picture("criteria", with_legend(chart), words)
    held = len(vehicles) - 1
    chart = stability_figures.stability_map(vehicles, report, held, "beta", uncertainty)
    words = (
        f"Boundaries at the α of {vehicles.labels[held]}; above a line a vehicle is stable by that"
        " criterion. Hatched: L∞ stable by the paper's criterion, but not by the exact one."
        + (f" {stability_figures.cloud_caption(chart, uncertainty, 'beta')}" if uncertainty else "")
    )
    yield Picture("map", with_legend(chart), words)


def _places(snapshot: Result) -> Places:
    """What sentences call the platoon's vehicles: their labels, or places among equal ones."""
    vehicles = learned_parameters(snapshot.info, snapshot.fit)
    return Places(vehicles.spoken) if len(vehicles) > 1 else PLACES


def platoon_pictures(snapshot: Result) -> tuple[PlatoonRun, tuple[Picture, Picture], str] | None:
    """The followers in their order, or eight like the only one, at the frequency amplified most."""
    report, vehicles = snapshot.stability, learned_parameters(snapshot.info, snapshot.fit)
    if report is None:
        return None
    order = [*range(len(vehicles))] if len(vehicles) > 1 else [0] * FOLLOWERS
    omega = report.platoon.peaks[-1].omega or Sinusoid.frequency
    try:
        run = simulate_platoon(vehicles.parameters[order], Sinusoid(frequency=omega))
    except ParameterError:
        return None
    cast = platoon_figures.cast_of(vehicles, order)
    profiles = with_legend(platoon_figures.profiles(run, cast))
    amplitudes = platoon_figures.amplitude_by_vehicle(run, cast, in_db=False)
    pictures = (
        Picture("platoon", profiles, "Speeds and gaps; light to dark: first to last follower."),
        Picture("amplitude", amplitudes, "Amplitude of the speed along the platoon; line: by |H|."),
    )
    who = f"The {len(order)} followers in their order"
    if len(vehicles) == 1:
        who = f"{FOLLOWERS} vehicles like {vehicles.labels[0]}"
    return run, pictures, who


def _plain(part: Any) -> Any:
    """Arrays as lists, numbers rounded, what is not finite as null."""
    if isinstance(part, dict):
        return {key: _plain(item) for key, item in part.items()}
    if isinstance(part, np.ndarray) and part.dtype.kind == "f" and part.ndim == 1:
        return [_rounded(value) for value in part.tolist()]
    if isinstance(part, np.ndarray):
        return _plain(part.tolist())
    if isinstance(part, list | tuple):
        return [_plain(item) for item in part]
    if isinstance(part, float | np.floating):
        return _rounded(float(part))
    if isinstance(part, np.integer):
        return int(part)
    return part


def _rounded(value: float) -> float | None:
    return float(f"{value:.{DIGITS}g}") if isfinite(value) else None


def _roomy(axis: dict[str, Any]) -> dict[str, Any]:
    """An axis that keeps its title clear of its numbers."""
    titled = {"title": axis["title"] | {"standoff": 8}} if "title" in axis else {}
    return axis | {"automargin": True} | titled


def _coarse(trace: dict[str, Any], points: int) -> dict[str, Any]:
    """A line with fewer points, its peaks kept; anything else as it is."""
    x, y = (np.asarray(trace.get(axis)) for axis in "xy")
    numeric = x.dtype.kind in "fiu" and y.dtype.kind in "fiu"
    if trace.get("mode") == "markers" or trace.get("fill") or not numeric:
        return trace
    x, y = thinned(x.astype(float), y.astype(float), points)
    return {key: part for key, part in trace.items() if key != "customdata"} | {"x": x, "y": y}


def _all_drawn(pictures: Sequence[Picture]) -> list[dict[str, Any]]:
    """What the page's script draws, in order; the more lines, the fewer points each."""
    lines = sum(len(picture.figure.data) for picture in pictures)
    points = max(FEWEST_POINTS, min(POINTS, ALL_POINTS // max(lines, 1)))
    return [picture.drawn(points) for picture in pictures]
