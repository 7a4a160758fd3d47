"""The page in place of all others until one has signed in, where the server asks for that."""

import streamlit as st
from streamlit.errors import StreamlitAuthError

from pages.ui.components import show
from pages.ui.session.identity import may_use, recognise, user


def admit() -> None:
    """End the page here, before anything is shown, unless the user may use the server."""
    visitor = recognise()
    if not visitor.is_asked or may_use():
        return
    st.title("accpinn", anchor=False)
    if visitor.is_signed_in:
        show.messages(
            "Your account may not use this server; ask whoever runs it to name you.", "warning"
        )
        sign_out_button()
    else:
        st.caption("This server asks you to sign in.")
        if st.button("Sign in", type="primary", icon=":material/login:", key="sign_in"):
            _sign_in()
    st.stop()


def sign_out_button() -> None:
    """Signs out; drawn only where one is signed in."""
    if user().is_signed_in:
        st.button(
            "Sign out", icon=":material/logout:", key="sign_out", type="tertiary",
            on_click=st.logout, help=f"You are signed in as {user().name or 'someone unnamed'}.",
        )  # fmt: skip


def _sign_in() -> None:
    try:
        st.login()
    except StreamlitAuthError as fault:
        show.messages(f"Signing in is not set up on this server: {fault}", "error")
