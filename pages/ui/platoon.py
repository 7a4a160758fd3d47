"""The page Platoon: controls in a row, curves, time-space diagram and growth, strip, and tabs."""

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from itertools import cycle
from typing import Literal

import streamlit as st
from numpy import intp
from numpy.typing import NDArray
from streamlit.delta_generator import DeltaGenerator

from accpinn.channels import SPEED
from accpinn.errors import ParameterError
from accpinn.model.cthp import Trajectories
from accpinn.model.published import ParameterSet
from accpinn.platoon import Collision, PlatoonRun, simulate_platoon
from accpinn.platoon.leader import Brake, Leader, Recorded, Sinusoid, SpeedStep
from accpinn.results.cast import Cast
from accpinn.results.figures import platoon as figures
from accpinn.results.figures.animation import motion, watched
from accpinn.results.messages import messages
from accpinn.results.messages import platoon as words
from accpinn.results.messages.estimate import contradictions
from accpinn.results.messages.stability import SEVERAL, not_acc, probabilities
from accpinn.results.strip import strip_of
from accpinn.results.tables.stability import amplitude_table
from accpinn.segment import Segment
from accpinn.segment.cut import parse_vehicles
from accpinn.stability.head_to_tail import head_to_tail_peaks
from accpinn.study.vehicles import AssessedVehicles
from pages.ui.components import browser, frame, show
from pages.ui.components.parameter_picker import EXAMPLE, SHOWN, choose_parameters
from pages.ui.components.show import KMH, bound, escape_markdown, kept, pick, segments, select, tabs
from pages.ui.components.strip import show_strip
from pages.ui.session.workspace import Workspace

LEAD = "A disturbance of the leader, in a platoon of these vehicles."
HEIGHT = 310
"""Height of the charts, in pixels."""
VIEWS: dict[figures.View, str] = {
    "observer": "Moving observer",
    "leader": "From the leader",
    "road": "From the road",
}
WIDTHS = (1.25, 1.1, 0.75)
"""Widths of the three charts."""
SHOWN_WHOLE = 0.99
"""A part of a run longer than this share of it is the run."""
FOLLOWERS, MOST_FOLLOWERS = 8, 20
"""Followers of a repeated vehicle by default, as in the paper, and at most."""
ORDERS = {"learned": "In order", "repeated": "One car", "own": "Own order"}
Disturbance = Literal["sinusoid", "step", "brake", "recorded"]
PLANNED: dict[Disturbance, type[Sinusoid] | type[SpeedStep] | type[Brake]] = {
    "sinusoid": Sinusoid,
    "step": SpeedStep,
    "brake": Brake,
}
LABELS = {
    "frequency": (
        "Frequency [rad/s]",
        0.01,
        "Of the leader's speed; 2π over it is the period. To begin with, the peak of this platoon.",
    ),
    "amplitude": ("Amplitude [m/s]", 0.1, "Of the leader's speed about its mean."),
    "change": ("Change of speed [m/s]", 0.5, "At once; below zero the leader slows down."),
    "drop": ("Drop of speed [m/s]", 1.0, "By how much the leader slows down."),
    "deceleration": ("Deceleration [m/s²]", 0.5, "Of the leader while it brakes."),
    "hold": ("Held for [s]", 1.0, "How long the leader keeps the lower speed."),
    "acceleration": ("Acceleration [m/s²]", 0.5, "Of the leader back to its speed."),
    "speed": ("Speed before [m/s]", 1.0, "Of all vehicles, in equilibrium."),
    "settle": ("Starts at [s]", 5.0, "When the disturbance begins."),
    "duration": ("Duration [s]", 50.0, "Of the whole run."),
}
"""Label, step and explanation of each setting."""
FIRST = {"sinusoid": "frequency", "step": "change", "brake": "drop"}
"""The setting of each disturbance that stands in the row; the others are one click away."""


