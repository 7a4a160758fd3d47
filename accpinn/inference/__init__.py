"""Uncertainty, identifiability, model adequacy, and multistart."""
