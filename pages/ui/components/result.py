"""A result on a page: cards and curves on the first screen, then one table, and tabs.

`banner` and what is below it say of a restored result which one it is, and what would complete it.
"""

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

import msgspec
import streamlit as st

from accpinn.findings import capital
from accpinn.methods.estimate import History, Outcome, of_window
from accpinn.model.cthp import Parameters
from accpinn.model.registry import has_terms_of
from accpinn.results.documents import parameter_card
from accpinn.results.figures import training as figures
from accpinn.results.figures.comparison import forest
from accpinn.results.figures.recording import motion
from accpinn.results.figures.style import vehicle_colours
from accpinn.results.messages import estimate as words
from accpinn.results.messages import incidents, messages, summary
from accpinn.results.report import bundle
from accpinn.results.tables import estimates as tables
from accpinn.study.result import NO_XARRAY, Result, has_xarray
from pages.ui import reproduction
from pages.ui.components import frame, show
from pages.ui.components.show import bound, escape_markdown, pick, tabs
from pages.ui.session.resources import library, windows_in_car_following
from pages.ui.session.sessions import owner_mark
from pages.ui.session.workspace import Workspace
from pages.ui.snapshots.listing import title_of

MARKS = {True: ("blue", "check_circle"), False: ("orange", "cancel"), None: ("gray", "help")}
"""Colour and icon of a check's answer: the icons differ in shape."""
ANSWERS = {True: "yes", False: "no", None: "not known"}
BANDS = "Bands of α, β and τ: 90 % intervals by the likelihood, which the search maximises."
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
    info, estimate = result.info, result.estimate
    is_open = result.recording is workspace.recording
    is_same = is_open and info.vehicles == workspace.asked.vehicles
    truth = workspace.true_parameters if is_same else None
    _show_outcome(estimate.outcome)
    show_cards(result)
    if next_step:
        next_step()
    with st.container(horizontal=True, vertical_alignment="center"):
        follower = pick(workspace, info.labels[1:], f"{page}_follower")
        windows = [str(part.window) for part in result.infos]
        window = pick(workspace, windows, f"{page}_window", label="Window")
        _show_checks(result)
    _show_tracking(result, follower, window, f"{page}_tracking")
    views: dict[str, Callable[[], None]] = {
        "Numbers": lambda: _show_numbers(result, truth),
        "Errors": lambda: _show_errors(result, follower),
    }
    if history := result.history:
        views["Training"] = lambda: _show_history(result, history, truth, page)
    if estimate.windows is not None:
        views["Windows"] = lambda: _show_windows(workspace, result, follower)
    tabs(workspace, f"{page}_tabs", views | dict(more or {}) | {
        "Export": lambda: _show_export(result, page, snapshot),
    })  # fmt: skip


def show_cards(result: Result) -> None:
    """What is said first: what each car does, what is against it, and on hovering all of that."""
    fine = [trust.in_words for trust in result.trust if not trust.is_contradicted]
    with st.container(border=True, gap="xxsmall"):
        for card in words.cards(result, together=True):
            said = f"**{escape_markdown(card.lead)}**"
            if card.is_contradicted:
                ends = (text for text in fine if card.trust.endswith(text))
                against = escape_markdown(card.trust.removesuffix(next(ends, "")).strip())
                said += f"  \n:orange[:material/warning:] :small[{against}]"
            st.markdown(said, help=escape_markdown(card.trust))


def _show_numbers(result: Result, truth: Parameters | None) -> None:
    """The parameters, beside those that are printed where the paper took the same data."""
    info, estimate = result.info, result.estimate
    if not reproduction.show_table(result):
        colours = vehicle_colours(info.vehicles, tables.parameter_rows(info, estimate.case))
        show.table(tables.parameter_table(result), colours)
    level = f"{100 * (estimate.level or 0):.0f} % intervals"
    what = capital(words.about_point(estimate) or f"{level}, and that of a further window")
    st.caption(escape_markdown(f"{what}."), help=escape_markdown(words.about_estimate(result)))
    if truth:
        st.caption(escape_markdown(words.about_truth(truth, estimate)))


def _show_windows(workspace: Workspace, result: Result, follower: int) -> None:
    """The estimates of each window by itself, over the recording's time."""
    colour = vehicle_colours(result.info.vehicles)[follower + 1]
    if result.posterior:
        show.chart(forest(result, follower, colour), "windows_forest")
        st.caption(
            f"Time gap at {3.6 * result.estimate.stated_speed:.0f} km/h of each window alone. Line:"
            " all windows together, with the interval; outer band: of a further window."
        )
    _choose_windows(workspace)
    show.table(tables.windows_table(result, follower))


