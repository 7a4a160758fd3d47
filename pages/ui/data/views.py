"""The tabs of page Data: the window, its regimes and changes, the recording, the validation."""

from dataclasses import replace
from pathlib import Path

import streamlit as st

from accpinn.errors import SegmentError
from accpinn.evaluation import validation_findings
from accpinn.evaluation.closed_loop import ClosedLoop
from accpinn.methods import least_squares
from accpinn.recordings import MOVING, Recording, Window
from accpinn.recordings.files import read
from accpinn.results import recording as tables
from accpinn.results.figures.style import vehicle_colours
from accpinn.results.messages import messages
from accpinn.results.tables.estimates import validation_table
from accpinn.segment import LONGEST_TIME_GAP, USUAL, DrivenByHand, Segment
from accpinn.segment.cut import MINIMUM_DURATION, chains, cut
from accpinn.segment.quality import EXCLUDABLE, LARGE_CONDITION, assess_quality, label_regimes
from accpinn.segment.windows import complete_windows, first_window
from pages.ui.components import show
from pages.ui.components.show import bound, select
from pages.ui.session.resources import segment_of, windows_in_car_following
from pages.ui.session.workspace import Workspace

REGIMES = {
    "catching up": f"The time gap, space-gap over speed, is above {USUAL:g} times its median"
    " ({:g} s at least, {:g} s at most): the vehicle catches up or drives freely.".format(
        *LONGEST_TIME_GAP
    ),
    "manual": "A driver controls the vehicle, according to the file.",
    "standstill": f"The vehicle moves at {MOVING:g} m/s or less.",
}


def show_window(workspace: Workspace, segment: Segment | None) -> None:
    """The window's figures, and the estimate that needs no training."""
    if segment is None:
        st.caption("The window cannot be used yet.")
        return
    quality = assess_quality(segment)
    estimate = least_squares.fit((segment,), workspace.selection.case)
    st.markdown(f"**Preview of the window {segment.window}**")
    if workspace.recording is None:
        show.not_acc(segment)
    table = tables.quality_table(segment.info, quality, estimate)
    untitled = replace(table, caption="")  # the heading above says what it is of
    show.table(untitled, vehicle_colours(segment.vehicles)[1:])
    excluded = (
        f" Without {', '.join(segment.excluded_regimes)}: the estimate and the condition number;"
        " all other figures are of all instants."
    )
    st.caption(
        "Least squares solves the CTHP, without s₀ or delay, for α, β and τ in one step, from"
        " differences of the measured speeds, and noise biases it: take it as a first look. The"
        f" leader's speed varies by {quality.leader_deviation:.2f} m/s (standard deviation)."
        f" Condition number: above about {LARGE_CONDITION:.0f}, gap, speed and relative speed move"
        " so alike that α, β and τ are hardly told apart."
        + excluded
        * bool(segment.excluded_regimes)
    )
    findings = (*quality.findings, *estimate.findings)
    show.warnings(messages(findings, segment), "this window")
    show.downloads(table, f"{Path(segment.source).stem}_window", "data_window")


def show_changes(workspace: Workspace) -> None:
    """Changes to the windows' data before the estimation."""
    parts = workspace.segments
    if not parts:
        st.caption("The window cannot be used yet.")
        return
    is_changed = False
    for segment in parts:
        changes = [finding for finding in segment.findings if not isinstance(finding, DrivenByHand)]
        if changes:
            is_changed = True
            if len(parts) > 1:
                st.markdown(f"**{segment.window}**")
            st.markdown(show.bullets(messages(changes, segment)))
    if not is_changed:
        of = "the windows" if len(parts) > 1 else "the window"
        st.caption(f"None: every sample of {of} is used as it was recorded.")


def show_about(recording: Recording) -> None:
    """The vehicles of the recording, and the faults of its data."""
    table = tables.recording_table(recording)
    show.table(table)
    st.caption(
        "Correlation: of the gap's rate of change with the difference of the two speeds, 0.8 and"
        " more for sound data."
    )
    sentences = messages(recording.findings, recording)
    if sentences:
        show.messages(sentences, "warning")
    else:
        st.caption("No check finds a fault in the data of this recording.")
    if recording.sha256:
        st.caption(f"SHA-256 `{recording.sha256}`")
    show.downloads(table, f"{Path(recording.source).stem}_vehicles", "data_about")


def show_regimes(workspace: Workspace, recording: Recording) -> None:
    """Shares of the window, or of the windows together, and the user's choice."""
    vehicles, excluded = workspace.selection.vehicles, workspace.selection.excluded
    try:  # with all their instants, whatever is left out now
        parts = [segment_of(recording, window, vehicles, ()) for window in workspace.windows]
    except SegmentError:
        st.caption("The window cannot be used yet.")
        return
    regimes = [label_regimes(part, recording) for part in parts]
    table = tables.regimes_table([part.info for part in parts], regimes)
    show.table(table)
    if not any(any(part.mode_known) for part in regimes):
        st.caption("The file has no driver modes, so no instant counts as manual.")
    show.downloads(table, f"{Path(recording.source).stem}_regimes", "data_regimes")
    st.markdown("**Leave out of the model's equations**")
    with st.container(horizontal=True):
        for name in EXCLUDABLE:

            def ticked(on: bool, name: str = name) -> None:
                left_out = {*workspace.selection.excluded} - {name} | ({name} if on else set())
                workspace.choose(excluded=tuple(n for n in EXCLUDABLE if n in left_out))

            shown = bound(f"data_exclude_{name}", name in excluded, ticked)
            st.checkbox(name.capitalize(), **shown, help=REGIMES[name])
    st.caption(
        "The model describes car-following. Nothing is left out unless you tick it; every"
        " method then works without it, and every page names it. The data stay: only the"
        " equation of the follower's acceleration does not count there. Instants are"
        " chosen by their time gap, which the model is to explain, so leaving them out biases, too."
    )


