"""Car-following models: the constant time-headway policy (CTHP), its terms, and others."""
