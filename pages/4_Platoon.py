"""Platoon: a row of the vehicles behind a leader, and what becomes of its disturbance."""

from pages.ui.components.frame import guarded
from pages.ui.platoon import show_page

guarded(show_page)
