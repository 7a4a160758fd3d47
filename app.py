"""Home: what this is, one click to a trained sample, and the state of the session."""

import streamlit as st

from accpinn.methods.pinn.config import FAST
from accpinn.results.figures.recording import preview
from accpinn.segment.cut import cut
from pages.ui.components import frame, show
from pages.ui.data.sources import FIRST_SAMPLE, ask_for_upload, open_with, sample
from pages.ui.session.workspace import Workspace

STEPS = (
    ("1. Open a recording", "A car-following run of the OpenACC database, or a sample."),
    ("2. Choose a window", "Who follows whom, from when to when; one set of parameters or many."),
    ("3. Train", "Watch α, β and τ converge, then see how well they explain the drive."),
    ("4. Assess", "Which of these cars amplify disturbances, and what a platoon of them does."),
)


def main() -> None:
    """Draw the page."""
    workspace = frame.begin("")
    words, picture = st.columns((1, 1.15), gap="large", vertical_alignment="center")
    with words:
        introduce(workspace)
    with picture:
        recording, _ = sample(FIRST_SAMPLE)
        segment = cut(recording)
        show.vehicle_key(segment)
        st.plotly_chart(preview(segment), key="home_preview", config={"staticPlot": True})
        st.caption("A synthetic sample: every change of the leader's speed grows from car to car.")
    st.space("small")
    for column, (title, line) in zip(st.columns(len(STEPS)), STEPS, strict=True):
        with column.container(border=True, height="stretch"):
            st.markdown(f"**{title}**")
            st.caption(line)
    if workspace.recording:
        with st.container(border=True):
            st.markdown("**Your session**  \n" + "  \n".join(frame.session_state(workspace)))
            if workspace.training:
                frame.link(frame.TRAIN, "Back to the training", workspace)
            else:
                frame.link(frame.DATA, "Back to the recording", workspace)


def introduce(workspace: Workspace) -> None:
    """What this is, and the two ways in."""
    st.title("Learn a car's cruise control from a recorded drive", anchor=False)
    st.markdown(
        "accpinn learns the parameters of a car's **adaptive cruise control** from a recorded"
        " drive: the gains α and β and the time headway τ of the constant time-headway policy."
        " A physics-inspired neural network does the learning, and every result comes with its"
        " errors and intervals."
    )
    if st.button("Train a sample now", type="primary", icon=":material/play_arrow:"):
        open_with(workspace, lambda: sample(FIRST_SAMPLE))
        if not workspace.refusal:
            workspace.preset = FAST.preset
            workspace.train(FAST)
            frame.go(frame.TRAIN, workspace)
        show.messages(workspace.refusal, "error")
    if st.button("Load your own OpenACC recording", icon=":material/upload_file:"):
        ask_for_upload()
        frame.go(frame.DATA, workspace)


main()
