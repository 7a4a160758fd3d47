"""The page Stability: the frequency laboratory, the verdict, a table, and details in tabs."""

import numpy as np
import streamlit as st

from accpinn.inference.intervals import LEVEL
from accpinn.model.registry import FOLLOWING
from accpinn.results.figures import control
from accpinn.results.figures import stability as figures
from accpinn.results.figures.comparison import Follower, peak_over_speed
from accpinn.results.figures.stability import cloud_caption
from accpinn.results.figures.style import LEADER, vehicle_colour
from accpinn.results.messages import messages
from accpinn.results.messages import stability as words
from accpinn.results.messages.estimate import assumption, contradictions
from accpinn.results.strip import strip_of
from accpinn.results.tables import stability as tables
from accpinn.stability import CERTAIN
from accpinn.stability.measured_gain import measured_gain
from accpinn.stability.region import Plane
from accpinn.study.vehicles import AssessedVehicles
from pages.ui.components import frame, show
from pages.ui.components.parameter_picker import choose_parameters
from pages.ui.components.show import KMH, escape_markdown, pick, segments, tabs
from pages.ui.components.strip import show_strip
from pages.ui.laboratory import PLATOON as SIMULATED
from pages.ui.laboratory import most_amplifying, open_platoon, show_laboratory
from pages.ui.session.workspace import Workspace

LEAD = "Which of these vehicles amplify the disturbances of the car ahead?"
GAIN = "‖h‖₁: the largest factor by which a peak of the speed deviation can grow."
MOST_REASONS = 5
"""Vehicles and platoon whose reasons stand together; of more, one is chosen."""
PLATOON = (
    "Strictly stable means that no vehicle amplifies anything, weakly that nothing has grown at the"
    " last one."
)
PLANES: dict[Plane, str] = {"beta": "β and τ", "alpha": "α and τ", "gains": "α and β"}
HELD: dict[Plane, str] = {"beta": "α", "alpha": "β", "gains": "τ"}
"""The parameter that a plane keeps."""
SELECT = 56
"""Height of a select box above a chart, in pixels."""
NO_DATA = (
    "The measured gain needs the recorded speeds, which are not here: open a recording, or a"
    " snapshot."
)


def show_page(workspace: Workspace) -> None:
    chosen = choose_parameters(workspace, "stability", LEAD)
    if chosen is None:
        return
    is_nonlinear = not chosen.vehicles.parameters.is_linear
    source = _at_chosen_speed(workspace, chosen) if is_nonlinear else chosen
    show_strip(
        strip_of(source), lambda: _show_verdict(workspace, source),
        lambda: _next_button(workspace, source), "stability",
        lambda vehicle: _choose_vehicle(workspace, vehicle),
    )  # fmt: skip
    shown = show_laboratory(workspace, source)
    _show_bode_notes(shown)
    tabs(workspace, "stability", {
        "Numbers": lambda: _show_numbers(workspace, source),
        "Poles and responses": lambda: _show_modes(workspace, shown),
        "Region": lambda: _show_region(workspace, shown),
        "Margin": lambda: _show_margin(shown),
        "Measured": lambda: _show_measured(workspace, shown),
        **({"Waves": lambda: _show_waves(shown)} if shown.vehicles.parameters.nonlinear.size
           else {}),
    })  # fmt: skip


def _next_button(workspace: Workspace, source: AssessedVehicles) -> None:
    """The next step: the platoon of the laboratory behind other disturbances."""
    if st.button(
        "Next: platoon", icon=":material/arrow_forward:", key="stability_next", type="primary",
        help="Go on with the laboratory's cars: gaps, transient, other disturbances.",
    ):  # fmt: skip
        open_platoon(workspace, source)


def _choose_vehicle(workspace: Workspace, vehicle: int) -> None:
    """Let the tabs and the simulation be about one vehicle, 0 for the first."""
    of_vehicle = (SIMULATED, "stability_held", "stability_measured", "stability_impulse")
    workspace.choices.update(dict.fromkeys(of_vehicle, vehicle), stability_reasons=vehicle + 1)


def _at_chosen_speed(workspace: Workspace, source: AssessedVehicles) -> AssessedVehicles:
    """The vehicles at a speed that the user chooses, by default the recording's median."""
    median = round(KMH * source.median_speed)
    speed = show.choose_speed(
        workspace, "stability_speed", source.median_speed,
        f"The {FOLLOWING[source.vehicles.model].title} answers small disturbances differently"
        f" at every speed. The recording's median: {median} km/h.",
    )  # fmt: skip
    return source if speed == median / KMH else source.at_speed(speed)


