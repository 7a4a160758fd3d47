"""Platoon: a row of the vehicles behind a leader, and what becomes of its disturbance."""

from pages.ui.components.frame import draw_page
from pages.ui.platoon import show_page

draw_page("Platoon", show_page)
