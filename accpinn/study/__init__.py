"""Questions asked of a whole window: all methods side by side, and sensitivity to regimes."""