def show_page(workspace: Workspace) -> None:
    source = choose_parameters(workspace, "platoon", LEAD)
    if source is None:
        return
    chosen = source.vehicles
    windows, warned = _windows(workspace, source), st.container()
    row = st.container(horizontal=True, vertical_alignment="bottom", key="platoon_controls")
    numbers = st.empty()
    with row:
        order = _choose_order(workspace, chosen, windows, numbers)
        leader, recorded = _choose_leader(workspace, source, order, windows)
    run = simulate_platoon(chosen.parameters[order], leader, model=chosen.model)
    cast = Cast(chosen, tuple(order))
    if source.result:
        with warned:
            show.not_acc(source.result.info, [chosen.vehicles[k + 1] for k in cast.order])
    themselves = recorded if recorded and _are_recorded(source, cast, recorded) else None
    with row:
        view = _choose_view(workspace, run, recorded)
    _show_run(run, cast, source)
    _show_charts(run, cast, view, themselves)
    _show_strip(workspace, source, run, cast, recorded)
    tabs(workspace, "platoon", {
        "Animation": lambda: _show_animation(run, cast),
        "Numbers": lambda: _show_numbers(run, cast, themselves),
        "Map of speeds": lambda: _show_map(run, cast),
    })  # fmt: skip


def _are_recorded(source: AssessedVehicles, cast: Cast, recorded: Segment) -> bool:
    """Whether a platoon is the recorded one: in Case I all followers have one parameter set."""
    if source.result and source.result.estimate.case == "I":
        return len(cast.labels) == len(recorded.labels)
    return cast.labels[1:] == recorded.labels[1:]


def open_eight(workspace: Workspace, vehicles: ParameterSet, which: int, omega: float) -> None:
    """Let the page show eight times one published vehicle behind a sinusoid."""
    workspace.choose_source("published")
    workspace.choices.pop("platoon_sinusoid_speed", None)
    workspace.choices.update({
        EXAMPLE: vehicles.title, SHOWN: vehicles,
        "platoon_order": "repeated", "platoon_vehicle": which,
        "platoon_followers": FOLLOWERS, "platoon_kind": "sinusoid",
        "platoon_sinusoid_frequency": omega,
    })  # fmt: skip


def _show_run(run: PlatoonRun, cast: Cast, source: AssessedVehicles) -> None:
    """The disturbance's growth in a sentence, and further findings."""
    parts = (
        words.disturbance(run, cast, words.growth_of(source, cast, run)),
        words.measured_growth(source, cast, run),
    )
    sentence = " ".join(filter(None, parts)).replace(" %", "\N{NO-BREAK SPACE}%")
    st.markdown(f"**{escape_markdown(sentence)}**")
    # The line above names the collisions already.
    others = [finding for finding in run.findings if not isinstance(finding, Collision)]
    show.messages(messages(others, cast), "warning")


def _show_strip(
    workspace: Workspace, source: AssessedVehicles, run: PlatoonRun, cast: Cast,
    recorded: Segment | None,
) -> None:  # fmt: skip
    """The strip of the vehicles that drive."""

    def show_next() -> None:
        if source.result and source.result is workspace.result:
            label = "Next: which model describes these cars?"
            frame.ask_which_model(workspace, label, "platoon_next")

    driving = strip_of(source).of_places({*cast.order})
    show_strip(driving, lambda: _show_details(source, run, cast, recorded), show_next)


