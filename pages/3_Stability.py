"""Stability: which vehicles amplify the disturbances of the car ahead, how much, and why."""

from pages.ui.stability import show_page

show_page()
