"""Database: the parameters of many vehicles from many recordings, by make, model and setting."""

from pages.ui.components.frame import draw_page
from pages.ui.database.page import show_page

draw_page("Database", show_page)
