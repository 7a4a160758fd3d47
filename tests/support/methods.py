"""Methods as tests call them."""

from accpinn.methods.registry import METHODS

RIVALS = {key: method.fit for key, method in METHODS.items() if not method.is_iterative}
"""Every method but the network, which takes longer."""
