"""Stability: which vehicles amplify the disturbances of the car ahead, how much, and why."""

from pages.ui.components.frame import guarded
from pages.ui.stability import show_page

guarded(show_page)
