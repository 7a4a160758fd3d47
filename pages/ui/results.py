"""A result on a page: of the session's training, or as a snapshot holds it."""

from collections.abc import Mapping, Sequence
from itertools import groupby
from pathlib import Path

import streamlit as st

from accpinn.evaluation.closed_loop import (
    ClosedLoopFinding,
    TrackingErrors,
    closed_loop,
    closed_loop_errors,
    closed_loop_findings,
    surrogate_errors,
)
from accpinn.evaluation.whiteness import Whiteness, whiteness
from accpinn.inference.identifiability import narrower_intervals, weakly_identified
from accpinn.inference.intervals import Uncertainty
from accpinn.inference.model_adequacy import Adequacy
from accpinn.inference.prediction import gap_band
from accpinn.methods import least_squares
from accpinn.methods.fit import Fit, History, Outcome, headway_findings
from accpinn.methods.maximum_likelihood import disturbance_sizes
from accpinn.model.cthp import Case, Parameters, Trajectories
from accpinn.results.checks import Check, CheckName, checks
from accpinn.results.figures import training as figures
from accpinn.results.figures.recording import preview
from accpinn.results.messages import messages
from accpinn.results.messages.checks import MEANING, failing_of, label_of
from accpinn.results.messages.methods import outcome_message
from accpinn.results.messages.reliability import BAND, conditional
from accpinn.results.snapshot import Snapshot
from accpinn.results.tables import estimates as tables
from accpinn.results.tables.estimates import name_of
from accpinn.segment.quality import Quality, assess_quality
from accpinn.segment.segment import Segment, SegmentInfo
from accpinn.tasks.task import Task
from pages.ui.components import frame, show
from pages.ui.components.show import escape_markdown
from pages.ui.components.widgets import pick_follower
from pages.ui.session.resources import library
from pages.ui.session.workspace import Workspace

MARKS = {True: ("blue", "check_circle"), False: ("orange", "cancel"), None: ("gray", "help")}
"""Colour and icon of a check's answer: the icons differ in shape."""
FIRST_DRAWING = 1.0
"""Seconds of training before the first curves: a short one would be slowed by drawing it."""


def show_training(training: Task[Fit], truth: Parameters | None, running: bool) -> None:
    """Loss terms and parameters over iterations.

    Args:
        training: whose history is shown as far as it is known.
        truth: the true parameters, where they are known.
        running: nothing is drawn of the first moments.
    """
    history, request = training.history(), training.request
    if history is None or request is None:
        return
    if not running:
        st.subheader("Training", anchor=False)
    if not running or history.seconds[-1] > FIRST_DRAWING:
        _show_history(history, request.segment.info, "train", truth)
        st.caption(
            "Training minimises the loss Ψ, the sum of its terms: Ψ_D, the distance of the"
            " network's curves from the data, and Ψ_F, the residuals of the model's equations."
        )


def _show_history(
    history: History, info: SegmentInfo, page: str, truth: Parameters | None = None
) -> None:
    """Loss terms and parameters over iterations."""
    sets = history.parameters.values.shape[1]
    show.vehicle_key(info, with_truth=bool(truth), shared=sets < info.followers)
    loss, *parameters = st.columns(4)
    with loss:
        show.chart(figures.loss_history(history), f"{page}_loss")
    for which, column in enumerate(parameters):
        with column:
            figure = figures.parameter_history(history, which, info, truth)
            show.chart(figure, f"{page}_parameter_{which}")