# A window that nothing is learned from


def choose_validation(workspace: Workspace, recording: Recording) -> None:
    """The recording, vehicles and window to validate on, and its errors where there is a result."""
    st.caption(
        "The learned parameters are simulated behind the leader of this window, from which nothing"
        " is learned. Page Train shows the errors beside those of the training window."
    )
    recordings = {recording.sha256: recording} | workspace.opened
    columns = st.columns((2, 1.6, 1, 1, 1.4), gap="small", vertical_alignment="bottom")
    names = {key: other.source for key, other in recordings.items()}
    names[recording.sha256] = "This recording"
    sha256 = select(
        "Validation recording", names, recording.sha256, "data_validation_recording", workspace,
        place=columns[0], help="This one, or another that was opened in this session.",
    )  # fmt: skip
    chosen = recordings[sha256]
    followers = len(workspace.selection.vehicles) - 1
    platoons = {
        chain[k]: chain[k : k + followers + 1]
        for chain in chains(chosen)
        for k in range(len(chain) - followers)
    }
    if not platoons:
        st.caption(f"{names[sha256]} has no platoon with {followers} followers.")
        return
    same = workspace.selection.vehicles[0]
    leader = columns[1].selectbox(
        "Leader there", list(platoons), index=list(platoons).index(same) if same in platoons else 0,
        format_func=chosen.label, key=f"data_validation_leader_{chosen.sha256[:12]}",
        help="As many followers behind it are simulated as parameters are learned.",
    )  # fmt: skip
    vehicles = platoons[leader]
    learned = _learned(workspace) if chosen is recording else ()
    stretches, spare = complete_windows(chosen, vehicles, learned), list[Window]()
    if learned and not stretches:
        st.caption(
            "All of this recording is learned from, so nothing is left to validate on. Learn from"
            " fewer windows (switch some off above), or open another recording of these vehicles."
        )
        _upload(workspace)
        show_validation(workspace)
        return
    if len(learned) > 1:
        spare = [
            window
            for window in windows_in_car_following(chosen, vehicles)
            if all(window.end <= part.start or part.end <= window.start for part in learned)
        ]
        if not spare:
            st.caption(
                "All windows in car-following are learned from; what is offered here is the rest,"
                " in which errors are larger. To keep one for validation, switch it off above, or"
                " open another recording of these vehicles."
            )
    first = (
        spare[0] if spare else first_window(chosen, stretches, workspace.selection.window.duration)
    )
    key = f"{chosen.sha256[:12]}_{vehicles[0]}_{workspace.selection.window}"
    start = columns[2].number_input(
        "Starts at [s]", 0.0, chosen.duration, first.start, 10.0, format="%.1f",
        key=f"data_validation_start_{key}", help="In that recording's time.",
    )  # fmt: skip
    most, usual = (max(MINIMUM_DURATION, span.duration) for span in (chosen, first))
    length = columns[3].number_input(
        "Lasts [s]", MINIMUM_DURATION, most, usual, 10.0,
        format="%.1f", key=f"data_validation_length_{key}",
        help="Longer windows average over more driving.",
    )  # fmt: skip
    learned_from = any(part.start <= start and start + length <= part.end for part in learned)
    if columns[4].button(
        f"Validate on {Window(start, start + length)}", key="data_validate", width="stretch",
        disabled=learned_from,
        help="All of this window is learned from; choose another." if learned_from else
        "Simulates the learned parameters on this window, now or once there are some.",
    ):  # fmt: skip
        validation = show.attempt(lambda: cut(chosen, start, length, vehicles))
        workspace.validation = validation or workspace.validation
    _upload(workspace)
    show_validation(workspace)


def _learned(workspace: Workspace) -> tuple[Window, ...]:
    """The windows that the result was learned from, or the next one will be."""
    if workspace.result:
        return tuple(info.window for info in workspace.result.infos)
    return workspace.windows


def _upload(workspace: Workspace) -> None:
    def took(name: str, raw: bytes) -> None:
        recording = read(raw, name)
        if recording.sha256 not in workspace.opened:
            workspace.remember(recording)
        workspace.choices["data_validation_recording"] = recording.sha256

    show.upload(
        "Or drop a second recording here; the first one stays open.", "data_validation_upload",
        took, help="It joins the list of validation recordings above.",
    )  # fmt: skip
    show.flashed()


def show_validation(workspace: Workspace) -> None:
    """The closed-loop errors on both windows; nothing where no validation was chosen."""
    other, segment, result = workspace.validation, workspace.segment, workspace.result
    if other is None:
        return
    if segment is None or result is None:
        st.caption(
            f"Chosen for validation: {show.escape_markdown(other.source)}, {other.window}. There"
            " are no learned parameters yet."
        )
        return
    findings = validation_findings(result.segments, other)
    validated, errors = ClosedLoop.of(other, result.estimate), result.evaluation.closed_loop
    table = validation_table(result.infos, errors, other.info, validated.errors)
    show.table(table, vehicle_colours(segment.vehicles)[1:])
    sentences = (*messages(findings, segment), *messages(validated.findings, other))
    show.messages(sentences, "warning")
    show.downloads(table, f"{segment.source}_validation", "validation")
