"""Methods as tests call them."""

from accpinn.methods.registry import METHODS

RIVALS = {key: method.fit for key, method in METHODS.items() if key != "pinn"}
"""Every method but the network, which takes longer."""
