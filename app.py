"""Home: the session so far, the ways to a recording, the samples, and what the paper prints."""

from pages.ui.components.frame import guarded
from pages.ui.home import show_page

guarded(show_page)
