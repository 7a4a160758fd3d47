"""String stability: what a learned controller does to disturbances, from closed forms."""
