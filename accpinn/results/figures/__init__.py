"""Results as plotly figures: pure functions, transparent grounds, one colour per vehicle."""
