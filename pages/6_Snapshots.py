"""Snapshots: save a result, send it, import another, and compare two."""

from pages.ui.snapshots.page import show_page

show_page()
