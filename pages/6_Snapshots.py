"""Snapshots: save a result, send it, import another, and compare two."""

from pages.ui.components.frame import draw_page
from pages.ui.snapshots.page import show_page

draw_page("Snapshots", show_page)
