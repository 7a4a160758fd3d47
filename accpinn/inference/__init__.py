"""How sure the parameters are: uncertainty, identifiability, model adequacy, and multistart."""
