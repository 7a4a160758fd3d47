"""Stability: which vehicles amplify the disturbances of the car ahead, how much, and why."""

from pages.ui.components.frame import draw_page
from pages.ui.stability import show_page

draw_page("Stability", show_page)
