"""The tab Measured of the page Stability: the gain found in the recording, without a model."""

from functools import lru_cache

import numpy as np
import streamlit as st

from accpinn.inference.intervals import Uncertainty
from accpinn.model.published import ParameterSet
from accpinn.results.figures.stability import Model, measured_bode
from accpinn.results.figures.style import LEADER, vehicle_colour
from accpinn.results.tables.stability import measured_gain_table
from accpinn.stability.measured_gain import measured_gain
from pages.ui.components import show
from pages.ui.components.show import escape_markdown
from pages.ui.components.widgets import select
from pages.ui.session.resources import KEPT
from pages.ui.stability.details import ShownVehicles

NO_DATA = (
    "The measured gain needs the recorded speeds, which are not here: open a recording, or a"
    " snapshot with its data."
)
_measured = lru_cache(maxsize=KEPT)(measured_gain)
_figure = lru_cache(maxsize=KEPT)(measured_bode)


@lru_cache(maxsize=KEPT)
def _model(chosen: ParameterSet, which: int, uncertainty: Uncertainty | None) -> Model:
    """One vehicle's curve, with the band of its posterior where that is known."""
    draws = uncertainty.draws[:, which] if uncertainty else None
    known = draws is not None and np.isfinite(draws.alpha).all()
    return Model(chosen.labels[which], chosen.parameters[which], draws if known else None)


def show_measured(shown: ShownVehicles) -> None:
    """The gain of one follower by Welch's method, beside the model's curve."""
    chosen, choice = shown.chosen, shown.workspace.map_choice
    result = shown.source.result
    segment = (result.segment if result else None) or shown.workspace.segment
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
                lambda k: choice.set(measured=k), labelled=False, width=240,
                help="The vehicle whose recorded speed is compared with that of the car ahead.",
            )  # fmt: skip
    found = show.attempt(lambda: _measured(segment, follower))
    if found is None:
        return
    # Vehicles of another source stand for those of the recording, in their order.
    which = 0 if len(chosen) == 1 else follower if len(chosen) == len(labels) else None
    model = None if which is None else _model(chosen, which, shown.uncertainty)
    colour = vehicle_colour(segment.vehicles[follower + 1], segment.vehicles[0])
    key = [(f"{labels[follower]}, measured", LEADER)]
    if model:
        key.append((f"{model.name}, model", colour))
    with head:
        show.key(key)
    show.chart(_figure(found, labels[follower], colour, model), "stability_measured_gain")
    level = f"{100 * found.level:.0f} %"
    band = f" Shaded: {level} band of the model." if model and model.draws is not None else ""
    st.caption(
        f"{escape_markdown(segment.source)}, {segment.window}. The measured gain from the speed"
        " ahead to the vehicle's own, from the recorded speeds alone (Welch's method,"
        f" {found.pieces} pieces of {found.length:.0f} s), with {level} bars for the random error."
        " Faint: the coherence is not above that of unrelated signals. Where the points leave the"
        " curve, the CTHP with these parameters does not describe how this vehicle passes on"
        f" disturbances. A peak narrower than {found.omega[0]:.2g} rad/s appears lower than it is;"
        " above 0.3 rad/s, where vehicles pass on little, the vehicle's own disturbances make the"
        f" gain appear higher (by a quarter in simulated recordings of 300 s).{band}"
    )
    show.downloads(
        measured_gain_table(labels[follower], found),
        f"measured_gain_{labels[follower]}",
        "measured",
    )
