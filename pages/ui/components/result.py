"""A result on a page: strip and curves on the first screen, then one table, and tabs.

`banner` and what is below it say of a restored result which one it is, and what would complete it.
"""

from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from pathlib import Path

import msgspec
import plotly.graph_objects as go
import streamlit as st

from accpinn.errors import AccpinnError, SnapshotError
from accpinn.findings import capital
from accpinn.methods.estimate import Estimate, Outcome
from accpinn.model.cthp import Parameters
from accpinn.model.registry import has_terms_of
from accpinn.results import reproduction as paper
from accpinn.results.documents import parameter_card
from accpinn.results.figures import next_drive as drive_figures
from accpinn.results.figures import training as figures
from accpinn.results.figures.recording import motion
from accpinn.results.figures.style import vehicle_colours
from accpinn.results.messages import estimate as words
from accpinn.results.messages import incidents, messages
from accpinn.results.messages.next_drive import ABOUT_DRIVE, drive_in_words
from accpinn.results.messages.summary import unfinished
from accpinn.results.naming import about_point
from accpinn.results.report import bundle
from accpinn.results.strip import strip_of
from accpinn.results.tables import Table
from accpinn.results.tables import estimates as tables
from accpinn.results.tables.next_drive import drive_table
from accpinn.study.description import Description, describe
from accpinn.study.next_drive import can_propose, next_drive
from accpinn.study.result import NO_XARRAY, Result, has_xarray
from pages.ui.components import browser, frame, show
from pages.ui.components.show import bound, escape_markdown, pick, tabs
from pages.ui.components.strip import show_strip
from pages.ui.session.resources import library, windows_in_car_following
from pages.ui.session.users import owner_mark
from pages.ui.session.workspace import Workspace
from pages.ui.snapshots.listing import title_of

MARKS = {True: ("blue", "check_circle"), False: ("orange", "cancel"), None: ("gray", "help")}
"""Colour and icon of a check's answer: the icons differ in shape."""
ANSWERS = {True: "yes", False: "no", None: "not known"}
BANDS = "Bands of α, β and τ: 90 % intervals by the likelihood, which the search maximises."
THEATRE = (1.45, 1.0)
"""Relative widths of the curves of an estimation and of its course."""
CURVES = 400
"""Height in pixels of the chart of the curves, without a panel for the disturbance."""
CARD = "Parameter card"
CARD_HELP = (
    "The parameters with their intervals and where they come from, as JSON; no recorded series."
)


def show_result(
    workspace: Workspace,
    result: Result,
    page: str,
    snapshot: Callable[[], Result],
    next_step: Callable[[], None] | None = None,
    more: Mapping[str, Callable[[], None]] | None = None,
) -> None:
    """The first screen of a result, and its tabs.

    ``snapshot`` makes the result as a snapshot, once it is asked for; ``next_step`` draws what
    leads on; ``more`` are further tabs by title.
    """
    truth = _true_parameters(workspace, result)
    description = describe(result)
    estimate = description.estimate
    info = description.info
    sheets = tables.tables_of(description)
    parameters = sheets["parameters"]
    checks = words.checks(description)
    about = words.about_estimate(description)
    true = words.about_truth(truth, estimate) if truth else ""
    _show_outcome(estimate)
    strip = strip_of(description.vehicles, description)
    show_strip(
        strip, lambda: _show_cards(description), next_step, page,
        workspace.keep(f"{page}_follower"),
    )  # fmt: skip
    with st.container(horizontal=True, vertical_alignment="center"):
        follower = pick(workspace, info.labels[1:], f"{page}_follower")
        windows = [str(part.window) for part in description.infos]
        window = pick(workspace, windows, f"{page}_window", label="Window")
        _show_checks(checks)
    curves = figures.curves_of(result, follower, window)
    drive = figures.drive(curves, height=CURVES + 120 * (curves.disturbance is not None))
    colours = vehicle_colours(info.vehicles, [each.number for each in description.followers])
    show.chart(drive, f"{page}_tracking")
    show.caption(curves.about)
    views: dict[str, Callable[[], None]] = {
        "Numbers": lambda: _show_numbers(
            result, description, parameters.coloured(colours), about, true
        ),
        "Errors": lambda: _show_errors(result, description, sheets["errors"], follower),
    }
    if result.history:
        views["Training"] = lambda: _show_course(workspace, result, truth, page, follower, window)
    if description.follower(follower).windows:
        views["Windows"] = lambda: _show_windows(workspace, description, follower)
    if can_propose(result):
        views["Next drive"] = lambda: _show_next_drive(workspace, result, follower, page)
    tabs(workspace, f"{page}_tabs", views | dict(more or {}) | {
        "Export": lambda: _show_export(result, parameters, page, snapshot),
    })  # fmt: skip