def show_result(workspace: Workspace) -> None:
    """Everything about the session's training, once it has a fit."""
    fit, segment = workspace.fit, workspace.segment
    if fit is None or segment is None:
        return
    workspace.keep_run()
    driven = closed_loop(segment, fit)
    errors = surrogate_errors(segment, fit), closed_loop_errors(segment, fit)
    _show_fit(
        segment.info, fit, assess_quality(segment), errors, closed_loop_findings(segment, driven),
        workspace.uncertainty(), whiteness(segment, fit), "train",
    )  # fmt: skip
    _show_limits(workspace, segment.info, "train")
    solved, truth = least_squares.fit(segment, fit.case).parameters, workspace.true_parameters
    estimates = {"PiNN": fit.parameters, "Least squares": solved}
    if uncertainty := workspace.uncertainty():
        estimates["Maximum likelihood"] = uncertainty.centre
    estimates |= {"Truth": truth} if truth else {}
    st.subheader("Comparison with least squares and maximum likelihood", anchor=False)
    colours = show.vehicle_colours(segment, tables.parameter_rows(segment.info, fit.case))
    table = tables.comparison_table(segment.info, estimates, fit.case, workspace.uncertainty())
    show.table(table, colours)
    st.subheader("Network against data", anchor=False)
    follower = pick_follower(segment, "train_follower")
    _show_tracking(workspace, segment, follower, fit, driven, "network", "train_tracking")


def _show_fit(
    info: SegmentInfo,
    fit: Fit,
    quality: Quality,
    errors: tuple[TrackingErrors | None, TrackingErrors | None],
    events: Sequence[ClosedLoopFinding] | None,
    uncertainty: Uncertainty | None,
    residual: Whiteness | None,
    page: str,
) -> None:
    """Checks of a fit, parameters with intervals, errors (surrogate, simulation), and its limits.

    Args:
        info: of the segment.
        fit: its result.
        quality: of the segment.
        errors: surrogate fit and closed-loop simulation.
        events: of the closed-loop simulation; None where that is not known.
        uncertainty: of the parameters, if it is known.
        residual: of the model, if it is known.
        page: begins the keys of widgets.
    """
    took = f"{fit.seconds:.1f} s" if fit.seconds < 60 else show.format_duration(fit.seconds)
    cost = f"{fit.iterations:,} iterations in {took}, {fit.network_weights:,} network weights."
    cache = " From the cache: this exact request was trained before." if fit.cached else ""
    if fit.outcome is Outcome.DIVERGED:
        st.error(outcome_message(fit), icon=":material/error:")
    elif fit.outcome is Outcome.STOPPED:
        st.warning(outcome_message(fit), icon=":material/pause_circle:")
    _show_checks(info, checks(info, fit, uncertainty, events, residual), {
        "converged": (outcome_message(fit),),
        "inside": messages(uncertainty.findings if uncertainty else (), info),
        "identified": messages(headway_findings(info.vehicles, fit.parameters), info),
        "collision-free": messages(events or (), info),
        "explained": messages(residual.findings if residual else (), info),
    })  # fmt: skip
    st.caption(f"{cost}{cache}")
    table = tables.parameter_table(info, fit, quality, *errors, uncertainty)
    show.table(table, show.vehicle_colours(info, tables.row_vehicles(info, fit.case)))
    st.caption(
        "Surrogate fit: error of the network's own curves, as in the paper's tables. Closed-loop"
        " simulation: error of the simulation with the learned parameters, with only the leader's"
        " speed given. MAE: mean absolute error of space-gap p and speed v. Interval: the values"
        " consistent with the data, with disturbances that last for seconds, as on a road."
        " Probability of string stability: the share of such parameter sets (posterior samples)"
        " that are string stable."
    )
    after = "The simulation continues, and the closed-loop errors include what follows."
    show.messages(messages(events or (), info), "warning", "car_crash", after)
    findings = (*fit.findings, *headway_findings(info.vehicles, fit.parameters))
    show.messages(messages(findings, info))
    show.downloads(table, f"{Path(info.source).stem}_parameters", page)


