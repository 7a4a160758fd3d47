"""Can the data tell the parameters apart: profiles, dispersion over starts, plain warnings."""

from accpinn.identifiability.profile import INCREASE, Profile, profile, profiles
from accpinn.identifiability.starts import Dispersion, Trial, starts
from accpinn.identifiability.telling import WIDE, identifiable

__all__ = [
    "INCREASE",
    "WIDE",
    "Dispersion",
    "Profile",
    "Trial",
    "identifiable",
    "profile",
    "profiles",
    "starts",
]
