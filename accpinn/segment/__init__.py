"""Segments: a window of a recording and a platoon in it, with nothing missing."""
