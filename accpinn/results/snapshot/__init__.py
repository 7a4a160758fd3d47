"""Results that travel: one file that says what was found, from what, and can be checked."""
