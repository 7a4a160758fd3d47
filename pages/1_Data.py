"""Data: open a recording, choose vehicles and a window, preview what it holds."""

from pages.ui.data.page import show_page

show_page()
