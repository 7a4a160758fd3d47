"""What every page begins with: its title, the way to the other pages, and where things stand."""

import html
from collections.abc import Container, Sequence
from pathlib import Path

import streamlit as st

from accpinn.results.figures.style import vehicle_colour
from accpinn.results.snapshot.schema import Snapshot
from accpinn.segment.segment import SegmentInfo
from accpinn.tasks.job import Job
from accpinn.tasks.task import Status
from pages.ui.components import charts
from pages.ui.components.text import escape_markdown
from pages.ui.session.registry import SESSION, current
from pages.ui.session.workspace import Workspace, sync_widget

HERE = Path(__file__).parent
ROOT = HERE.parents[2]
HOME, DATA, TRAIN = "app.py", "pages/1_Data.py", "pages/2_Train.py"
STABILITY, SNAPSHOTS = "pages/3_Stability.py", "pages/6_Snapshots.py"

_ICONS = {
    "Home": "home",
    "Data": "timeline",
    "Train": "model_training",
    "Stability": "vital_signs",
    "Platoon": "directions_car",
    "Compare": "compare_arrows",
    "Snapshots": "inventory_2",
}

_STYLE = """<style>
.stMainBlockContainer { padding-top: 4.2rem; padding-bottom: 3rem; max-width: 86rem; }
[data-testid="stStatusWidget"] { display: none; }
.vehicle-key { display: flex; flex-wrap: wrap; gap: .2rem 1.1rem; font-size: .875rem; }
.vehicle-key span { white-space: nowrap; }
.vehicle-key .faint { opacity: .5; }
.vehicle-key i { display: inline-block; width: 1.1em; height: .28em; border-radius: 2px;
  margin-right: .45em; vertical-align: middle; }
</style>"""


def begin(title: str, lead: str = "") -> Workspace:
    """Set up a page; everything on it comes after this."""
    st.set_page_config(
        page_title=f"{title} · accpinn" if title else "accpinn",
        page_icon=str(HERE / "icon.svg"),
        layout="wide",
    )
    st.html(_STYLE)
    workspace = current()
    _sidebar(workspace)
    if title:
        st.title(title, anchor=False)
    if lead:
        st.caption(lead)
    if st.session_state["lost_session"]:
        st.info(
            "That session is no longer on this server, so a new one has begun. Finished trainings"
            " are kept: open the same recording and the answer comes from the cache.",
            icon=":material/history:",
        )
    if fault := st.session_state["snapshot_fault"]:
        st.error(escape_markdown(fault), icon=":material/link_off:")
    return workspace


def link(page: str, label: str, workspace: Workspace, icon: str = "") -> None:
    """A link to another page that keeps the session in the address."""
    st.page_link(
        page,
        label=label,
        icon=f":material/{icon}:" if icon else "",
        query_params={SESSION: workspace.id},
    )


def go(page: str, workspace: Workspace) -> None:
    """Turn to another page; nothing after this runs."""
    st.switch_page(page, query_params={SESSION: workspace.id})


def vehicle_key(segment: SegmentInfo, with_truth: bool = False) -> None:
    """Which colour is which vehicle, once for all charts below."""
    leader = segment.vehicles[0]
    entries = [
        (f"{label} (leader)" if number == leader else label, vehicle_colour(number, leader))
        for number, label in zip(segment.vehicles, segment.labels, strict=True)
    ]
    show_key(entries, dashed="true value" if with_truth else "")


def show_key(
    entries: Sequence[tuple[str, str]], faint: Container[str] = (), dashed: str = ""
) -> None:
    """Names beside their colours, some faint, and what a dashed line means."""
    spans = [
        f"<span{' class=faint' if name in faint else ''}>"
        f'<i style="background:{colour}"></i>{html.escape(name)}</span>'
        for name, colour in entries
    ]
    if dashed:
        spans.append(f'<span><b aria-hidden="true">- -</b> {html.escape(dashed)}</span>')
    st.html(f'<div class="vehicle-key">{"".join(spans)}</div>')


def _sidebar(workspace: Workspace) -> None:
    st.logo(str(HERE / "logo.svg"), size="large", icon_image=str(HERE / "icon.svg"))
    with st.sidebar:
        link(HOME, "Home", workspace, _ICONS["Home"])
        for path in sorted((ROOT / "pages").glob("[0-9]*_*.py")):
            name = path.stem.split("_", 1)[1].replace("_", " ")
            link(f"pages/{path.name}", name, workspace, _ICONS.get(name, "article"))
        st.divider()
        st.caption("  \n".join(standing(workspace)))
        _choose_pictures(workspace)
        st.caption(
            "This page's address opens this very session, so whoever has it can change or stop"
            " things here; to show a result, send a snapshot's link instead."
        )


def _choose_pictures(workspace: Workspace) -> None:
    """As what a chart's button saves it."""

    def changed() -> None:
        workspace.pictures = st.session_state[charts.FORMAT]
        workspace.legends = st.session_state[charts.LEGEND]

    st.segmented_control(
        "Charts are saved as",
        charts.FORMATS,
        default=workspace.pictures,
        key=sync_widget(charts.FORMAT, workspace.pictures),
        on_change=changed,
        required=True,
        help="Point at a chart: the camera in its corner saves it as such a picture.",
    )
    st.toggle(
        "Legend in every chart",
        value=workspace.legends,
        key=sync_widget(charts.LEGEND, workspace.legends),
        on_change=changed,
        help="A saved picture then says by itself which colour is which vehicle.",
    )


def standing(workspace: Workspace) -> list[str]:
    """Where the session stands, a line a step."""
    recording, segment, job = workspace.recording, workspace.segment, workspace.job
    if workspace.snapshot:
        return snapshot_standing(workspace.snapshot) + _training_line(job)
    if recording is None:
        return ["No recording is open yet."]
    lines = [f"**Recording** {escape_markdown(recording.source)}"]
    if segment:
        lines.append(
            f"**Window** {segment.window}, vehicles"
            f" {segment.vehicles[0]}–{segment.vehicles[-1]}"
            + (f", Case {workspace.case}" if segment.followers > 1 else "")
        )
        if segment.excluded_regimes:
            lines.append(f"**Left out** of the law: {', '.join(segment.excluded_regimes)}")
    else:
        lines.append("**Window** cannot be used yet")
    return lines + _training_line(job)


def snapshot_standing(snapshot: Snapshot) -> list[str]:
    """The same of a snapshot."""
    info = snapshot.info
    return [
        f"**Snapshot** {escape_markdown(snapshot.name[:60] or snapshot.id)}",
        f"**Recording** {escape_markdown(info.source)}",
        f"**Window** {info.window}, vehicles {info.vehicles[0]}–{info.vehicles[-1]}",
    ]


def _training_line(job: Job | None) -> list[str]:
    return [f"**Training** {_STANDING[job.status]}"] if job else []


_STANDING = {
    Status.QUEUED: "waits for its turn",
    Status.RUNNING: "is running",
    Status.DONE: "is done",
    Status.STOPPED: "was stopped",
    Status.FAILED: "failed",
}
