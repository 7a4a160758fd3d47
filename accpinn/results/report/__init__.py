"""The report: a snapshot as one web page that needs no network, for people without accpinn.

The story's parts are put into a template, with every script and style inside. Its figures are those
of the app's pages, with legends and with numbers in single precision. `bundle` makes one zip file
of the report, the snapshot, all tables, and the curves as numbers.
"""

import base64
import hashlib
import io
import json
import re
import zipfile
from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import chain
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import plotly.graph_objects as go
from markupsafe import Markup
from plotly.io import to_json
from plotly.offline import get_plotlyjs

from accpinn import __version__
from accpinn.channels import GAP, SPEED, TIME
from accpinn.errors import ParameterError
from accpinn.methods.estimate import History
from accpinn.model.cthp import Trajectories
from accpinn.model.registry import value_of
from accpinn.platoon import PlatoonRun, simulate_platoon
from accpinn.platoon.leader import Sinusoid
from accpinn.results.cast import Cast
from accpinn.results.figures import control
from accpinn.results.figures import platoon as platoon_figures
from accpinn.results.figures import stability as stability_figures
from accpinn.results.figures.laboratory import steady_waves
from accpinn.results.figures.recording import motion
from accpinn.results.figures.strip import STYLE as STRIP_STYLE
from accpinn.results.figures.strip import strip_html
from accpinn.results.figures.style import (
    Figure,
    axes_of,
    parts_of,
    thinned,
    vehicle_colours,
    with_legend,
)
from accpinn.results.figures.training import course, curves_of, drive, driven
from accpinn.results.marks import LEGEND
from accpinn.results.messages import estimate as on_estimate
from accpinn.results.messages import incidents, messages
from accpinn.results.messages import platoon as on_platoon
from accpinn.results.messages import stability as on_stability
from accpinn.results.messages import summary as words
from accpinn.results.reproduction import verification_table
from accpinn.results.strip import strip_of
from accpinn.results.tables import STYLE, Column, Table, template
from accpinn.results.tables import estimates as tables
from accpinn.results.tables.stability import assessment_table, criteria_part
from accpinn.segment import SegmentInfo
from accpinn.stability import Criterion
from accpinn.study.description import describe
from accpinn.study.result import Result
from accpinn.study.snapshot import SUFFIX, to_bytes
from accpinn.study.vehicles import assessed_vehicles
from accpinn.study.verification import PROMPT, Verification, verify
from accpinn.units import FloatArray

HERE = Path(__file__).parent
WIDE = 9
"""Number of columns beyond which a table is set smaller."""
FOLLOWERS = 8
"""Followers of the simulated platoon where only one is known."""
POINTS = 800
"""Largest number of points a line, so that the page stays below 6 MB, of which plotly takes 5."""
FIRST_PAGE, A_ROW = 345, 15
"""Height in pixels of a figure on the printed first page, and how much less for a row of the strip
there."""
WAVES = 320
"""Height in pixels of the platoon's speeds on the screen."""
EXPLAINED = (Criterion.LINF_PAPER, Criterion.LINF_EXACT, Criterion.L2_WEAK, Criterion.LINF_WEAK)
"""Verdicts whose reasons are given; the table has all that is to be said about the others."""
MEASURED = "Points with bars: the measured gain; faint where it is not compared."
UNCHANGING = (2020, 1, 1, 0, 0, 0)
"""Date of every file in a bundle, so that equal results make equal bundles."""


@dataclass(frozen=True, eq=False)
class Picture:
    """A figure with a name for its file and a caption."""

    name: str
    figure: go.Figure
    caption: str
    printed: int = 0
    """Its height in pixels on paper; 0 for that of its kind."""

    def drawn(self) -> dict[str, Any]:
        """Name, data and layout for the page's script; numbers in single precision."""
        parts = parts_of(self.figure)
        for trace in parts["data"]:
            x, y = np.asarray(trace["x"]), np.asarray(trace["y"])
            if x.dtype.kind in "fiu" and y.dtype.kind in "fiu":
                if trace.get("mode") != "markers" and not trace.get("fill"):
                    x, y = thinned(x.astype(float), y.astype(float), POINTS)
                    trace.pop("customdata", None)  # one value a point; only pages ask for it
                trace |= {"x": x.astype(np.float32), "y": y.astype(np.float32)}
        for axis in axes_of(parts):  # titles keep clear of the numbers
            axis["automargin"], axis["title"] = True, axis.get("title", {}) | {"standoff": 8}
        parts["layout"]["template"] = None
        drawn = json.loads(to_json(Figure(parts).to_dict(), validate=False))
        return {"name": self.name, "printed": self.printed, **drawn}