def _choose_windows(workspace: Workspace) -> None:
    """Windows switched off and on; the next training takes those that are on."""
    if not (workspace.recording and workspace.several_windows):
        return
    every = windows_in_car_following(workspace.recording, workspace.asked.vehicles)
    names = {window.start: str(window) for window in every}
    starts = [window.start for window in workspace.several_windows]

    def change(chosen: Sequence[float]) -> None:
        workspace.window_starts = (*chosen,) or None

    st.pills(
        "Windows of the next training", list(names), selection_mode="multi",
        format_func=names.__getitem__, **bound("windows_on", starts, change, default="default"),
    )  # fmt: skip


def _show_outcome(outcome: Outcome) -> None:
    """How a training ended that did not end by itself, above what it came to."""
    if outcome is Outcome.DIVERGED:
        st.error(outcome.value, icon=":material/error:")
    elif outcome is Outcome.STOPPED:
        st.warning(outcome.value, icon=":material/pause_circle:")


def _show_checks(result: Result) -> None:
    answers = summary.checks(result)
    failing = sum(check.passed is False for check in answers)
    colour, icon = MARKS[not failing]
    said = f"{failing} of {len(answers)} checks failed" if failing else "All checks passed"
    with st.popover(f":{colour}[:material/{icon}:] {said}", key="checks"):
        for check in answers:
            colour, icon = MARKS[check.passed]
            title = f"{check.title}: {ANSWERS[check.passed]}"
            st.markdown(f":{colour}[:material/{icon}:] **{title}**", help=check.meaning)
            if check.why:
                st.caption(show.bullets(check.why))


def _show_errors(result: Result, follower: int) -> None:
    """Errors, what happens in simulation, and what the estimate should be read with."""
    info, estimate = result.info, result.estimate
    table = tables.errors_table(result)
    show.table(table, vehicle_colours(info.vehicles))
    took = (
        f"{estimate.seconds:.1f} s"
        if estimate.seconds < 60
        else show.format_duration(estimate.seconds)
    )
    weights = f", {estimate.network_weights:,} network weights" * bool(estimate.network_weights)
    cache = " From the cache: this exact request was trained before." if estimate.cached else ""
    st.caption(
        "MAE: mean absolute error of space-gap p and speed v; of the method's own curves, and of"
        " the simulation behind the measured leader."
        f" {estimate.iterations:,} iterations in {took}{weights}.{cache}"
    )
    if events := incidents(result.evaluation, info):
        show.warnings(events, "the closed-loop simulation")
    show.messages(messages(result.weaknesses, info), "warning")
    show.messages(messages(result.findings, info))
    band = result.gap_band
    said = [summary.about_band(result)] if band else []
    if said := [*said, *summary.about_curves(result, follower, band)]:
        st.caption(escape_markdown(" ".join(said)))
    show.downloads(table, f"{Path(info.source).stem}_errors", "errors")


def _show_tracking(result: Result, follower: int, window: int, key: str) -> None:
    """One follower's curves in one window, with the band that the posterior predicts."""
    has_disturbance = "disturbance" in of_window(result.estimate.arrays, window)
    height = CURVES + 120 * has_disturbance
    show.chart(figures.tracking_of(result, follower, window, height=height), key)
    st.caption(escape_markdown(summary.about_tracking(result, window)))


def _show_history(result: Result, history: History, truth: Parameters | None, page: str) -> None:
    info, model = result.info, result.estimate.model
    has_truth = truth is not None and has_terms_of(model, truth)
    show.follower_key(info, has_truth, info.shares(result.estimate.case))
    if history.deviations is not None:
        st.caption(BANDS)
    show.charts([*figures.training_figures(history, info, model, truth).items()], page)


def _show_export(result: Result, page: str, snapshot: Callable[[], Result]) -> None:
    """The table of parameters, draws, the card, and all else in one file."""
    stem = Path(result.info.source).stem
    with st.container(horizontal=True):
        show.downloads(tables.parameter_table(result), f"{stem}_parameters", page)
        st.download_button(
            "Download all", lambda: bundle(snapshot()), f"{stem}_accpinn.zip", "application/zip",
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