def _show_next_drive(workspace: Workspace, result: Result, follower: int, page: str) -> None:
    """The drive of the car ahead that would narrow the follower's intervals most."""
    key = f"{page}_next_drive"
    if not workspace.choices.get(key):
        if st.button(
            "Propose a drive", icon=":material/route:", key=key,
            help="The 120 s of the car ahead, between 15 and 33 m/s, that tell most of this"
            " follower's parameters.",
        ):  # fmt: skip
            workspace.choices[key] = True
            st.rerun()
        return
    try:
        proposed = next_drive(result, vehicle=result.info.vehicles[follower + 1])
    except AccpinnError as fault:
        show.messages(str(fault))
        return
    st.markdown(f"**{escape_markdown(drive_in_words(proposed))}**")
    left, right = st.columns((1.3, 1), gap="small")
    with left:
        show.chart(drive_figures.drive_speed(proposed), f"{key}_speed")
    with right:
        show.chart(drive_figures.drive_narrowing(proposed), f"{key}_narrowing")
    show.table(drive_table(proposed))
    show.caption("Expected intervals.", ABOUT_DRIVE)
    st.download_button(
        "Save the drive", proposed.to_csv(), "drive.csv", "text/csv", key=f"{key}_csv",
        on_click="ignore", icon=":material/download:",
    )  # fmt: skip


def _true_parameters(workspace: Workspace, result: Result) -> Parameters | None:
    """Those that the recording of a result was made with, where it is open and synthetic."""
    is_open = result.recording is workspace.recording
    is_same = is_open and result.info.vehicles == workspace.selection.vehicles
    return workspace.true_parameters if is_same else None


def show_estimate(result: Result) -> None:
    """The strip of a result, with its sentences behind Details."""
    description = describe(result)
    strip = strip_of(description.vehicles, description)
    show_strip(strip, lambda: _show_cards(description))


def _show_cards(description: Description) -> None:
    """What each car does, what is against it, and how far its windows agree."""
    for card in words.cards(description, together=True):
        mark = ":orange[:material/warning:] " * card.is_contradicted
        st.markdown(f"**{escape_markdown(card.lead)}**  \n{mark}{escape_markdown(card.trust)}")


def _show_numbers(
    result: Result, description: Description, table: Table, about: str, true: str
) -> None:
    """The parameters, beside those that are printed where the paper took the same data."""
    level = description.estimate.level
    if beside := paper.beside_printed(result):
        item, printed, line = beside
        st.markdown(f"**{item.title}** · {escape_markdown(item.subject)}")
        show.table(printed)
        st.caption(escape_markdown(line), help=show.bullets(paper.inconsistencies()))
    else:
        show.table(table)
    intervals = f"{100 * (level or 0):.0f} % intervals, and that of a further window"
    point = about_point(description.estimate)
    show.caption(f"{capital(point or intervals)}.", about)
    if true:
        show.caption(true)


def _show_windows(workspace: Workspace, description: Description, follower: int) -> None:
    """The estimates of each window by itself, over the recording's time."""
    table, estimate = tables.windows_table(description, follower), description.estimate
    if estimate.posterior:
        forest = figures.forest(description, follower)
        show.chart(forest, "windows_forest")
        st.caption(
            f"Time gap at {3.6 * estimate.stated_speed:.0f} km/h of each window alone. Line: all"
            " windows together, with the interval; outer band: of a further window."
        )
    _choose_windows(workspace)
    show.table(table)


