"""Compare: every method on the same window, and what the data identify."""

from pages.ui.compare.page import show_page

show_page()
