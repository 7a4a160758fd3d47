"""The tab Measured of the page Stability: the gain found in the recording, without a model."""

from functools import lru_cache

import streamlit as st

from accpinn.results.figures.measured_gain import measured_bode
from accpinn.results.figures.style import LEADER, vehicle_colour
from accpinn.results.tables.stability import measured_gain_table
from accpinn.stability.measured_gain import measured_gain
from pages.ui.components import show
from pages.ui.components.show import escape_markdown
from pages.ui.components.widgets import select
from pages.ui.stability.details import Shown

NO_DATA = (
    "The measured gain needs the recorded speeds, which are not here: open a recording, or a"
    " snapshot with its data."
)
_measured = lru_cache(maxsize=64)(measured_gain)


def show_measured(shown: Shown) -> None:
    """The gain of one follower by Welch's method, beside the model's curve."""
    chosen, choice = shown.chosen, shown.workspace.map_choice
    segment = shown.source.segment or shown.workspace.segment
    if segment is None:
        show.messages(NO_DATA)
        return
    labels = segment.labels[1:]
    follower = choice.measured if choice.measured < len(labels) else 0
    head = st.container(horizontal=True, vertical_alignment="center")
    with head:
        if len(labels) > 1:
            select(
                "Follower", dict(enumerate(labels)), follower, "stability_measured",
                lambda k: setattr(choice, "measured", k), labelled=False, width=240,
                help="The vehicle whose recorded speed is compared with that of the car ahead.",
            )  # fmt: skip
    found = show.attempt(lambda: _measured(segment, follower))
    if found is None:
        return
    # Vehicles of another source stand for those of the recording, in their order.
    model = 0 if len(chosen) == 1 else follower if len(chosen) == len(labels) else None
    colour = vehicle_colour(segment.vehicles[follower + 1], segment.vehicles[0])
    key = [(f"{labels[follower]}, measured", LEADER)]
    parameters, name = None, ""
    if model is not None:
        parameters, name = chosen.parameters[model], chosen.labels[model]
        key.append((f"{name}, model with the {'estimate' if shown.source.fit else 'parameters'}",
                    colour))  # fmt: skip
    with head:
        show.key(key)
    show.chart(
        measured_bode(found, labels[follower], colour, parameters, name), "stability_measured_gain"
    )
    band = f"{100 * found.level:.0f} %"
    st.caption(
        f"{escape_markdown(segment.source)}, {segment.window}. The measured gain from the speed"
        " ahead to the vehicle's own, from the recorded speeds alone (Welch's method,"
        f" {found.pieces} pieces of {found.length:.0f} s), with {band} bars for the random error."
        " Faint: the coherence is not above that of unrelated signals. Where the points leave the"
        " curve, the CTHP with these parameters does not describe how this vehicle passes on"
        " disturbances. A peak narrower than"
        f" {found.omega[0]:.2g} rad/s appears lower than it is."
    )
    show.downloads(
        measured_gain_table(labels[follower], found),
        f"measured_gain_{labels[follower]}",
        "measured",
    )
