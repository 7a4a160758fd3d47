"""Recordings: OpenACC files as data with findings about them, and synthetic ones."""