def _show_checks(
    info: SegmentInfo,
    found: Sequence[Check],
    evidence: Mapping[CheckName, Sequence[str]],
) -> None:
    """A button for each check, with its answer; it opens what the answer rests on."""
    with st.container(horizontal=True):
        for name, each in groupby(found, lambda check: check.name):
            group = [*each]
            answers = {check.passed for check in group}
            worst = next(answer for answer in (False, None, True) if answer in answers)
            colour, icon = MARKS[worst]
            with st.popover(f":{colour}[:material/{icon}:] {label_of(group)}"):
                st.markdown(escape_markdown(MEANING[name]))
                failing = [said for check in group if (said := failing_of(check, info))]
                if reasons := (*failing, *evidence[name]):
                    st.markdown(show.bullets(reasons))


def _show_limits(workspace: Workspace, info: SegmentInfo, page: str) -> None:
    """What the intervals take for granted, which are wide, and what would narrow them."""
    uncertainty, fit = workspace.uncertainty(), workspace.fit
    if uncertainty is None or fit is None:
        return
    quality = workspace.snapshot.quality if workspace.snapshot else None
    if workspace.segment:
        quality = assess_quality(workspace.segment)
    if quality:
        wide = weakly_identified(info, quality, uncertainty, fit.case)
        cure = narrower_intervals(info, uncertainty, wide, workspace.recording_duration)
        show.messages(messages((*wide, *cure), info), "warning")
    adequacy = workspace.known_adequacy
    if adequacy is None and workspace.segment:
        label = "Compare with other forms of the model"
        if st.button(label, key=f"{page}_forms", icon=":material/rule:"):
            with st.spinner("This takes some seconds."):
                workspace.compare_forms()
            st.rerun()
    st.caption(conditional(adequacy, info))
    show_form_intervals(info, uncertainty, adequacy)


def show_form_intervals(
    info: SegmentInfo, uncertainty: Uncertainty, adequacy: Adequacy | None
) -> None:
    """The intervals under the form of the model that is to be used for each vehicle."""
    if adequacy and adequacy.recommended:
        show.table(tables.form_intervals_table(info, uncertainty, adequacy.recommended))
        show.messages(messages(adequacy.recommended, info), icon="lightbulb")


def _show_tracking(
    workspace: Workspace,
    of: Segment | SegmentInfo,
    follower: int,
    fit: Fit,
    driven: Trajectories | None,
    own: str,
    key: str,
) -> None:
    """One follower's curves, with the band that the posterior predicts where the data are here."""
    segment, uncertainty = workspace.segment, workspace.uncertainty()
    predicted = gap_band(segment, uncertainty, fit.case) if segment and uncertainty else None
    disturbance = fit.arrays.get("disturbance")
    figure = figures.tracking(
        of, follower, fit.surrogate, driven, own, predicted=predicted, disturbance=disturbance
    )
    show.chart(figure, key)
    vehicle = of.vehicles[follower + 1]
    if predicted:
        covered = [one for one in predicted.findings if one.vehicle == vehicle]
        st.caption(escape_markdown(" ".join((BAND, *messages(covered, of)))))
    sizes = [one for one in disturbance_sizes(of.vehicles, fit) if one.vehicle in (0, vehicle)]
    if sizes:
        st.caption(escape_markdown(" ".join(messages(sizes, of))))


def show_intervals(
    info: SegmentInfo,
    uncertainty: Uncertainty | None,
    more: str = "Pages Compare and Stability show more.",
    case: Case = "II",
) -> None:
    """Intervals of the parameters and the probability of string stability.

    Args:
        info: names the vehicles.
        uncertainty: None shows nothing.
        more: the end of the caption.
        case: in Case I all followers share one row.
    """
    if uncertainty is None:
        return
    colours = show.vehicle_colours(info, tables.parameter_rows(info, case))
    show.table(tables.intervals_table(info, uncertainty, case), colours)
    st.caption(
        "Interval: the values consistent with the data, with disturbances that last for seconds,"
        " as on a road. Probability of string stability: the share of parameter sets consistent"
        f" with the data (posterior samples) that are string stable. {more}"
    )