def _show_verdict(workspace: Workspace, source: AssessedVehicles) -> None:
    """The verdicts behind the headline, and their assumptions."""
    chosen, report, result = source.vehicles, source.report, source.result
    st.markdown(f"##### {escape_markdown(source.origin)}")
    if background := words.behind_verdict(source):
        st.markdown(escape_markdown(background))
    if len(chosen) > 1:
        platoon = report.platoon
        verdicts = (
            ("Strictly", platoon.l2_strict, platoon.linf_strict),
            ("Weakly", platoon.l2_weak, platoon.linf_weak),
        )
        lines = []
        for name, *pair in verdicts:
            l2, linf = (verdict.word for verdict in pair)
            lines.append(f"{name}: L₂ **{l2}**, L∞ **{linf}**.")
        why = escape_markdown(words.along_platoon(source))
        st.markdown(f"The platoon in this order. {' '.join(lines)} {why}", help=PLATOON)
    assumed = assumption(result, source.speed) if result else words.GIVEN_PARAMETERS
    if source.cars:
        assumed = words.SEVERAL
    st.caption(escape_markdown(assumed))
    show.cautions(contradictions(result))
    if result:
        against = words.measured_gain_sentences(source.checks, result.info)
        st.caption("  \n".join(map(escape_markdown, against)))


def _show_bode_notes(source: AssessedVehicles) -> None:
    """The meaning of the marks of the laboratory's charts."""
    measured, platoon = figures.measured_of(source), figures.measured_platoon(source)
    st.caption(
        words.about_bode(source.uncertainty)
        + " Points: measured gain, faint where not compared." * bool(measured)
        + " Grey: all cars in order, solid where measured." * bool(platoon.size)
        + f" {words.explained(source)}",
        help=words.MEASURED if measured else None,
    )


def _show_numbers(workspace: Workspace, source: AssessedVehicles) -> None:
    """The table of verdicts; behind it the reasons, the criteria, and the gain over speed."""
    _show_verdicts(source)
    if source.vehicles.parameters.nonlinear.size:
        _show_speeds(source)
    with st.expander("Reasons and criteria"):
        _show_reasons(workspace, source)
        _show_criteria(source)


def _show_verdicts(source: AssessedVehicles) -> None:
    chosen, uncertainty, sure = source.vehicles, source.uncertainty, 100 * CERTAIN
    table = tables.verdict_table(source)
    show.table(table, figures.colours(chosen))
    posterior = uncertainty and (
        "Probability: the share of posterior samples that are string stable; the verdict is"
        f" undecided between {100 - sure:.0f} and {sure:.0f} %. In brackets, or on"
        f" pointing at a dotted line: {100 * uncertainty.level:.0f} % intervals. "
    )
    linear = ("α, β, τ and s₀ are those of the linearisation, a CTHP with the same response to"
              " small disturbances. " if not chosen.parameters.is_linear else "")  # fmt: skip
    level = f"{100 * uncertainty.level:.0f} % intervals." if uncertainty else "By these parameters."
    if any(growth.is_measured for growth in source.growths):
        level = f"{level} Peaks are the model's."
    show.caption(level, f"{linear}{posterior or ''}{GAIN}")
    if differ := words.criteria_differ(source):
        st.markdown(f":material/warning: {escape_markdown(differ)}")
    show.downloads(table, f"stability_{chosen.title}".lower(), "stability")


