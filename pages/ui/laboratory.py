"""The frequency laboratory on page Stability: a response and the cars behind a sinusoid.

One frequency drives both charts. The browser moves it without the server, which is told where it
was left; they are a fragment, so that a change draws nothing else.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import streamlit as st

from accpinn.platoon.leader import Sinusoid
from accpinn.results.cast import Cast
from accpinn.results.figures import laboratory as figures
from accpinn.results.figures.laboratory import Part
from accpinn.results.figures.stability import WHOLE, WHOLE_NAME, frequencies
from accpinn.results.messages import stability as words
from accpinn.study.vehicles import AssessedVehicles
from accpinn.units import RadiansPerSecond
from pages.ui.components import browser, frame, show
from pages.ui.components.show import escape_markdown, kept, segments, select
from pages.ui.session.workspace import Workspace

HEIGHT = 275
"""Height of both charts, in pixels: with their controls they fit on the first screen."""
FOLLOWERS = 8
"""Followers of a car that is repeated, as in the paper."""
PAPER_FREQUENCIES: tuple[RadiansPerSecond, ...] = (0.25, 0.3)
"""Frequencies of the leader's sinusoid in the paper's four panels."""
DIGITS = 4
"""Significant digits of a frequency that is chosen."""
FREQUENCY, PLATOON, PART = "laboratory_frequency", "laboratory_platoon", "laboratory_part"
"""Keys of the choices."""
BODE, WAVES = "stability_bode", "laboratory_waves"
"""Keys of the response, which can be clicked on, and of the waves with their slider."""
PARTS: dict[Part, str] = {"magnitude": "Magnitude", "phase": "Phase"}


def show_laboratory(workspace: Workspace, source: AssessedVehicles) -> AssessedVehicles:
    """The response over frequency beside the platoon at one frequency.

    Returns:
        The vehicles as charts show them: without uncertainty where the user wants to see none.
    """
    shown = source
    # A long sentence breaks beside the toggle instead of pushing it below.
    headline, choice = st.columns((6, 1), vertical_alignment="center")
    headline.markdown(f"##### {escape_markdown(words.most_amplifying(source))}")
    with choice:
        if source.uncertainty and not st.toggle(
            "Uncertainty", **kept(workspace, "stability_uncertainty", True),
            help="Bands of the response and of the model beside the measured gain, and posterior"
            " samples on the map.",
        ):  # fmt: skip
            shown = replace(source, uncertainty=None)
    st.fragment(_show_frequency)(workspace, shown)
    return shown


def _show_frequency(workspace: Workspace, source: AssessedVehicles) -> None:
    """Draw both charts, each below its controls."""
    offered = offered_frequencies(source)
    left, right = st.columns((1.1, 1), gap="small")
    with left.container(horizontal=True, vertical_alignment="bottom"):
        which = _choose_platoon(workspace, source)
        part = segments("Response", PARTS, "magnitude", PART, workspace, labelled=True)
        peak = nearest(_peak(source, which) or Sinusoid.frequency, offered)
        omega = nearest(workspace.choices.get(FREQUENCY, peak), offered)
    with left:
        show.chart(
            figures.response_curves(source, part, HEIGHT), BODE, selection_mode="points",
            on_select=lambda: take_click(workspace, st.session_state[BODE], offered),
        )  # fmt: skip
    cast = Cast(source.vehicles, order_of(which, len(source.vehicles)))
    chips = [(f"{at:g}", at, "In rad/s, as in the paper.") for at in PAPER_FREQUENCIES]
    chips.append(("Peak", peak, "The frequency that these cars amplify most."))
    with right:
        browser.picture("laboratory")(
            key=WAVES,
            on_omega_change=lambda: take_frequency(workspace, st.session_state[WAVES]),
            data=figures.frequency_data(source, cast, part, offered) | {
                "index": offered.index(omega), "height": HEIGHT, "response": BODE,
                "platoon": platoon_names(source)[which],
                "chips": [
                    {"name": name, "index": offered.index(nearest(at, offered)), "help": about}
                    for name, at, about in chips
                ],
            },
        )  # fmt: skip


def take_frequency(workspace: Workspace, event: Mapping[str, Any]) -> None:
    """Keep the frequency that the slider was left at."""
    if omega := event.get("omega"):
        workspace.choices[FREQUENCY] = float(omega)


def offered_frequencies(source: AssessedVehicles) -> list[RadiansPerSecond]:
    """The frequencies of the slider: those of the curves, the paper's, and all peaks."""
    report = source.report
    peaks = [vehicle.peak.omega for vehicle in report.vehicles] + [report.platoon.peaks[-1].omega]
    curves = frequencies(report)
    others = [at for at in (*PAPER_FREQUENCIES, *peaks) if curves[0] <= at <= curves[-1]]
    return sorted({float(f"{at:.{DIGITS}g}") for at in (*curves.tolist(), *others)})


