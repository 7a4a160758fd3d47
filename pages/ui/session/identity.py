"""Who uses the app: one signed in through the server's provider, or anyone where there is none.

Signing in is Streamlit's own (OpenID Connect): it is on where `.streamlit/secrets.toml` has a
section `[auth]`; see docs/security.md. Without it nothing is asked, and sessions are told apart by
their secret names alone.
"""

import os
from hashlib import sha256

import streamlit as st
from streamlit import config

USERS_VARIABLE = "ACCPINN_USERS"
"""Environment variable that names who may use the app, as "ann@lab.org, @school.edu"; all whom the
provider signs in where it is not set."""
ADMINS_VARIABLE = "ACCPINN_ADMINS"
"""Environment variable that names, likewise, who may delete what others saved."""
LOOPBACK = ("localhost", "127.0.0.1", "::1")


def is_asked() -> bool:
    """Whether this server asks its users to sign in."""
    return "is_logged_in" in st.user


def identity() -> str:
    """Who is signed in: the verified e-mail address, else the provider's own name of the user.

    Empty where nobody is, or nobody is asked.
    """
    if not (is_asked() and st.user.is_logged_in):
        return ""
    claims = st.user.to_dict()
    email = str(claims.get("email") or "").strip().lower()
    if email and str(claims.get("email_verified", True)).lower() == "true":
        return email
    return f"{claims.get('iss', '')} {claims.get('sub', '')}".strip()


def mark() -> str:
    """What the names of this user's sessions begin with; empty where nobody is asked."""
    return f"{sha256(identity().encode()).hexdigest()[:12]}-" if is_asked() else ""


def is_admin() -> bool:
    """Whether the user may delete what others saved."""
    return is_asked() and _is_named(ADMINS_VARIABLE)


def is_shared() -> bool:
    """Whether others than the person at this computer can reach the server by themselves."""
    return str(config.get_option("server.address") or "") not in LOOPBACK


def may_use() -> bool:
    """Whether the one who is signed in is among those for whom the server is."""
    if not identity():
        return False
    return not os.environ.get(USERS_VARIABLE) or _is_named(USERS_VARIABLE) or is_admin()


def _is_named(variable: str) -> bool:
    """Whether the variable names the user's address, or its domain as "@school.edu"."""
    named = {part.strip().lower() for part in os.environ.get(variable, "").split(",")} - {""}
    who = identity()
    local, at, domain = who.rpartition("@")
    return who in named or bool(local and at and f"@{domain}" in named)
