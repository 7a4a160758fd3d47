"""A result on a page: the answer and checks on the first screen, all else below and in tabs.

`banner` and those below it say of a restored result which one it is, and what would complete it.
"""

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

import streamlit as st

from accpinn.evaluation.closed_loop import simulated
from accpinn.inference.answer import HeterogeneousFollowers
from accpinn.inference.intervals import Uncertainty
from accpinn.methods.estimate import History, Outcome
from accpinn.methods.regression import Regression
from accpinn.model.cthp import Parameters, Trajectories
from accpinn.model.registry import CTHPS, has_terms_of
from accpinn.results.figures import training as figures
from accpinn.results.figures.comparison import forest
from accpinn.results.figures.recording import motion
from accpinn.results.figures.style import vehicle_colours
from accpinn.results.messages import answer as on_answer
from accpinn.results.messages import incidents, messages
from accpinn.results.messages import summary as words
from accpinn.results.report import bundle
from accpinn.results.tables import Table
from accpinn.results.tables import estimates as tables
from accpinn.results.tables.answer import answer_table, own_windows_table
from accpinn.results.tables.estimates import name_of
from accpinn.results.vehicles import known_vehicles
from accpinn.study.result import NO_XARRAY, Result, has_xarray
from pages.ui.components import frame, show
from pages.ui.components.show import bound, escape_markdown, pick, tabs
from pages.ui.session.resources import library, windows_in_car_following
from pages.ui.session.sessions import owner_mark
from pages.ui.session.workspace import Workspace
from pages.ui.snapshots.listing import title_of

MARKS = {True: ("blue", "check_circle"), False: ("orange", "cancel"), None: ("gray", "help")}
"""Colour and icon of a check's answer: the icons differ in shape."""
ANSWERS = {True: "yes", False: "no", None: "not known"}
BANDS = "Bands of α, β and τ: 90 % intervals by the evidence, which the training maximises."
APART = (
    "The answer's model may have terms beside α, β and τ (with an s₀, τ is smaller by s₀/v), and"
    " the answer counts how windows of many cars differ."
)
CURVES = 440
"""Height in pixels of the chart below the answer, without a panel for the disturbance."""


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
    info, fit = result.info, result.fit
    is_open = result.recording is workspace.recording
    is_same = is_open and info.vehicles == workspace.asked.vehicles
    truth = workspace.true_parameters if is_same else None
    has_answer = bool(result.segments or result.parts.answer)
    if has_answer:
        show_cards(result)
    if next_step:
        next_step()
    if has_answer:
        _show_answer(result, truth)
    _show_outcome(fit.outcome, has_answer)
    with st.container(horizontal=True, vertical_alignment="center"):
        name = name_of(fit, with_model=not has_answer)  # else the caption says it
        st.markdown(f"**{escape_markdown(name)}: the method's own estimate**")
        _show_checks(result)
        follower = pick(workspace, info.labels[1:], f"{page}_follower")
    if has_answer:
        st.caption(escape_markdown(words.about_own_estimate(result)))
    _show_tracking(result, follower, f"{page}_tracking")
    table = _parameter_table(result)
    views: dict[str, Callable[[], None]] = {"Fit": lambda: _show_fit(result, table, follower)}
    if history := fit.history:
        views["Training"] = lambda: _show_history(result, history, truth, page)
    if has_answer:
        views["Windows"] = lambda: _show_windows(workspace, result, follower)
    views["Comparison"] = lambda: _show_comparison(workspace, result, truth, page, follower)
    tabs(workspace, f"{page}_tabs", views | dict(more or {}) | {
        "Export": lambda: _show_export(result, table, page, snapshot),
    })  # fmt: skip


def show_cards(result: Result) -> None:
    """What is said first: the answer, and how far to trust it."""
    said = on_answer.cards(result.info, result.answer, known_vehicles(result), together=True)
    with st.container(border=True, gap="xxsmall"):
        for card in said:
            lead, trust = (escape_markdown(text) for text in (card.lead, card.trust))
            mark = ":orange[:material/warning:] " if card.is_contradicted else ""
            st.markdown(f"**{lead}**  \n{mark}:small[{trust}]")


