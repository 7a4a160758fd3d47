"""Database: the parameters of many vehicles from many recordings, by make, model and setting."""

from pages.ui.database.page import show_page

show_page()
