"""Results as tables for the page, for LaTeX and as CSV."""
