"""All car-following models: a further one is a file with its acceleration, and a line here."""

from collections.abc import Mapping

from accpinn.errors import ConfigError
from accpinn.model.constant_headway import CTHP, CTHP_S0
from accpinn.model.following import FollowingModel
from accpinn.model.fvdm import FVDM
from accpinn.model.idm import IDM

BASES = (
    CTHP,
    CTHP_S0,
    IDM,
    FVDM,
)
FOLLOWING: Mapping[str, FollowingModel] = {
    model.key: model
    for base in BASES
    for model in (base, base.behind_a("lag"), base.behind_a("delay"))
}
"""Every model by its key, each also behind a lag or a delay."""
JUDGED = tuple(base.key for base in BASES)
"""Models that are compared unless others are named."""


def following_model(key: str) -> FollowingModel:
    """The model of that key.

    Raises:
        ConfigError: for an unknown key.
    """
    try:
        return FOLLOWING[key]
    except KeyError:
        known = ", ".join(FOLLOWING)
        raise ConfigError(f"models: {key[:40]} is not known; choose from {known}.") from None
