"""Names by which the likelihood's modules know `registry`."""

from accpinn.model.registry import CTHPS, FOLLOWING, PAPER, Held, following_model

__all__ = ["MODELS", "PAPER", "Held", "model_of", "terms_of"]
MODELS = CTHPS


def model_of(key: str) -> str:
    """The key of a known model."""
    return following_model(key).key


def terms_of(model: str) -> tuple[str, ...]:
    """The terms that a model adds to the CTHP."""
    return FOLLOWING[model].terms