def _choose_windows(workspace: Workspace) -> None:
    """Windows switched off and on; the next training takes those that are on."""
    if not (workspace.recording and workspace.several_windows):
        return
    every = windows_in_car_following(workspace.recording, workspace.selection.vehicles)
    names = {window.start: str(window) for window in every}
    starts = [window.start for window in workspace.several_windows]

    def change(chosen: Sequence[float]) -> None:
        workspace.window_starts = (*chosen,) or None

    st.pills(
        "Windows of the next training", list(names), selection_mode="multi",
        format_func=names.__getitem__, **bound("windows_on", starts, change, default="default"),
    )  # fmt: skip


def _show_outcome(estimate: Estimate) -> None:
    """How a training ended that did not end by itself, above what it came to."""
    if estimate.outcome is Outcome.DIVERGED:
        st.error(estimate.outcome.value, icon=":material/error:")
    show.messages(unfinished(estimate), "warning", "pause_circle")


def _show_checks(checks: Sequence[words.Check]) -> None:
    failing = sum(check.passed is False for check in checks)
    colour, icon = MARKS[not failing]
    title = f"{failing} of {len(checks)} checks failed" if failing else "All checks passed"
    about = "All cars together, every window: whether the estimate as a whole can be relied on."
    with st.popover(f":{colour}[:material/{icon}:] {title}", key="checks", help=about):
        for check in checks:
            colour, icon = MARKS[check.passed]
            title = f"{check.title}: {ANSWERS[check.passed]}"
            st.markdown(f":{colour}[:material/{icon}:] **{title}**", help=check.meaning)
            if check.why:
                st.caption(show.bullets(check.why))


def _show_errors(result: Result, description: Description, table: Table, follower: int) -> None:
    """Errors, what happens in simulation, and what the estimate should be read with."""
    estimate, info, band = description.estimate, description.info, result.gap_band
    about = [words.about_band(estimate.model)] if band else []
    about += words.about_curves(description, follower, band)
    seconds = estimate.seconds
    took = f"{seconds:.1f} s" if seconds < 60 else show.format_duration(seconds)
    weights = f", {estimate.network_weights:,} network weights" * bool(estimate.network_weights)
    cache = " From the cache: this exact request was trained before." if estimate.cached else ""
    show.table(table, vehicle_colours(info.vehicles))
    st.caption(
        "MAE: mean absolute error of space-gap p and speed v; of the method's own curves, and of"
        " the simulation behind the measured leader."
        f" {estimate.iterations:,} iterations in {took}{weights}.{cache}"
    )
    show.warnings(incidents(result.evaluation, info), "the closed-loop simulation")
    show.messages(messages(result.weaknesses, info), "warning")
    show.messages(messages(result.findings, info))
    if about:
        show.caption(" ".join(about))
    show.downloads(table, f"{Path(info.source).stem}_errors", "errors")


def _show_course(
    workspace: Workspace,
    result: Result,
    truth: Parameters | None,
    page: str,
    follower: int,
    window: int,
) -> None:
    """The course of the estimation, which a slider goes through."""
    history, info, estimate = result.history, result.info, result.estimate
    assert history is not None
    has_truth = truth is not None and has_terms_of(estimate.model, truth)
    show.follower_key(info, has_truth, info.shares(estimate.case))
    at = figures.moments_of(history)

    def scrub() -> None:
        """Draw the slider, and both charts at its iteration."""
        named = {int(history.iteration[k]): k for k in at}
        key = f"{page}_moment_{result.analysis.key[:8]}"
        chosen = workspace.choices.get(key, [*named][-1])
        chosen = chosen if chosen in named else [*named][-1]
        if len(named) > 1:
            st.select_slider(
                "Iteration", [*named], format_func=lambda iteration: f"{iteration:,}",
                help="The drive simulated by the parameters of this iteration.",
                **bound(key, chosen, workspace.keep(key)),
            )  # fmt: skip
        theatre(
            figures.tracking_at(result, follower, window, named[chosen]),
            figures.course(history, info, estimate.model, truth, moment=named[chosen]),
            f"{page}_course",
        )

    st.fragment(scrub)()
    if history.deviations is not None:
        st.caption(BANDS)