def _show_answer(result: Result, truth: Parameters | None) -> None:
    """The answer as a table, and what to know of its windows."""
    info, answer, case = result.info, result.answer, result.fit.case
    colours = vehicle_colours(info.vehicles, tables.parameter_rows(info, case))
    show.table(answer_table(info, answer, case), colours)
    found = [f for f in answer.findings if not isinstance(f, HeterogeneousFollowers)]
    about = (on_answer.about_answer(answer), *messages(found, info))
    st.caption(escape_markdown(" ".join(about)))
    if truth:
        st.caption(escape_markdown(on_answer.about_truth(truth, answer)))


def _show_windows(workspace: Workspace, result: Result, follower: int) -> None:
    """The estimates of each window by itself, of the answer's model, over the recording's time."""
    colour = vehicle_colours(result.info.vehicles)[follower + 1]
    show.chart(forest(result.infos, result.answer, follower, colour), "windows_forest")
    st.caption(
        f"Time gap at {3.6 * result.answer.stated_speed:.0f} km/h of each window alone with its"
        " interval. Line and inner band: the answer, the vehicle's typical value. Outer band: the"
        " interval for a further window."
    )
    _choose_windows(workspace)
    show.table(own_windows_table(result.infos, result.answer, follower))
    st.caption(
        "Each window alone, and the answer: the vehicle's typical value over windows. It"
        " also takes into account how windows of many other cars differ. The fewer windows there"
        " are, the wider it is and the more it is drawn towards those cars."
    )


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


def _about_estimates(result: Result) -> str:
    """What the method's own estimates are, and their intervals if the training is finished."""
    said = f"Parameters by {escape_markdown(name_of(result.fit))}"
    if label := on_answer.papers_estimate(result.fit):
        said += f": **{escape_markdown(label)}**"
    if not result.is_finished:
        return f"{said}. The training did not converge, so they have no intervals or probabilities."
    outside = "" if result.uncertainty.inside.all() else "; an estimate with \\* lies outside"
    return (
        f"{said}. In brackets: the {100 * result.uncertainty.level:.0f} % interval of the values"
        f" consistent with the data, the same for every method{outside}. Probability: the share of"
        " these values that is string stable."
    )


def _show_outcome(outcome: Outcome, has_answer: bool) -> None:
    """How a training ended that did not end by itself, above what it came to."""
    if outcome is Outcome.DIVERGED:
        st.error(outcome.value, icon=":material/error:")
    elif outcome is Outcome.STOPPED:
        beside = " The answer above does not depend on them." if has_answer else ""
        st.warning(outcome.value + beside, icon=":material/pause_circle:")


def _show_checks(result: Result) -> None:
    answers = words.checks(result)
    failing = [check.title.lower() for check in answers if check.passed is False]
    colour, icon = MARKS[False if failing else True]
    failed = f"{len(failing)} of {len(answers)} checks not passed: {', '.join(failing)}"
    said = failed if failing else "All checks passed"
    with st.popover(f":{colour}[:material/{icon}:] {said}", key="checks"):
        for check in answers:
            colour, icon = MARKS[check.passed]
            title = f"{check.title}: {ANSWERS[check.passed]}"
            st.markdown(f":{colour}[:material/{icon}:] **{title}**", help=check.meaning)
            if check.why:
                st.caption(show.bullets(check.why))


def _parameter_table(result: Result) -> Table:
    table = tables.parameter_table(result, with_intervals=result.is_finished)
    rows = tables.row_vehicles(result.info, result.fit.case)
    return table.coloured(vehicle_colours(result.info.vehicles, rows))