def nearest(omega: RadiansPerSecond, offered: Sequence[RadiansPerSecond]) -> RadiansPerSecond:
    """The frequency on offer that is nearest by its ratio."""
    return min(offered, key=lambda at: abs(np.log(at / omega)))


def order_of(which: int, count: int) -> tuple[int, ...]:
    """The indices of a platoon's vehicles: all ``count`` in order, or one of them repeated."""
    return tuple(range(count)) if which == WHOLE else (which,) * FOLLOWERS


def take_click(
    workspace: Workspace, event: Mapping[str, Any], offered: Sequence[RadiansPerSecond]
) -> None:
    """Choose the frequency of the point that was clicked on, and the vehicle of its curve."""
    points = event["selection"]["points"]
    if not points:
        return
    workspace.choices[FREQUENCY] = nearest(float(points[0]["x"]), offered)
    vehicle = show.clicked_data(points)
    if vehicle is not None:  # measured gains have none
        workspace.choices[PLATOON] = int(vehicle)


def most_amplifying(source: AssessedVehicles) -> int:
    """The index of the vehicle that amplifies most."""
    peaks = [vehicle.peak.gain for vehicle in source.report.vehicles]
    return int(np.argmax(np.nan_to_num(peaks, posinf=np.inf)))


def platoon_names(source: AssessedVehicles) -> dict[int, str]:
    """The platoons that can be chosen, by the index of the vehicle repeated, or `WHOLE`."""
    repeated = {k: f"{FOLLOWERS} × {label}" for k, label in enumerate(source.vehicles.labels)}
    return repeated | {WHOLE: WHOLE_NAME}


def _choose_platoon(workspace: Workspace, source: AssessedVehicles) -> int:
    """The index of the vehicle that is repeated, or `WHOLE`; by default the most amplifying one."""
    usual = most_amplifying(source)
    if len(source.vehicles) == 1:
        return usual
    return select(
        "Platoon", platoon_names(source), usual, PLATOON, workspace, width=220,
        help="The cars behind the leader: one repeated, or all in order.",
    )  # fmt: skip


def _peak(source: AssessedVehicles, which: int) -> RadiansPerSecond:
    """The frequency that a platoon amplifies most; 0 where it amplifies none."""
    report = source.report
    peak = report.platoon.peaks[-1] if which == WHOLE else report.vehicles[which].peak
    return float(peak.omega)


def open_platoon(workspace: Workspace, source: AssessedVehicles) -> None:
    """Turn to the platoon that is chosen, at its frequency, on the page of other disturbances."""
    which = workspace.choices.get(PLATOON, most_amplifying(source))
    offered = offered_frequencies(source)
    usual = nearest(_peak(source, which) or Sinusoid.frequency, offered)
    workspace.choices.pop("platoon_sinusoid_speed", None)  # the one chosen here instead
    workspace.choices.update(
        platoon_order="learned" if which == WHOLE else "repeated",
        platoon_vehicle=max(which, 0),
        platoon_sinusoid_frequency=nearest(workspace.choices.get(FREQUENCY, usual), offered),
        platoon_kind="sinusoid",
    )
    frame.go(frame.PLATOON, workspace)
