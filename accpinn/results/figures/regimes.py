"""What each follower does when: a ribbon a follower, coloured by regime."""

import plotly.graph_objects as go

from accpinn.mask import stretches
from accpinn.segment.regimes import CATCHING_UP, FOLLOWING, MANUAL, STANDSTILL, Regimes
from accpinn.segment.segment import Segment

COLOURS = {
    FOLLOWING: "#8b93a1",
    CATCHING_UP: "#b07d00",
    MANUAL: "#b04a96",
    STANDSTILL: "#4f86b5",
}
"""By regime: a contrast of 3 or more on white and on the dark page; car-following, which the model is for, is grey
and thin; the others differ under red-blind and green-blind vision, and from the first vehicles."""
THIN, THICK = 3, 8


def ribbons(segment: Segment, regimes: Regimes) -> list[go.Scatter]:
    """A trace for each follower and regime that occurs, over the recording's time."""
    traces = []
    # An instant stands for the step around it, so that ribbons leave no holes.
    half = segment.sample_time / 2
    instants = segment.window.start + segment.time
    for column, number in zip(regimes.codes.T, segment.vehicles[1:], strict=True):
        for code, name in enumerate(regimes.names):
            x: list[float | None] = []
            for run in stretches(column == code):
                x += [float(instants[run.first]) - half, float(instants[run.last]) + half, None]
            if x:
                traces.append(
                    go.Scatter(
                        x=x,
                        y=[str(number)] * len(x),
                        name=f"{number} {name}",
                        mode="lines",
                        line={"color": COLOURS[code], "width": THIN if code == 0 else THICK},
                        hoverinfo="skip",
                    )
                )
    return traces


def key(regimes: Regimes) -> list[tuple[str, str]]:
    """Name and colour of each regime that occurs."""
    occurring = [code for code, colour in COLOURS.items() if (regimes.codes == code).any()]
    return [(regimes.names[code], COLOURS[code]) for code in occurring]
