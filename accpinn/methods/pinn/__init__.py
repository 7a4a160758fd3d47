"""The physics-inspired neural network (PiNN): network, loss, two recipes, one training."""
