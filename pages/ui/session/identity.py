"""Who uses the app: one signed in through the server's provider, or anyone where there is none.

Signing in is Streamlit's own (OpenID Connect): it is on where `.streamlit/secrets.toml` has a
section `[auth]`; see docs/security.md. Without it nothing is asked, and sessions are told apart by
their secret names alone. Where that file cannot be read, or users are named without it, nobody is
admitted: a slip in the settings must not open the server to all.
"""

import os
from dataclasses import dataclass
from hashlib import sha256
from pathlib import Path

import streamlit as st
from streamlit import config

from pages.ui.session.resources import library

USERS_VARIABLE = "ACCPINN_USERS"
"""Environment variable that names who may use the app, as "ann@lab.org, @school.edu"; all whom the
provider signs in where it is not set."""
ADMINS_VARIABLE = "ACCPINN_ADMINS"
"""Environment variable that names, likewise, who may delete what others saved."""
USER = "user"
"""The entry in Streamlit's session state."""
LOOPBACK = ("localhost", "127.0.0.1", "::1")


@dataclass(frozen=True)
class User:
    """Who uses a page."""

    is_asked: bool = False
    """Whether the server asks its users to sign in."""
    is_signed_in: bool = False
    name: str = ""
    """The verified e-mail address, else the provider's own name of the user; empty for nobody."""


def recognise() -> User:
    """Who sends this run of the page; what is asked below is answered for that user."""
    claims = st.user.to_dict()
    signed_in = bool(claims.get("is_logged_in"))
    name = str(claims.get("email") or "").strip().lower()
    if not (name and str(claims.get("email_verified", True)).lower() == "true"):
        name = f"{claims.get('iss', '')} {claims.get('sub', '')}".strip()
    asked = "is_logged_in" in claims or _is_meant_to_ask()
    visitor = User(asked, signed_in, name if signed_in else "")
    st.session_state[USER] = visitor
    return visitor


def user() -> User:
    """The same, as this run recognised it; Streamlit would read its settings at every question."""
    visitor = st.session_state.get(USER)
    return visitor if isinstance(visitor, User) else User()


def mark() -> str:
    """What the names of this user's sessions begin with; empty where nobody is asked."""
    visitor = user()
    return f"{sha256(visitor.name.encode()).hexdigest()[:12]}-" if visitor.is_asked else ""


def is_admin() -> bool:
    """Whether the user may delete what others saved."""
    return user().is_asked and _is_named(ADMINS_VARIABLE)


def is_shared() -> bool:
    """Whether others than the person at this computer can reach the server by themselves."""
    return str(config.get_option("server.address") or "") not in LOOPBACK


def may_use() -> bool:
    """Whether the one who is signed in is among those for whom the server is."""
    if not user().name:
        return False
    return not os.environ.get(USERS_VARIABLE) or _is_named(USERS_VARIABLE) or is_admin()


def _is_meant_to_ask() -> bool:
    """Whether the settings name users, or are in a file that is there and cannot be read."""
    if os.environ.get(USERS_VARIABLE) or os.environ.get(ADMINS_VARIABLE):
        return True
    exists = any(Path(path).exists() for path in config.get_option("secrets.files"))
    return exists and not st.secrets.load_if_toml_exists()


def _is_named(variable: str) -> bool:
    """Whether the variable names the user's address, or its domain as "@school.edu"."""
    named = {part.strip().lower() for part in os.environ.get(variable, "").split(",")} - {""}
    who = user().name
    local, at, domain = who.rpartition("@")
    return who in named or bool(local and at and f"@{domain}" in named)


def owner_mark(session: str) -> str:
    """The digest under which the library keeps who saved a snapshot.

    It is of the identity where the server asks for one, else of the session's secret name.
    """
    return sha256((user().name or session).encode()).hexdigest()


def may_delete(session: str, name: str) -> bool:
    """Whether this user may delete that snapshot.

    On a server that only its own computer reaches everyone may, as all are one person; else whoever
    saved it, and an administrator.
    """
    if not user().is_asked and not is_shared():
        return True
    return is_admin() or library().owner(name) == owner_mark(session)
