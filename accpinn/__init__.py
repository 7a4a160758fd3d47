"""accpinn: which headway and gains does this adaptive cruise control use, and can I trust that?"""

__version__ = "0.1.0"
