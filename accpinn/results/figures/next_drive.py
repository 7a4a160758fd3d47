"""A drive that is proposed: the speed of the car ahead, and how much narrower intervals become."""

import plotly.graph_objects as go

from accpinn.channels import TIME
from accpinn.results.figures import style
from accpinn.results.tables.next_drive import title_of
from accpinn.study.next_drive import NextDrive

HEIGHT = 260


def drive_speed(proposed: NextDrive) -> go.Figure:
    """The speed of the car ahead over time."""
    chart = style.Chart("next-drive", HEIGHT)
    chart.line(
        proposed.time, proposed.speed, "Car ahead", style.MODEL,
        hover="%{y:.1f} m/s at %{x:.0f} s<extra></extra>",
    )  # fmt: skip
    chart.axis("x", TIME.axis, range=[0.0, float(proposed.time[-1])])
    chart.axis("y", "Speed of the car ahead [m/s]")
    return chart.figure()


def drive_narrowing(proposed: NextDrive) -> go.Figure:
    """Width of each interval from the drive alone, relative to that from a motorway drive."""
    rows = proposed.narrowing
    shares = [100.0 * row.relative_width for row in rows]
    titles = [title_of(proposed, row) for row in rows]
    chart = style.Chart("next-drive-narrowing", HEIGHT, margin={"l": 140})
    chart.add(
        shares, titles, "This drive", type="bar", orientation="h",
        marker={"color": style.translucent(style.MODEL, 0.7)},
        text=[f"{share:.0f} %" for share in shares], textposition="auto",
        hovertemplate="%{y}: %{x:.0f} % of the interval after a motorway drive<extra></extra>",
    )  # fmt: skip
    chart.level("x", 100.0, {"color": style.LEADER, "width": 1.5, "dash": "dash"})
    chart.axis(
        "x", "Interval [% of a motorway drive's]", range=[0.0, max(108.0, 1.05 * max(shares))]
    )
    chart.axis("y", type="category", autorange="reversed")
    return chart.figure()
