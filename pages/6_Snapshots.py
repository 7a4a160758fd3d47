"""Snapshots: save a result, send it, import another, and compare two."""

from pages.ui.components.frame import guarded
from pages.ui.snapshots.page import show_page

guarded(show_page)
