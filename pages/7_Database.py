"""Database: the parameters of many vehicles from many recordings, by make, model and setting."""

from pages.ui.components.frame import guarded
from pages.ui.database.page import show_page

guarded(show_page)