def _show_details(
    source: AssessedVehicles, run: PlatoonRun, cast: Cast, recorded: Segment | None
) -> None:
    """The simulation in sentences: who drives, by which parameters, and how far that is known."""
    chosen, driving = source.vehicles, sorted({*cast.order})
    st.markdown(f"##### {escape_markdown(source.origin)}")
    sentences = not_acc(chosen, driving), words.smallest_gap(run, cast), words.by_linearisation(run)
    details = " ".join(filter(None, sentences))
    if recorded:
        leader = f"{recorded.labels[0]} as recorded, {recorded.source}, {recorded.window}"
        details = (
            f"The leader: {leader}; the platoon begins in equilibrium, and deviations are from"
            " the speed then. The drive mixes many frequencies; for growth at one of them, see"
            " page Stability."
            f" {details}"
        )
    at_speed, speed = source, run.leader.speed
    if run.linear and round(KMH * speed) != round(KMH * source.median_speed):
        at_speed = source.at_speed(speed)
    if at_speed.uncertainty:
        odds = probabilities(chosen, at_speed.uncertainty, driving)
        by = SEVERAL if source.cars else "Simulated with the estimated parameters."
        details += f" {by} {odds}"
    elif not source.result:
        details += f" {words.GIVEN_SIMULATION}"
    st.caption(escape_markdown(details.replace(" %", "\N{NO-BREAK SPACE}%")))
    show.cautions(contradictions(source.result, cast.order))


@dataclass(frozen=True)
class View:
    """The part and the lines of a run in the charts."""

    seen_from: figures.View
    is_whole: bool
    """Whether all of it, not the part worth a closer look."""
    linear: Trajectories | None
    """Those of the linearisation; None where they are not shown, or the model is linear."""
    measured: Segment | None
    """The window of the recorded followers; None where they are not shown."""


def _choose_view(workspace: Workspace, run: PlatoonRun, recorded: Segment | None) -> View:
    """The choice of part and lines, behind a button of the row."""
    measured, linear, is_whole = recorded, run.linear, False
    with st.popover("View", icon=":material/visibility:"):
        if recorded:
            if not st.toggle(
                "Recorded followers", **kept(workspace, "platoon_measured", True),
                help="The speeds and space-gaps of the followers in the recording.",
            ):  # fmt: skip
                measured = None
        else:
            closer = "Last periods" if isinstance(run.leader, Sinusoid) else "Disturbance"
            is_whole = segments(
                "Part of the run",
                {False: "Collision" if run.collisions else closer, True: "Whole run"},
                False, "platoon_whole", workspace, labelled=True,
            )  # fmt: skip
        if linear and not st.toggle(
            "Linear prediction", **kept(workspace, "platoon_linear", recorded is None),
            help="What the linearisation, which holds for small disturbances, would do.",
        ):  # fmt: skip
            linear = None
        seen_from = segments(
            "Time-space diagram seen from", VIEWS, "observer", "platoon_view", workspace,
            labelled=True,
            help="The moving observer drives at the leader's mean speed, so that distances"
            " between the vehicles and their motion are seen.",
        )  # fmt: skip
    return View(seen_from, is_whole, linear, measured)


def _show_charts(run: PlatoonRun, cast: Cast, view: View, themselves: Segment | None) -> None:
    """Speeds and gaps, the time-space diagram, and growth along the platoon."""
    title, names = "", cast.labels
    if len({*cast.order}) == 1 and not cast.is_in_order:
        title, names = (
            f"{cast.vehicles.labels[cast.order[0]]}:",
            (cast.labels[0], *cast.numbers[1:]),
        )
    show.key(
        zip(names, figures.colours_of(cast), strict=True),
        title=title,
        dashed="linear prediction" if view.linear else "",
        dotted="recorded" if view.measured else "",
    )
    span = None if view.is_whole else figures.close_up(run)
    drawn = [
        ("profiles", figures.profiles(run, cast, span, view.measured, HEIGHT, view.linear)),
        ("time_space", figures.time_space(run, cast, span, view.seen_from, HEIGHT)),
        ("growth", figures.growth_by_vehicle(run, cast, themselves, HEIGHT)),
    ]
    show.charts(drawn, "platoon", WIDTHS)


# Which vehicles drive behind the leader, and what it does