def _show_fit(result: Result, table: Table, follower: int) -> None:
    """Errors, what happens in simulation, and what the intervals take for granted."""
    info, fit = result.info, result.fit
    took = f"{fit.seconds:.1f} s" if fit.seconds < 60 else show.format_duration(fit.seconds)
    cost = f"{fit.iterations:,} iterations in {took}, {fit.network_weights:,} network weights."
    cache = " From the cache: this exact request was trained before." if fit.cached else ""
    show.table(table)
    st.caption(
        f"{_about_estimates(result)} Surrogate fit: error of the network's own curves, as in the"
        " paper's tables. Closed-loop simulation: error of the simulation with the learned"
        " parameters, with only the leader's speed given. MAE: mean absolute error of space-gap p"
        f" and speed v. {cost}{cache}"
    )
    if events := incidents(result.evaluation, info):
        show.warnings(events, "the closed-loop simulation")
    if result.evaluation.findings:
        st.caption("The simulation continues, and the closed-loop errors include what follows.")
    show.messages(messages(result.weaknesses, info), "warning")
    show.messages(messages(fit.findings, info))
    band = result.gap_band
    said = [words.about_band(result)] if band else []
    if said := [*said, *words.about_curves(result, follower, band)]:
        st.caption(escape_markdown(" ".join(said)))


def _show_comparison(
    workspace: Workspace, result: Result, truth: Parameters | None, page: str, follower: int
) -> None:
    """The same parameters by least squares and maximum likelihood, and other forms of the model."""
    info, fit, segment, uncertainty = result.info, result.fit, result.segment, result.uncertainty
    own = name_of(fit).partition(" (")[0]
    estimates: dict[str, tuple[Parameters, Uncertainty | None]]
    estimates = {own: (fit.parameters, uncertainty)}
    if result.segments:
        solved = Regression.of_windows(result.segments).solve(fit.case)
        estimates["Least squares"] = solved.parameters, uncertainty
    estimates["Maximum likelihood"] = uncertainty.centre, uncertainty
    if (known := result.known_answer) and known.model in CTHPS:
        estimates["Answer"] = known.parameters, known.uncertainty
    if truth and has_terms_of(fit.model, truth):
        estimates["Truth"] = truth, None
    table = tables.comparison_table(result, estimates)
    rows = [number for number in tables.parameter_rows(info, fit.case) for _ in estimates]
    show.table(table, vehicle_colours(info.vehicles, rows))
    is_likely = fit.config.get("preset") == "calibrated"
    biased = "least squares" if is_likely else f"least squares and the loss of {own}"
    st.caption(
        f"Disturbances that last for seconds bias {biased}; maximum likelihood estimates the"
        " disturbances together with the parameters, and the intervals are around it."
        + (f" {own} maximises the evidence, a likelihood of its own." if is_likely else "")
        + (f" {APART}" if "Answer" in estimates else "")
    )
    show.downloads(table, f"{Path(info.source).stem}_comparison", f"{page}_comparison")
    is_own = segment is not None and (segment == workspace.segment or result is workspace.result)
    adequacy = workspace.adequacy(info) if is_own else result.parts.adequacy
    if adequacy is None and is_own:
        label = "Compare with other forms of the model"
        if st.button(label, key=f"{page}_forms", icon=":material/rule:"):
            with st.spinner("This takes some seconds."):
                _ = result.adequacy
            st.rerun()
    st.caption(words.conditional(result, adequacy))
    if adequacy and adequacy.forms:
        show.table(tables.model_form_table(info, adequacy.forms, follower))
        show.messages(messages(adequacy.findings, info), icon="lightbulb")


def _show_tracking(result: Result, follower: int, key: str) -> None:
    """One follower's curves, with the band that the posterior predicts where the data are here."""
    fit, segment = result.fit, result.segment
    if segment is None and fit.surrogate is None:
        st.caption("The curves need the recording, which is not part of the snapshot.")
        return
    own = "network" if fit.method == "pinn" else name_of(fit)
    disturbance = fit.arrays.get("disturbance")
    figure = figures.tracking(
        segment or result.info, follower, fit.surrogate, result.simulated, own,
        with_error=True, predicted=result.gap_band, disturbance=disturbance,
        answered=_answered(result, follower),
        height=CURVES + (0 if disturbance is None else 120),
    )  # fmt: skip
    show.chart(figure, key)


def _answered(result: Result, follower: int) -> Trajectories | None:
    """The drive of a follower by the answer, behind the measured vehicle ahead."""
    answer, segment = result.known_answer, result.segment
    if answer is None or segment is None:
        return None
    return simulated(segment.pair(follower), answer.model, answer.parameters[[follower]])


