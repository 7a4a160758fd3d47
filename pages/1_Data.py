"""Data: open a recording, choose vehicles and a window, preview what it holds."""

from pages.ui.components.frame import guarded
from pages.ui.data.page import show_page

guarded(show_page)
