"""Estimation methods behind one signature: a segment, a case and settings in, a `Fit` out.

Adding a method is one module with a `METHOD` here, and one line in `registry`.
"""
