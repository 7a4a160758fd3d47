"""Every figure: finite numbers on axes with titles and units, few points, and no HTML of a name."""

import base64
import importlib
import inspect
import json
import pkgutil
import re
from collections.abc import Callable
from dataclasses import replace
from functools import cache
from types import SimpleNamespace
from typing import Any, get_type_hints

import numpy as np
import plotly.graph_objects as go
import pytest
from plotly.io import to_json
from plotly.utils import PlotlyJSONEncoder

import accpinn
from accpinn.evaluation.residuals import residual_correlations
from accpinn.methods import recursive
from accpinn.model.published import ASTAZERO
from accpinn.model.registry import FOLLOWING
from accpinn.platoon import simulate_platoon
from accpinn.platoon.leader import Sinusoid, SpeedStep
from accpinn.recordings import Window
from accpinn.results import figures
from accpinn.results.cast import Cast
from accpinn.results.figures import comparison, control, database, laboratory, next_drive, platoon
from accpinn.results.figures import recording as on_recording
from accpinn.results.figures import stability as on_stability
from accpinn.results.figures import training as on_training
from accpinn.results.figures.style import on_paper
from accpinn.segment.quality import label_regimes
from accpinn.stability.measured_gain import measured_gain
from accpinn.stability.waves import Waves, waves
from accpinn.study.groups import group
from accpinn.study.result import Result
from accpinn.study.vehicles import AssessedVehicles, assessed_vehicles
from tests.results.figures.test_training import history
from tests.support.openacc_files import recording
from tests.support.samples import PLATOON, sample
from tests.support.snapshots import recommended, result_for
from tests.support.studies import row, rows

NAME = "<i>A</i>"
"""Of every vehicle: plotly reads a little HTML."""
COLOUR = "#0c7eae"
SEGMENT = replace(sample(PLATOON, 60.0).segment, names=(NAME,) * 5)
RUN, MADE = recording(names=(NAME,) * 3), (Window(5.0, 25.0), Window(20.0, 35.0))
WITHOUT_UNIT = {
    "Iteration",
    "Loss",
    "Largest growth",
    "Minus its last value",
    "Gain",
    "Growth",
    "Coherence",
    "Correlation",
    "Step response of the speed",
    "ατ², gain on spacing in units of τ",
    "βτ, gain on relative speed in units of τ",
}
WITHOUT_TITLE = ("comparison.residual",)
"""Correlations of what the other axes name."""


@cache
def point() -> Result:
    """An estimate of a platoon without a posterior."""
    return result_for(SEGMENT, "splines")


@cache
def known() -> Result:
    """One of two followers with a posterior."""
    result = recommended()
    segment = replace(result.segments[0], names=(NAME,) * 3)
    return replace(result, segments=(segment,), infos=(segment.info,))


@cache
def simulated(collides: bool) -> Any:
    """A run of eight Audis and its cast."""
    named = replace(ASTAZERO, names=(NAME,) * 4, labels=(NAME,) * 4)
    leader = Sinusoid(0.214) if collides else SpeedStep()
    return simulate_platoon(ASTAZERO.parameters[[0] * 8], leader), Cast(named, (0,) * 8)


def proposed() -> Any:
    return accpinn.next_drive(known(), duration=40.0)


def judged() -> Any:
    errors = {"rmse": np.array([1.0, 2.0]), "typical_rmse": 1.4}
    score = SimpleNamespace(model=FOLLOWING["idm"], key="idm", theta=None, **errors)
    info = SimpleNamespace(labels=(NAME, NAME))
    return SimpleNamespace(scores=[score], ranked=[score], windows=MADE, info=info)


def grouped() -> Any:
    return group(rows(row(NAME), row("B"), row("C", tau=None)), ("make",))


@cache
def waved() -> tuple[AssessedVehicles, Waves]:
    """Two vehicles and the growth of waves by two IDMs."""
    subject, speeds = assessed_vehicles(known()), np.full(2, 20.0)
    theta = np.tile(IDM.typical, (2, 1))
    return subject, waves(IDM, theta, speeds, subject.vehicles.labels, (2, 3))


