"""Can the data tell the parameters apart: profiles, dispersion over starts, plain warnings."""

from accpinn.identifiability.profile import INCREASE, Profile, profile, profiles
from accpinn.identifiability.starts import Dispersion, Trial, starts
from accpinn.identifiability.telling import WIDE, identifiable, left_open

__all__ = [
    "INCREASE",
    "WIDE",
    "Dispersion",
    "Profile",
    "Trial",
    "identifiable",
    "left_open",
    "profile",
    "profiles",
    "starts",
]