def banner(workspace: Workspace) -> None:
    """Which snapshot a page shows, and what would complete it."""
    snapshot = workspace.snapshot
    if snapshot is None:
        return
    name = escape_markdown(snapshot.name or snapshot.id)
    if workspace.training:
        state = "the training is new, on the same window."
    elif workspace.recording:
        state = "its recording is open, so everything is complete."
    elif workspace.segment:
        state = "its data came with it."
    else:
        state = "it came without its data."
    is_run = workspace.runs.has(snapshot.id)
    kind = "An earlier run" if is_run else "From the snapshot"
    st.info(f"{kind} **{name}**; {state}", icon=":material/inventory_2:")

    def keep() -> None:
        with show.flashing():
            library().add(snapshot)

    if snapshot.id and not is_run and not library().has(snapshot.id):
        show.messages(
            "This snapshot was deleted from the server and lasts only as long as this session;"
            " keep it again, and its link works again.",
            "warning",
            "delete",
        )
        st.button("Keep it again", key="snapshots_keep", on_click=keep)


def _recording_needed(
    workspace: Workspace, snapshot: Snapshot, what: str, here: bool = False
) -> None:
    """Which recording would complete a page without data, which may be opened ``here``."""
    if workspace.segment:
        return
    info = snapshot.info
    st.warning(
        f"{what} the recording, which is not part of the snapshot. It is"
        f" **{escape_markdown(info.source)}**, SHA-256 `{info.sha256 or 'not known'}`. Open that"
        f" file {'below' if here else 'on the Data page'}, and the window is restored.",
        icon=":material/database:",
    )
    if not here:
        frame.link(frame.DATA, "Open the recording on Data", workspace)


def show_data(workspace: Workspace, snapshot: Snapshot) -> None:
    """The window's own curves, if they came along; else which recording has them."""
    banner(workspace)
    segment = snapshot.segment
    if segment is None:
        _recording_needed(workspace, snapshot, "Speeds and gaps are in", here=True)
        return
    st.caption("These curves are the snapshot's; the whole recording is not part of it.")
    show.vehicle_key(segment)
    show.chart(preview(segment), "snapshots_data")


def show_saved_result(workspace: Workspace, snapshot: Snapshot) -> None:
    """Outcome, tables, history and curves of a saved result."""
    fit, info, evaluation = snapshot.fit, snapshot.info, snapshot.evaluation
    segment = workspace.segment
    if segment is None:
        show.not_acc(info)
    _recording_needed(workspace, snapshot, "To train on, the page needs")
    errors = (evaluation.surrogate, evaluation.closed_loop) if evaluation else (None, None)
    events = evaluation.all_findings if evaluation else None
    residual = evaluation.whiteness if evaluation else None
    _show_fit(
        info, fit, snapshot.quality, errors, events, snapshot.uncertainty, residual, "snapshots"
    )
    _show_limits(workspace, info, "snapshots")
    if fit.history:
        _show_history(fit.history, info, "snapshots")
    if segment is None and fit.surrogate is None:
        return
    st.subheader("The method's curve" + (" against data" if segment else ""), anchor=False)
    follower = pick_follower(info, "snapshots_follower")
    driven = closed_loop(segment, fit) if segment else None
    place = segment or info
    _show_tracking(workspace, place, follower, fit, driven, name_of(fit), "snapshots_tracking")


def show_saved_rows(workspace: Workspace) -> None:
    """The methods compared, as they were saved, on a page that has no newer comparison."""
    snapshot = workspace.snapshot
    if snapshot is None or workspace.comparison:
        return
    banner(workspace)
    _recording_needed(workspace, snapshot, "To run the methods, the page needs")
    info, rows = snapshot.info, snapshot.methods
    show_intervals(info, snapshot.uncertainty, "", snapshot.fit.case)
    if not rows:
        st.caption("No comparison of the methods was saved with this snapshot.")
        return
    show.table(tables.methods_table(info, rows, pick_follower(info, "snapshots_row_follower")))
