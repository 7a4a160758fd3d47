"""The model every method estimates: the constant time-headway policy (CTHP)."""
