"""Can the data tell the parameters apart: profiles, dispersion over starts, plain warnings."""

from accpinn.identifiability.extensions import Extension, better, extensions
from accpinn.identifiability.profile import INCREASE, Profile, profile, profiles
from accpinn.identifiability.starts import Dispersion, Trial, gather, starts
from accpinn.identifiability.telling import WIDE, identifiable, left_open

__all__ = [
    "INCREASE",
    "WIDE",
    "Dispersion",
    "Extension",
    "Profile",
    "Trial",
    "better",
    "extensions",
    "gather",
    "identifiable",
    "left_open",
    "profile",
    "profiles",
    "starts",
]