PLACE = {"file": "f.csv", "start": 0.0, "duration": 9.0, "mean_speed": 20.0, "l2_stable": True}
IDM = FOLLOWING["idm"]
FIGURES: dict[str, Callable[[], go.Figure]] = {
    "comparison.joint": lambda: comparison.joint(known().estimate, 0, COLOUR),
    "comparison.estimates": lambda: comparison.estimates(
        [comparison.Row(NAME, "cthp", point().parameters.values[0])],
        COLOUR,
        comparison.row_of(known(), 0),
    ),
    "comparison.tracks": lambda: comparison.tracks([(NAME, recursive.fit((SEGMENT,)).track)], 0),
    "comparison.residual": lambda: comparison.residual(
        residual_correlations(SEGMENT, point().estimate, 0), COLOUR
    ),
    "database.forest": lambda: database.forest(grouped()),
    "database.plane": lambda: database.plane(rows(row(NAME, **PLACE))),
    "database.gap_against_speed": lambda: database.gap_against_speed(
        rows(row(NAME, **PLACE)), [NAME]
    ),
    "comparison.errors_by_car": lambda: comparison.errors_by_car([judged()]),
    "comparison.errors_by_window": lambda: comparison.errors_by_window(judged()),
    "comparison.peak_over_speed": lambda: comparison.peak_over_speed(
        [comparison.Follower(NAME, COLOUR, IDM, IDM.typical)], (15.0, 25.0), 20.0
    ),
    "control.pole_map": lambda: control.pole_map(assessed_vehicles(known())),
    "control.step_responses": lambda: control.step_responses(assessed_vehicles(known())),
    "control.impulse_response": lambda: control.impulse_response(assessed_vehicles(known()), 0),
    "control.growth_by_frequency": lambda: control.growth_by_frequency(*waved()),
    "control.growth_by_size": lambda: control.growth_by_size(*waved()),
    "control.margin_forest": lambda: control.margin_forest(assessed_vehicles(known())),
    "laboratory.response_curves": lambda: laboratory.response_curves(
        assessed_vehicles(known()), "magnitude", 370
    ),
    "laboratory.bode_phase": lambda: laboratory.bode_phase(assessed_vehicles(known()), 370),
    "laboratory.steady_waves": lambda: laboratory.steady_waves(simulated(True)[1], 0.3, 370),
    "next_drive.drive_speed": lambda: next_drive.drive_speed(proposed()),
    "next_drive.drive_narrowing": lambda: next_drive.drive_narrowing(proposed()),
    "platoon.profiles": lambda: platoon.profiles(*simulated(True), measured=SEGMENT),
    "platoon.time_space": lambda: platoon.time_space(*simulated(True)),
    "platoon.growth_by_vehicle": lambda: platoon.growth_by_vehicle(*simulated(True)),
    "platoon.speed_map": lambda: platoon.speed_map(*simulated(False)),
    "recording.overview": lambda: on_recording.overview(
        RUN, (1, 2), MADE[0], [on_recording.regime_ribbons(SEGMENT, label_regimes(SEGMENT))]
    ),
    "recording.motion": lambda: on_recording.motion(SEGMENT.info, SEGMENT.measured),
    "recording.beginning": lambda: on_recording.beginning(RUN),
    "recording.speeds_thumbnail": lambda: on_recording.speeds_thumbnail(SEGMENT),
    "platoon.panels_thumbnail": lambda: platoon.panels_thumbnail(ASTAZERO.parameters),
    "stability.bode": lambda: on_stability.bode(assessed_vehicles(known())),
    "stability.criteria_by_vehicle": lambda: on_stability.criteria_by_vehicle(
        assessed_vehicles(known())
    ),
    "stability.stability_map": lambda: on_stability.stability_map(
        assessed_vehicles(known()), 0, "beta"
    ),
    "stability.gains_thumbnail": lambda: on_stability.gains_thumbnail(
        assessed_vehicles(known()).vehicles
    ),
    "stability.paper_bode": lambda: on_stability.paper_bode(
        replace(ASTAZERO, labels=(NAME,) * 4), ASTAZERO.parameters
    ),
    "stability.measured_bode": lambda: on_stability.measured_bode(
        measured_gain(sample(PLATOON).segment, 0), NAME, COLOUR
    ),
    "training.course": lambda: on_training.course(history(), RUN_INFO, moment=3),
    "training.drive": lambda: on_training.drive(
        on_training.curves_in(SEGMENT, 1, point().curves[0], None, NAME)
    ),
    "training.forest": lambda: on_training.forest(known(), 0),
    "training.tracking": lambda: on_training.tracking(SEGMENT, 1, point().curves[0], None, NAME),
    "training.tracking_at": lambda: on_training.tracking_at(known(), 1, 0, 2),
    "training.tracking_of": lambda: on_training.tracking_of(known(), 1),
}  # fmt: skip
RUN_INFO = replace(SEGMENT.info, names=(NAME,) * 3, vehicles=(1, 2, 3))