def _choose_order(
    workspace: Workspace, chosen: ParameterSet, windows: Sequence[Segment], numbers: DeltaGenerator
) -> list[int]:
    """The followers' indices in ``chosen``; an own order needs their ``numbers`` on the page."""
    choices, many = workspace.choices, len(chosen) > 1
    order = segments(
        "Platoon", ORDERS, "learned", "platoon_order", workspace, labelled=True,
        help="All vehicles in order, one of them repeated, or any order.",
    ) if many else "repeated"  # fmt: skip
    if order == "repeated":
        vehicle = pick(
            workspace, chosen.labels, "platoon_vehicle", label="Vehicle", labelled=True, width=155,
            help="The vehicle that is repeated.",
        )  # fmt: skip
        is_recorded = choices.get("platoon_kind") == "recorded" and windows
        usual = windows[0].followers if is_recorded else FOLLOWERS
        followers = st.number_input(
            "Followers", min_value=1, max_value=MOST_FOLLOWERS, width=100,
            **kept(workspace, "platoon_followers", usual),
            help="How many of it drive behind the leader.",
        )  # fmt: skip
        return [vehicle] * int(followers)
    if order == "learned":
        return list(range(len(chosen)))
    text = choices.get("platoon_own") or f"1-{len(chosen)}, 1-{len(chosen)}"
    st.text_input(
        "Followers, first to last", **bound("platoon_own", text, workspace.keep("platoon_own")),
        help="Numbers and ranges: 1-3, 2, 2", width=200,
    )  # fmt: skip
    legend = (f"{k} = {escape_markdown(label)}" for k, label in enumerate(chosen.labels, 1))
    numbers.caption(" · ".join(legend))
    return parse_order(text, len(chosen))


def parse_order(text: str, count: int) -> list[int]:
    """Indices from numbers and ranges such as "1-3, 2, 2"; the first vehicle is 1.

    Raises:
        AccpinnError: for anything else, and for vehicles that there are not.
    """
    order = [number - 1 for number in parse_vehicles(text)]
    if wrong := [k + 1 for k in order if not 0 <= k < count]:
        raise ParameterError(
            f"Order of followers: there is no vehicle {wrong[0]}; give numbers from 1 to {count}."
        )
    if len(order) > MOST_FOLLOWERS:
        raise ParameterError(
            f"Order of followers: there are {len(order)}; give at most {MOST_FOLLOWERS}."
        )
    return order


def _windows(workspace: Workspace, source: AssessedVehicles) -> list[Segment]:
    """Those of the estimate, else the open one, in which all of the leader's speed is known."""
    segments_of_result = source.result.segments if source.result else ()
    windows = segments_of_result or filter(None, (workspace.segment,))
    return [
        segment
        for segment in windows
        if not any(SPEED.of(segment.vehicles[0]) in b.columns for b in segment.blocks_missing)
    ]


def _choose_leader(
    workspace: Workspace, source: AssessedVehicles, order: Sequence[int], windows: Sequence[Segment]
) -> tuple[Leader, Segment | None]:
    """The leader, and the window that it was recorded in."""
    offered: dict[Disturbance, str] = {kind: kind.capitalize() for kind in PLANNED}
    offered |= {"recorded": "As recorded"} if windows else {}
    kind = select(
        "Disturbance", offered, "sinusoid", "platoon_kind", workspace, width=150,
        help="What the leader does; as recorded, it drives as in a window of the recording.",
    )  # fmt: skip
    if kind == "recorded" and windows:
        names = [str(segment.window) for segment in windows]
        look = {"labelled": True, "width": 150}
        segment = windows[pick(workspace, names, "platoon_window", label="Window", **look)]
        return Recorded(segment.start + segment.time, segment.speeds[:, 0]), segment
    return _planned(workspace, kind, source, order), None


