"""Reproduce: the paper's tables and figures, printed beside computed and learned."""

from pages.ui.components.frame import draw_page
from pages.ui.reproduction import show_page

draw_page("Reproduce", show_page)