def render_report(
    snapshot: Result, verification: Verification | None = None, *, with_curves: bool = True
) -> str:
    """The whole page on a snapshot.

    By default it is verified now, and its methods run again where that is soon done. Without curves
    the page has neither measured nor fitted series, for recordings that must not be shared.

    Examples:
        >>> import accpinn
        >>> result = accpinn.fit(accpinn.sample("motorway"), vehicles="1-2", method="splines")
        >>> accpinn.render_report(result, with_curves=False)[:15]
        '<!DOCTYPE html>'
    """
    verification = verification or verify(snapshot, refit_within=PROMPT)
    script = (HERE / "page.js").read_text(encoding="utf-8")
    story = _story(snapshot, verification, with_curves)
    drawings = [picture.drawn() for picture in story["shown"]]
    document = json.dumps(drawings, ensure_ascii=False, separators=(",", ":"))
    return template("report/page.html").render(
        story,
        style=Markup((HERE / "page.css").read_text(encoding="utf-8")),
        table_style=Markup(re.sub(r"</?style>", "", STYLE + STRIP_STYLE)),
        plotly=Markup(get_plotlyjs()),
        script=Markup(script),
        # Inside a script element only "<" could end it early.
        drawings=Markup(document.replace("<", "\\u003c")),
        policy=_policy(get_plotlyjs(), script),
        version=__version__,
    )


def tables_of(snapshot: Result) -> dict[str, Table]:
    """Every table of a report by its name, with the vehicles' colours."""
    info, description = snapshot.info, describe(snapshot)
    forms = snapshot.adequacy.forms if snapshot.compared else ()
    paints, every = vehicle_colours(info.vehicles), tables.tables_of(description)
    rows = vehicle_colours(info.vehicles, [follower.number for follower in description.followers])
    for name, colours in (("parameters", rows), ("errors", paints)):
        every[name] = every[name].coloured(colours)
    if description.vehicles.has_report:
        every["stability"] = assessment_table(description.vehicles).coloured(paints[1:])
    recommended = words.recommended_of((snapshot, *snapshot.compared))
    for k in range(info.followers if snapshot.compared else 0):
        every[f"methods_{k + 1}"] = tables.methods_table(snapshot.compared, k, recommended)
    for k in range(info.followers if forms else 0):
        every[f"forms_{k + 1}"] = tables.model_form_table(info, forms, k)
    for judged in snapshot.judgements:
        every[f"models_{judged.info.vehicles[1]}"] = tables.judged_table(judged, judged.speeds[1])
    return every


def _story(snapshot: Result, checked: Verification, with_curves: bool) -> dict[str, Any]:
    """What the template tells: with the modules of sentences and tables, which it asks itself."""
    subject, motion = assessed_vehicles(snapshot), [motion_picture(snapshot)] * with_curves
    description = describe(snapshot)
    strip = strip_of(description.vehicles, description)
    sheets = {name: _sheet(table, name) for name, table in tables_of(snapshot).items()}
    curves = [*curve_pictures(snapshot)] if with_curves else []
    responses, training = [*stability_pictures(snapshot)], [*training_pictures(snapshot)]
    run, cast, platoon, repeated = platoon_pictures(snapshot) or (None, None, (), "")
    height = FIRST_PAGE - A_ROW * len(strip.rows)  # so that the first page ends with them
    first_page = [replace(picture, printed=height) for picture in
                  (*responses[:1], *_waves(cast, run, repeated))]  # fmt: skip
    parts = (first_page, motion, curves, training, responses[1:], platoon)
    names = ("first_page", "motion", "curves", "training", "stability_pictures", "platoon")
    return {
        **dict(zip(names, parts, strict=True)),
        "shown": list(chain.from_iterable(parts)),
        "snapshot": snapshot,
        "description": description,
        "strip": Markup(strip_html(strip)),
        "strip_about": " · ".join(filter(None, (*strip.about, strip.lacking))),
        "adequacy": snapshot.adequacy if snapshot.compared else None,
        "legend": LEGEND,
        "words": words,
        "on_estimate": on_estimate,
        "on_platoon": on_platoon,
        "on_stability": on_stability,
        "tables": tables,
        "incidents": incidents,
        "messages": messages,
        "sheets": sheets,
        "reasons": [
            (label, [why for verdict, why in verdicts if verdict.criterion in EXPLAINED])
            for label, verdicts in (on_stability.reasons(subject) if subject.has_report else ())
        ],
        "explanation": on_stability.explained(subject) if subject.has_report else "",
        "has_measured": stability_figures.measured_of(subject) if subject.has_report else False,
        "run": run,
        "cast": cast,
        "repeated": repeated,
        "checked": checked,
        "checks": Markup(verification_table(checked).to_html()),
    }


