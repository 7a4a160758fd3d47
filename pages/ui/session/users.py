"""The user of a page, and what that user may see.

A user is one signed in through the server's provider, or where there is none the browser that began
a session, which a cookie identifies. Signing in is Streamlit's own (OpenID Connect): it is on where
`.streamlit/secrets.toml` has a section `[auth]`; see docs/security.md. Where that file cannot be
read, or users are named without it, nobody is admitted: a slip in the settings must not open the
server to all.

All sessions are one person's only where the server listens to this computer alone, knows no other
name than this computer's, and is asked for by it without a proxy; everybody else is a stranger.
"""

import os
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass
from hashlib import sha256
from pathlib import Path
from urllib.parse import urlsplit

import streamlit as st
from streamlit import config

from pages.ui.server import LOOPBACK, browser_of, is_open

USERS_VARIABLE = "ACCPINN_USERS"
"""Environment variable that names who may use the app, as "ann@lab.org, @school.edu"; all whom the
provider signs in where it is not set."""
ADMINS_VARIABLE = "ACCPINN_ADMINS"
"""Environment variable that names who may delete what others saved, in the same form."""
USER = "user"
"""The entry in Streamlit's session state."""
PASSED_ON = ("Forwarded", "Via", "X-Forwarded-For", "X-Forwarded-Host", "X-Real-Ip")
"""Headers that only a proxy adds."""


def digest(secret: str) -> str:
    """The SHA-256 that the server keeps in place of a secret, as of a session's name."""
    return sha256(secret.encode()).hexdigest()


@dataclass(frozen=True)
class User:
    """The user of a page."""

    is_asked: bool = False
    """Whether the server asks its users to sign in."""
    is_signed_in: bool = False
    name: str = ""
    """Verified e-mail address, else the provider's name of the user; empty for nobody."""
    browser: str = ""
    """Digest of the browser's cookie; empty for a browser without."""
    is_here: bool = False
    """Whether the browser opened the page by this computer's own name, without a proxy."""


def recognise() -> User:
    """Identify the user of this run of the page, for whom all functions below answer."""
    claims = st.user.to_dict()
    signed_in = bool(claims.get("is_logged_in"))
    name = str(claims.get("email") or "").strip().lower()
    if not (name and str(claims.get("email_verified", True)).lower() == "true"):
        name = f"{claims.get('iss', '')} {claims.get('sub', '')}".strip()
    is_asked = "is_logged_in" in claims or _is_meant_to_ask()
    headers = connection_headers()
    if headers:
        cookie = browser_of(headers.get("Cookie", ""))
        browser, is_here = digest(cookie) if cookie else "", _names_this_computer(headers)
    else:  # the connection broke just now; a later one may still be sent what this run draws
        browser, is_here = user().browser, user().is_here
    visitor = User(is_asked, signed_in, name if signed_in else "", browser, is_here)
    st.session_state[USER] = visitor
    return visitor


def connection_headers() -> Mapping[str, str]:
    """Headers with which the browser opened its connection; none once that is broken."""
    return st.context.headers


def _names_this_computer(headers: Mapping[str, str]) -> bool:
    if any(name in headers for name in PASSED_ON):
        return False
    origin = headers.get("Origin", "")
    places = [f"//{headers.get('Host', '')}", *([origin] if origin else [])]
    with suppress(ValueError):
        return all(urlsplit(place).hostname in LOOPBACK for place in places)
    return False


def user() -> User:
    """The user that this run has recognised; Streamlit would read its settings at every call."""
    visitor = st.session_state.get(USER)
    return visitor if isinstance(visitor, User) else User()


def mark() -> str:
    """Prefix of the names of this user's sessions; empty where nobody has to sign in."""
    visitor = user()
    return f"{digest(visitor.name)[:12]}-" if visitor.is_asked else ""


def key_of(session: str) -> str:
    """Key of a session in the store, from which nobody learns the session's secret name."""
    return f"{mark()}{digest(session)}"


def is_admin() -> bool:
    """Whether the user may delete what others saved."""
    return user().is_asked and _is_named(ADMINS_VARIABLE)


def is_shared() -> bool:
    """Whether others than the person at this computer reach the server, or may do so."""
    return is_open() or not user().is_here


def may_use() -> bool:
    """Whether the user who has signed in is admitted to the server."""
    if not user().name:
        return False
    return not os.environ.get(USERS_VARIABLE) or _is_named(USERS_VARIABLE) or is_admin()


def _is_meant_to_ask() -> bool:
    """Whether the settings name users, or exist in a file that cannot be read."""
    if os.environ.get(USERS_VARIABLE) or os.environ.get(ADMINS_VARIABLE):
        return True
    exists = any(Path(path).exists() for path in config.get_option("secrets.files"))
    return exists and not st.secrets.load_if_toml_exists()


def _is_named(variable: str) -> bool:
    """Whether an environment variable names the user's address, or its domain as "@school.edu"."""
    named = {part.strip().lower() for part in os.environ.get(variable, "").split(",")} - {""}
    who = user().name
    local, at, domain = who.rpartition("@")
    return who in named or bool(local and at and f"@{domain}" in named)


def owner_mark(session: str) -> str:
    """Digest that the server keeps of an owner.

    It is that of the identity where users sign in, else of the browser's cookie, or of the
    session's secret name for a browser without.
    """
    return digest(user().name) if user().name else user().browser or digest(session)


def is_own(session: str, owner: str) -> bool:
    """Whether the user may list and delete what has this owner.

    On a server that only its own computer reaches all users are one person; an administrator may
    do the same with what is others'.
    """
    return sees_all() or is_admin() or owner in (owner_mark(session), digest(session))


def sees_all() -> bool:
    """Whether all sessions are this user's, as nobody else reaches the server or signs in."""
    return not user().is_asked and not is_shared()
