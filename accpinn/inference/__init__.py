"""Uncertainty, identifiability and model adequacy."""