def _planned(
    workspace: Workspace, kind: Disturbance, source: AssessedVehicles, order: Sequence[int]
) -> Leader:
    """The leader with the settings chosen; a sinusoid begins with the platoon's peak."""
    first, usual = FIRST[kind], dict[str, float]()
    if not source.vehicles.parameters.is_linear:  # then the response depends on the speed
        chosen = workspace.choices.get("stability_speed", KMH * source.median_speed)
        usual["speed"] = float(f"{chosen / KMH:.3g}")
    if first == "frequency":
        usual[first] = _peak(workspace, source, order, usual.get("speed"))

    def setting(name: str, place: DeltaGenerator) -> float:
        key, (label, step, meaning) = f"platoon_{kind}_{name}", LABELS[name]
        shown = kept(workspace, key, usual.get(name, float(getattr(PLANNED[kind], name))))
        return float(place.number_input(label, **shown, step=step, format="%.4g", help=meaning))

    values = {first: setting(first, st.container(width=150))}
    if first == "frequency" and values[first] != usual[first]:
        st.button(
            f"Peak: {usual[first]:.4g} rad/s", key="platoon_peak",
            icon=":material/vertical_align_top:",
            on_click=workspace.choices.pop, args=("platoon_sinusoid_frequency", None),
            help="The frequency that this platoon amplifies most.",
        )  # fmt: skip
    with st.popover("Settings", icon=":material/tune:", help="Further settings of the leader"):
        others = (other.name for other in fields(PLANNED[kind]) if other.name != first)
        values |= {name: setting(name, place) for name, place in zip(others, cycle(st.columns(2)))}
    return PLANNED[kind](**values)


def _peak(
    workspace: Workspace, source: AssessedVehicles, order: Sequence[int], speed: float | None
) -> float:
    """The frequency at which this platoon's last follower moves most, in rad/s."""
    if speed:
        speed = workspace.choices.get("platoon_sinusoid_speed", speed)
        source = replace(source, uncertainty=None).at_speed(speed)
    platoon = source.vehicles.parameters[[*order]]
    return float(f"{head_to_tail_peaks(platoon).omega[-1]:.4g}") or Sinusoid.frequency


# Tabs


def _show_numbers(run: PlatoonRun, cast: Cast, recorded: Segment | None) -> None:
    """Amplitudes and smallest gaps along the platoon."""
    wave = run.amplitudes
    if wave and wave.periods:
        periods = "period" if wave.periods == 1 else f"{wave.periods} periods"
        when = "after" if wave.free else "within"
        more = "" if wave.free else ": simulate longer"
        st.caption(f"Measured over the last {periods}, {when} the transient{more}.")
    table = amplitude_table(run, cast.labels, recorded)
    show.table(table, figures.colours_of(cast))
    if run.collisions:
        st.caption("A dash: the vehicle, or one ahead of it, has collided.")
    show.downloads(table, "platoon_amplitudes", "amplitudes")


def _show_map(run: PlatoonRun, cast: Cast) -> None:
    st.caption(
        "Each vehicle's speed relative to the speed before the disturbance."
        f" {_seconds_shown(run, figures.stretch(run))}"
    )
    show.chart(figures.speed_map(run, cast), "platoon_map")


def _show_animation(run: PlatoonRun, cast: Cast) -> None:
    browser.picture("road")(data=motion(run, cast), key="platoon_road")
    ended = " A car that has collided is not drawn any more." if run.collisions else ""
    st.caption(
        f"Seen from the leader; distances to scale, for cars {figures.CAR_LENGTH:g} m long; red"
        f" light: slowing down. {_seconds_shown(run, watched(run))}{ended}"
    )


def _seconds_shown(run: PlatoonRun, rows: NDArray[intp]) -> str:
    """Which part of the run these samples are, for a caption."""
    time = run.trajectories.time
    first, last, end = float(time[rows[0]]), float(time[rows[-1]]), float(time[-1])
    if last - first > SHOWN_WHOLE * (end - float(time[0])):
        return f"All {end:.0f} s." if not first else f"From {first:.0f} to {last:.0f} s."
    return f"From {first:.0f} to {last:.0f} s of {end:.0f} s."