def theatre(curves: go.Figure, course: go.Figure | None, key: str) -> None:
    """The curves of an estimation beside the course of its loss and parameters."""
    with st.container(key=f"theatre_of_{key}"):
        left, right = st.columns(THEATRE, gap="small")
        with left:
            show.chart(curves, f"{key}_curves")
        if course:
            with right:
                show.chart(course, key)
        browser.holder()(key=f"{key}_held", height=0)


def _show_export(result: Result, table: Table, page: str, snapshot: Callable[[], Result]) -> None:
    """The table of parameters, draws, the card, and all else in one file."""
    stem = Path(result.info.source).stem

    def everything() -> bytes:
        """Make the file with everything, its report verified as the snapshot was here."""
        written, checked = snapshot(), None
        with suppress(SnapshotError):  # of a result that is not kept here
            checked = library().verification(written.id)
        return bundle(written, checked)

    with st.container(horizontal=True):
        show.downloads(table, f"{stem}_parameters", page)
        st.download_button(
            "Download all", everything, f"{stem}_accpinn.zip", "application/zip",
            key=f"{page}_all", on_click="ignore", icon=":material/folder_zip:",
            help="One zip file: the report, the snapshot, every table as CSV and LaTeX, the"
            " training's history and the curves as numbers. Charts are saved by the camera in their"
            " corner.",
        )  # fmt: skip
        st.download_button(
            CARD, lambda: msgspec.json.encode(parameter_card(snapshot())), f"{stem}_card.json",
            "application/json", key=f"{page}_card", on_click="ignore", icon=":material/badge:",
            help=CARD_HELP,
        )  # fmt: skip
        if result.posterior:
            st.download_button(
                "Posterior samples (.nc)", result.to_netcdf, f"{stem}_draws.nc",
                "application/x-netcdf", key=f"{page}_draws", on_click="ignore",
                icon=":material/scatter_plot:", disabled=not has_xarray(),
                help="Posterior draws for xarray and ArviZ: typical value, further window and each"
                " window alone." if has_xarray() else NO_XARRAY,
            )  # fmt: skip


# A restored result


def banner(workspace: Workspace) -> None:
    """Which restored result a page shows, and what would complete it."""
    restored = workspace.restored
    if restored is None or not (restored.id or restored is workspace.result):
        return
    is_running = bool(workspace.training and workspace.training.is_active)
    if workspace.result is not restored:
        state = "the training is new, on the same window."
    elif is_running:
        state = "it stays until the training that runs has a result."
    elif workspace.recording:
        state = "its recording is open, so everything is complete."
    else:
        state = "its windows' data came with it."
    kind = "From the snapshot" if restored.id else "An earlier run"
    said = f"{kind} **{escape_markdown(title_of(restored))}**; {state}"
    if is_running:
        st.caption(said)
    else:
        st.info(said, icon=":material/inventory_2:")

    def keep() -> None:
        library().add(restored, owner_mark(workspace.id))

    if restored.id and not library().has(restored.id):
        show.messages(
            "This snapshot was deleted from the server and lasts only as long as this session;"
            " keep it again, and its link works again.",
            "warning",
            "delete",
        )
        st.button("Keep it again", key="snapshots_keep", on_click=keep)


def recording_needed(workspace: Workspace, what: str) -> None:
    """Which recording a page asks for where only the data of its windows are at hand."""
    if workspace.recording or workspace.restored is None:
        return
    source = workspace.restored.analysis.source
    st.warning(
        f"{what} the whole recording, of which the snapshot has only the windows:"
        f" **{escape_markdown(source.name)}**, SHA-256 `{source.sha256 or 'not known'}`.",
        icon=":material/database:",
    )
    frame.link(frame.DATA, "Open the recording on Data", workspace)


def show_data(workspace: Workspace) -> None:
    """The curves of a restored result's first window."""
    banner(workspace)
    if segment := workspace.segment:
        st.caption("These curves are the snapshot's; the whole recording is not part of it.")
        show.key(zip(segment.labels, vehicle_colours(segment.vehicles), strict=True))
        show.chart(motion(segment.info, segment.measured), "snapshots_data")
