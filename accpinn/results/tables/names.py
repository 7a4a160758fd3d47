"""What a method is called wherever people read it."""

from collections.abc import Mapping
from typing import Any

from accpinn.methods.fit import Fit, Outcome
from accpinn.methods.registry import METHODS

TITLES = {key: method.title for key, method in METHODS.items()}


def method_name(key: str, config: Mapping[str, Any], outcome: Outcome) -> str:
    """The title of a method, and in brackets what distinguishes the fit from others of it."""
    method = METHODS.get(key)
    if method is None:
        return key
    said = [method.variant(config)] if method.variant else []
    said += ["stopped"] if outcome is Outcome.STOPPED else []
    return f"{method.title} ({', '.join(said)})" if said else method.title


def name_of(fit: Fit) -> str:
    """The same of a fit."""
    return method_name(fit.method, fit.config, fit.outcome)