def test_every_figure_is_here() -> None:
    made = set()
    for found in pkgutil.iter_modules(figures.__path__):
        module = importlib.import_module(f"{figures.__name__}.{found.name}")
        for name, function in inspect.getmembers(module, inspect.isfunction):
            own = function.__module__ == module.__name__ and found.name != "style"
            if own and get_type_hints(function).get("return") is go.Figure:
                made.add(f"{found.name}.{name}")
    assert made == FIGURES.keys()


@pytest.mark.parametrize("name", FIGURES)
def test_a_figure_is_sent_as_plotly_sends_it(name: str) -> None:
    at_once, made = FIGURES[name](), FIGURES[name]()
    assert made.data, "plotly's objects"
    assert sent(at_once) == sent(made)
    ink = on_paper(FIGURES[name](), "#ffffff", "#123456")
    assert {axis.tickfont.color for axis in ink.select_xaxes()} == {"#123456"}
    assert (ink.layout.font.color, ink.layout.paper_bgcolor) == ("#123456", "#ffffff")
    go.Figure(ink)  # plotly checks it


def sent(figure: go.Figure) -> Any:
    """What a browser gets, as plain numbers, without what says nothing."""

    def plain(part: Any) -> Any:
        if isinstance(part, list):
            return [plain(value) for value in part]
        if not isinstance(part, dict):
            return part
        if "bdata" not in part:
            return {name: plain(value) for name, value in part.items() if value not in (None, {})}
        values = np.frombuffer(base64.b64decode(part["bdata"]), part["dtype"])
        shape = map(int, part.get("shape", str(len(values))).split(","))
        return json.loads(json.dumps(values.reshape(*shape), cls=PlotlyJSONEncoder))

    return plain(json.loads(to_json(figure.to_dict(), validate=False)))


@pytest.mark.parametrize("name", FIGURES)
def test_numbers_are_finite_axes_titled_points_few_and_names_literal(name: str) -> None:
    figure = go.Figure(FIGURES[name]())  # a copy, which plotly checks
    assert NAME not in figure.to_json()
    assert len(figure.to_json()) < 600_000
    drawn = 0
    for trace in figure.data:
        values = np.asarray(trace.z if trace.type == "heatmap" else trace.y)
        if trace.type != "heatmap":
            assert len(trace.x) == len(values)
        if values.dtype.kind == "f":
            assert not np.isinf(values).any()
        drawn += values.size
    assert 0 < drawn < 60_000
    for axis in (*figure.select_xaxes(), *figure.select_yaxes()):
        is_shown = axis.visible is not False and axis.showticklabels is not False
        has_names = axis.type == "category" or axis.categoryarray or axis.tickvals is not None
        title = axis.title.text or ""
        if is_shown and not has_names and (title or name not in WITHOUT_TITLE):
            assert re.search(r"\[.+\]", title) or title in WITHOUT_UNIT, axis
