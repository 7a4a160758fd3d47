"""Data: open a recording, choose vehicles and a window, preview what it holds."""

from pages.ui.components.frame import draw_page
from pages.ui.data.page import show_page

draw_page("Data", show_page)
