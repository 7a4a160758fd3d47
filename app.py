"""Home: the session so far, the ways to a recording, the samples, and what the paper prints."""

from pages.ui.components.frame import draw_page
from pages.ui.home import show_page

draw_page("", show_page)