def _show_speeds(source: AssessedVehicles) -> None:
    """The largest gain of each vehicle over the speed, where the recording's speeds are marked."""
    vehicles, uncertainty = source.vehicles, source.uncertainty
    estimates = vehicles.parameters.nonlinear
    draws = uncertainty.draws.nonlinear if uncertainty else None
    followers = [
        Follower(label, colour, FOLLOWING[vehicles.model], estimates[k],
                 None if draws is None else draws[:, k])
        for k, (label, colour) in enumerate(zip(vehicles.labels, figures.colours(vehicles),
                                                strict=True))
    ]  # fmt: skip
    segments = source.result.segments if source.result else ()
    driven = np.array([source.median_speed])
    if segments:
        driven = np.concatenate([segment.speeds[:, 1:].ravel() for segment in segments])
    low, high = np.quantile(driven, (0.05, 0.95)).tolist()
    speed = source.speed or source.median_speed
    show.chart(peak_over_speed(followers, (low, high), speed), "stability_speeds")
    driven_at = (
        f" Shaded in grey: the followers drive {KMH * low:.0f} to {KMH * high:.0f} km/h for 90 % of"
        " the recorded time."
    )
    bands = f" Bands: {100 * LEVEL:.0f} % intervals."
    st.caption(
        "Largest gain for small disturbances: above 0 dB they grow."
        f"{driven_at * bool(segments)} Dashed: {KMH * speed:.0f} km/h.{bands * bool(uncertainty)}"
    )


def _show_criteria(source: AssessedVehicles) -> None:
    """Each vehicle's criteria, and those of the platoon up to it."""
    chosen, uncertainty = source.vehicles, source.uncertainty
    st.caption(words.CRITERIA)
    show.key(figures.CRITERIA_KEY)
    show.chart(figures.criteria_by_vehicle(source), "stability_criteria")
    table = tables.assessment_table(source)
    show.table(tables.criteria_part(table), figures.colours(chosen))
    posterior = (
        " In brackets: intervals from posterior samples of a model with disturbances that last for"
        " seconds."
    )
    st.caption(
        "Stable and the criteria: by these parameters. Smallest stable time headway: that of this"
        f" vehicle with its α and β.{posterior if uncertainty else ''}"
    )
    show.downloads(table, f"criteria_{chosen.title}".lower(), "criteria")
    if source.result:
        show.messages(messages(source.result.findings, source.result.info))


def _show_modes(workspace: Workspace, source: AssessedVehicles) -> None:
    """Poles and zeros, step responses, and the impulse response of one vehicle with its area."""
    chosen = source.vehicles
    left, middle, right = st.columns(3, gap="small")
    with left:
        show.chart(control.pole_map(source), "stability_poles")
    with middle:
        show.chart(control.step_responses(source), "stability_step")
    with right:
        k = pick(
            workspace, chosen.labels, "stability_impulse", most_amplifying(source), "Vehicle",
            help="The vehicle whose impulse response is drawn.",
        )  # fmt: skip
        height = control.HEIGHT - (SELECT if len(chosen) > 1 else 0)
        show.chart(control.impulse_response(source, k, height), "stability_impulse_response")
    table = tables.modes_table(source)
    show.table(table, figures.colours(chosen))
    show.caption(
        "Crosses: poles; rings: zeros. Grey band: ±2 %. ‖h‖₁ is the shaded area.", words.POLES
    )
    show.downloads(table, f"poles_{chosen.title}".lower(), "poles")


def _show_region(workspace: Workspace, source: AssessedVehicles) -> None:
    """The boundaries of stability in a plane of two parameters."""
    chosen, uncertainty = source.vehicles, source.uncertainty
    with st.container(horizontal=True, vertical_alignment="center"):
        plane = segments(
            "Plane", PLANES, "beta", "stability_plane", workspace,
            help="The two parameters on the axes; all else is that of the vehicle chosen.",
        )  # fmt: skip
        held = pick(
            workspace, chosen.labels, "stability_held", len(chosen) - 1, "Vehicle",
            help="The vehicle whose third parameter, lag and delay the boundaries are drawn for.",
        )  # fmt: skip
        show.key(figures.MAP_KEY)
    chart = figures.stability_map(source, held, plane)
    show.chart(chart, "stability_map")
    about = escape_markdown(words.about_map(chosen, held, HELD[plane]))
    st.caption(about + (f" {cloud_caption(chart, uncertainty, plane)}" if uncertainty else ""))


def _show_margin(source: AssessedVehicles) -> None:
    """How much time gap separates each vehicle from string stability."""
    chosen = source.vehicles
    st.markdown(f"**{escape_markdown(words.most_needed(source))}**")
    show.chart(control.margin_forest(source), "stability_margins")
    table = tables.margin_table(source)
    show.table(table, (*figures.colours(chosen), LEADER)[: len(table.rows)])
    show.caption(f"{words.MARGIN_MARKS} {words.about_margin(source)}", words.MARGIN)
    show.downloads(table, f"margin_{chosen.title}".lower(), "margin")


