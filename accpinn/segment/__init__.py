"""Segments: a window of a recording and a platoon in it, on even instants."""
