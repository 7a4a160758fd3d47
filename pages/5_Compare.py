"""Compare: every method on the same window, and what the data identify."""

from pages.ui.compare import show_page
from pages.ui.components.frame import draw_page

draw_page("Compare", show_page)