def _waves(cast: Cast | None, run: PlatoonRun | None, who: str) -> Iterator[Picture]:
    """The speeds of the platoon behind the simulated leader, once its transient is over."""
    if cast is None or run is None or not isinstance(run.leader, Sinusoid):
        return
    omega = run.leader.frequency
    shades = "Light to dark: first to last." if len(cast.vehicles) == 1 else "Colours as above."
    caption = (
        f"{who}, behind a leader (thick) whose speed oscillates at {omega:.3g} rad/s. {shades}"
    )
    yield Picture("waves", steady_waves(cast, omega, WAVES), caption)


def _sheet(table: Table, name: str) -> dict[str, Any]:
    """A table on the page, and as files: label, file name and data address of each."""
    files = (
        ("CSV", f"{name}.csv", "text/csv", table.to_csv()),
        ("LaTeX", f"{name}.tex", "application/x-tex", table.to_latex()),
    )
    return {
        # The first page has α, β and τ; they would not leave the verdicts room.
        "html": Markup((criteria_part(table) if name == "stability" else table).to_html()),
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


def motion_picture(snapshot: Result) -> Picture:
    """Measured gaps and speeds of the first window."""
    figure = with_legend(motion(snapshot.info, snapshot.segments[0].measured))
    return Picture("motion", figure, "Measured space-gaps and speeds.")


def curve_pictures(snapshot: Result) -> Iterator[Picture]:
    """Per follower: the data of the first window, the method's curves, and the simulation."""
    description = describe(snapshot)
    for k, label in enumerate(snapshot.info.labels[1:]):
        curves = curves_of(snapshot, k)
        about = on_estimate.about_curves(description, k, snapshot.gap_band)
        caption = " ".join((f"{label}.", curves.about, *about))
        yield Picture(f"curves_{k + 1}", drive(curves), caption)


def training_pictures(snapshot: Result) -> Iterator[Picture]:
    """What is optimised, and parameters, over the iterations."""
    history, model = snapshot.history, snapshot.estimate.model
    if history is None:
        return
    yield Picture("course", course(history, snapshot.info, model), "")


def stability_pictures(snapshot: Result) -> Iterator[Picture]:
    """Bode magnitude, criteria along the platoon, and the map around the last vehicle."""
    subject = assessed_vehicles(snapshot)
    uncertainty, vehicles = subject.uncertainty, subject.vehicles
    if not subject.has_report:
        return
    bode = with_legend(stability_figures.bode(subject))
    sentences = ["Bode magnitude from the speed ahead to the vehicle's own."]
    sentences += ["Dashed: from the leader to the last."] if len(vehicles) > 1 else []
    sentences.append(on_stability.about_bode(uncertainty))
    if stability_figures.measured_platoon(subject).size:
        sentences.append("Solid grey: from the leader to the last, measured.")
    sentences += [MEASURED] if stability_figures.measured_of(subject) else []
    yield Picture("bode", bode, " ".join(sentences))
    if len(vehicles) > 1:
        chart = stability_figures.criteria_by_vehicle(subject)
        yield Picture("criteria", with_legend(chart), on_stability.CRITERIA)
    held = len(vehicles) - 1
    chart = stability_figures.stability_map(subject, held, "beta")
    about = on_stability.about_map(vehicles, held)
    if uncertainty:
        about += f" {stability_figures.cloud_caption(chart, uncertainty, 'beta')}"
    yield Picture("map", with_legend(chart), about)
    if waves := subject.waves:
        sentences = [
            on_stability.waves_in_words(waves),
            "Solid: lower half (braking); dashed: upper half (accelerating).",
        ]
        chart = with_legend(control.growth_by_frequency(subject, waves))
        yield Picture("wave_growth", chart, " ".join([*sentences, on_stability.WAVES]))


def platoon_pictures(
    snapshot: Result,
) -> tuple[PlatoonRun, Cast, tuple[Picture, Picture], str] | None:
    """The followers in their order, or eight like the only one, at the frequency amplified most."""
    subject = assessed_vehicles(snapshot)
    vehicles = subject.vehicles
    if not subject.has_report:
        return None
    order = [*range(len(vehicles))] if len(vehicles) > 1 else [0] * FOLLOWERS
    speed = Sinusoid.speed
    try:
        if not vehicles.parameters.is_linear:
            speed = float(f"{subject.median_speed:.3g}")
            subject = replace(subject, uncertainty=None).at_speed(speed)
        leader = Sinusoid(subject.report.platoon.peaks[-1].omega or Sinusoid.frequency, speed=speed)
        run = simulate_platoon(vehicles.parameters[order], leader, model=vehicles.model)
    except ParameterError:
        return None
    cast = Cast(vehicles, tuple(order))
    profiles = with_legend(platoon_figures.profiles(run, cast, linear=run.linear))
    shades = " Light to dark: first to last follower." if len(vehicles) == 1 else ""
    dashed = " Dashed: by the linearisation." if run.linear else ""
    growth = platoon_figures.growth_by_vehicle(run, cast)
    who = f"The {len(order)} followers in their order"
    if len(vehicles) == 1:
        who = f"{FOLLOWERS} vehicles like {vehicles.labels[0]}"
    pictures = (
        Picture("platoon", profiles, f"Speeds and gaps.{shades}{dashed}"),
        Picture("amplitude", growth, "Amplitude of the speed along the platoon; ticks: by |H|."),
    )
    return run, cast, pictures, who


def bundle(snapshot: Result, verification: Verification | None = None) -> bytes:
    """All that is known of a result as one zip file.

    It holds report.html, the snapshot, each table as CSV and LaTeX, and as CSV the training's
    history and the motion in each window: measured, by the method's curves, and simulated behind
    the measured vehicle ahead. The report is verified as by `render_report`.
    """
    content = io.BytesIO()
    with zipfile.ZipFile(content, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, data in _files(snapshot, verification):
            archive.writestr(zipfile.ZipInfo(name, UNCHANGING), data, zipfile.ZIP_DEFLATED)
    return content.getvalue()


def _files(
    snapshot: Result, verification: Verification | None
) -> Iterator[tuple[str, str | bytes]]:
    yield "report.html", render_report(snapshot, verification)
    yield f"result{SUFFIX}", to_bytes(snapshot)
    for name, table in tables_of(snapshot).items():
        yield f"tables/{name}.csv", table.to_csv()
        yield f"tables/{name}.tex", table.to_latex()
    estimate, info = snapshot.estimate, snapshot.info
    if estimate.history:
        yield "training.csv", _history(estimate.history, info, estimate.model)
    for k, segment in enumerate(snapshot.segments):
        place = f"_{k + 1}" if len(snapshot.segments) > 1 else ""
        yield f"motion_measured{place}.csv", _motion(segment.info, segment.measured)
        if estimate.curves:
            curves = _motion(segment.info, estimate.curves[k])
            yield f"motion_{estimate.method}{place}.csv", curves
        if simulation := _simulation(snapshot, k):
            yield f"motion_simulation{place}.csv", _motion(segment.info, simulation)


def _simulation(snapshot: Result, window: int) -> Trajectories | None:
    """Each follower by the estimate behind the measured vehicle ahead; None where none can be."""
    segment = snapshot.segments[window]
    single = [driven(snapshot, k, window) for k in range(segment.followers)]
    known = [motion for motion in single if motion]
    if len(known) < len(single):
        return None
    speeds = np.column_stack([segment.speeds[:, 0], *(motion.speeds[:, 1] for motion in known)])
    return Trajectories(segment.time, speeds, np.hstack([motion.gaps for motion in known]))


def _motion(info: SegmentInfo, source: Trajectories) -> str:
    """Time, and speed and space-gap of each vehicle; empty where a sample is missing."""
    columns = {Column("time", TIME.unit).csv_name: info.window.start + source.time}
    for k, number in enumerate(info.vehicles):
        columns[Column(f"speed {number}", SPEED.unit).csv_name] = source.speeds[:, k]
        if k:
            columns[Column(f"gap {number}", GAP.unit).csv_name] = source.gaps[:, k - 1]
    return _csv(columns)


def _history(history: History, info: SegmentInfo, model: str) -> str:
    """Iteration, seconds, terms of the loss, and the model's parameters of each follower."""
    names = ("iteration", "seconds", "total", "data", "physics", "initial", "log_likelihood")
    every = ((name, getattr(history, name)) for name in names)
    columns: dict[str, FloatArray] = {name: values for name, values in every if values is not None}
    sets = history.parameters.values.shape[1]
    followers = ("all",) if sets == 1 and info.followers > 1 else info.vehicles[1:]
    for k, follower in enumerate(followers):
        for key, column in tables.gains_and_own_columns(model).items():
            name = Column(f"{key} {follower}", column.unit).csv_name
            columns[name] = value_of(model, history.parameters, key)[:, k]
    return _csv(columns)


def _csv(columns: dict[str, FloatArray]) -> str:
    return pd.DataFrame(columns).to_csv(index=False, float_format="%.9g", lineterminator="\n")