def _show_waves(source: AssessedVehicles) -> None:
    """The growth of waves by their size and direction."""
    waves = source.waves
    assert waves is not None  # as the tab is there for models that have some
    st.markdown(f"**{escape_markdown(words.waves_in_words(waves))}**")
    left, right = st.columns(2, gap="small")
    with left:
        show.chart(control.growth_by_frequency(source, waves), "stability_waves")
    with right:
        show.chart(control.growth_by_size(source, waves), "stability_waves_size")
    show.caption("Solid: lower half (braking); dashed: upper half (accelerating).", words.WAVES)
    show.downloads(tables.waves_table(waves), f"waves_{source.vehicles.title}".lower(), "waves")


def _show_reasons(workspace: Workspace, source: AssessedVehicles) -> None:
    """The reason for each verdict; of many vehicles for the one chosen."""
    about = [vehicle.behaviour.value for vehicle in source.report.vehicles]
    reasons, texts = words.reasons(source), []
    for (label, verdicts), behaviour in zip(reasons, [*about, PLATOON], strict=False):
        lines = [
            f"\n- {verdict.criterion.value}: **{verdict.word}**. {escape_markdown(why)}"
            for verdict, why in verdicts
        ]
        texts.append(f"**{escape_markdown(label)}.** {behaviour}\n{''.join(lines)}")
    if len(texts) > MOST_REASONS:
        names = ("The platoon", *source.vehicles.labels)
        which = pick(workspace, names, "stability_reasons", label="Vehicle")
        texts = [texts[which - 1]]
    # A row of columns each, so that a narrow screen keeps their order; the last of an odd number,
    # as the platoon after four vehicles, takes the whole width.
    for at in range(0, len(texts), 2):
        pair = texts[at : at + 2]
        for column, text in zip(st.columns(len(pair), gap="large"), pair, strict=True):
            column.markdown(text)


def _show_measured(workspace: Workspace, source: AssessedVehicles) -> None:
    """The gain of one follower by Welch's method, beside the model's curve."""
    chosen, result = source.vehicles, source.result
    windows = (result.segments if result else ()) or tuple(filter(None, (workspace.segment,)))
    if not windows:
        show.messages(NO_DATA)
        return
    segment = windows[0]
    labels = segment.labels[1:]
    head = st.container(horizontal=True, vertical_alignment="center")
    with head:
        follower = pick(
            workspace, labels, "stability_measured",
            help="The vehicle whose recorded speed is compared with that of the car ahead.",
        )  # fmt: skip
    model_of = result.parameters[[follower]] if result else None
    gain = measured_gain(windows, follower, reference=model_of)
    colour = vehicle_colour(segment.vehicles[follower + 1], segment.vehicles[0])
    key, which = [(f"{labels[follower]}, measured", LEADER)], min(follower, len(chosen) - 1)
    # Vehicles of another source stand for those of the recording, in their order.
    model = source if len(chosen) in (1, len(labels)) else None
    if model:
        at = f" at {KMH * source.speed:.0f} km/h" if source.speed else ""
        key.append((f"{chosen.labels[which]}, model{at}", colour))
    with head:
        show.key(key)
    chart = figures.measured_bode(gain, labels[follower], colour, model, which)
    show.chart(chart, "stability_measured_gain")
    level = f"{100 * gain.level:.0f} %"
    about = frame.in_words(segment.window, [part.window for part in windows])
    is_shaded = any(trace.fill for trace in chart.data)
    band = f" Shaded: {level} band of the model." * is_shaded
    st.caption(
        f"{escape_markdown(segment.source)}, {about}. The measured gain from the speed"
        " ahead to the vehicle's own, from the recorded speeds alone (Welch's method,"
        f" {gain.pieces} pieces of {gain.length:.0f} s), with {level} bars for the random error."
        " Open: the coherence is not above that of unrelated signals. Where the points leave the"
        " curve, the model with these parameters does not describe how this vehicle passes on"
        f" disturbances. A peak narrower than {gain.omega[0]:.2g} rad/s appears lower than it is,"
        " but where the model resolves it; above 0.3 rad/s, where vehicles pass on little, the"
        " vehicle's own disturbances make the"
        f" gain appear higher (by a quarter in simulated recordings of 300 s).{band}"
    )
    show.downloads(
        tables.measured_gain_table(labels[follower], gain),
        f"measured_gain_{labels[follower]}",
        "measured",
    )