def _show_history(result: Result, history: History, truth: Parameters | None, page: str) -> None:
    info, model = result.info, result.fit.model
    has_truth = truth is not None and has_terms_of(model, truth)
    show.follower_key(info, has_truth, info.shares(result.fit.case))
    if history.deviations is not None:
        st.caption(
            f"{BANDS} The search starts at the estimates of maximum likelihood; the last point is"
            " its result, with the loss of the network that is drawn for it; before, that of"
            " splines."
        )
    show.charts([*figures.training_figures(history, info, model, truth).items()], page)


def _show_export(result: Result, table: Table, page: str, snapshot: Callable[[], Result]) -> None:
    """The table of the tab Fit, draws, and all else in one file."""
    stem = Path(result.info.source).stem
    with st.container(horizontal=True):
        show.downloads(table, f"{stem}_parameters", page)
        st.download_button(
            "Download all", lambda: bundle(snapshot()), f"{stem}_accpinn.zip", "application/zip",
            key=f"{page}_all", on_click="ignore", icon=":material/folder_zip:",
            help="One zip file: the report, the snapshot, every table as CSV and LaTeX, the"
            " training's history and the curves as numbers. Charts are saved by the camera in their"
            " corner.",
        )  # fmt: skip
        st.download_button(
            "Posterior samples (.nc)", result.to_netcdf, f"{stem}_draws.nc", "application/x-netcdf",
            key=f"{page}_draws", on_click="ignore", icon=":material/scatter_plot:",
            disabled=not has_xarray(),
            help="The answer's posterior draws for xarray and ArviZ: typical value, further window"
            " and each window alone." if has_xarray() else NO_XARRAY,
        )  # fmt: skip


def show_intervals(result: Result, more: str) -> None:
    """Maximum-likelihood estimates with intervals; ``more`` ends the caption."""
    info, case = result.info, result.fit.case
    colours = vehicle_colours(info.vehicles, tables.parameter_rows(info, case))
    show.table(tables.intervals_table(result), colours)
    st.caption(
        "Maximum likelihood estimates the disturbances together with the parameters; in brackets,"
        " the values consistent with the data. Probability of string stability: the share of"
        f" parameter sets consistent with the data (posterior samples) that are stable. {more}"
    )


# A restored result


def banner(workspace: Workspace) -> None:
    """Which restored result a page shows, and what would complete it."""
    restored = workspace.restored
    if restored is None or not (restored.id or restored is workspace.result):
        return
    if workspace.result is not restored:
        state = "the training is new, on the same window."
    elif workspace.training and workspace.training.is_active:
        state = "it stays until the training that runs has a result."
    elif workspace.recording:
        state = "its recording is open, so everything is complete."
    elif workspace.segment:
        state = "its data came with it."
    else:
        state = "it came without its data."
    kind = "From the snapshot" if restored.id else "An earlier run"
    name = escape_markdown(title_of(restored))
    if workspace.training and workspace.training.is_active:
        st.caption(f"{kind} **{name}**; {state}")
    else:
        st.info(f"{kind} **{name}**; {state}", icon=":material/inventory_2:")

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


def recording_needed(workspace: Workspace, what: str, here: bool = False) -> None:
    """Which recording would complete a page without data, which may be opened ``here``."""
    if workspace.segment or workspace.restored is None:
        return
    source = workspace.restored.analysis.source
    st.warning(
        f"{what} the recording, which is not part of the snapshot. It is"
        f" **{escape_markdown(source.name)}**, SHA-256 `{source.sha256 or 'not known'}`. Open that"
        f" file {'below' if here else 'on the Data page'}, and the window is restored.",
        icon=":material/database:",
    )
    if not here:
        frame.link(frame.DATA, "Open the recording on Data", workspace)


def show_data(workspace: Workspace) -> None:
    """The window's own curves, if they came along; else which recording has them."""
    banner(workspace)
    segment = workspace.segment
    if segment is None:
        recording_needed(workspace, "Speeds and gaps are in", here=True)
        return
    st.caption("These curves are the snapshot's; the whole recording is not part of it.")
    show.key(zip(segment.labels, vehicle_colours(segment.vehicles), strict=True))
    show.chart(motion(segment.info, segment.measured), "snapshots_data")
