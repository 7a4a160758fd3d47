"""The physics-inspired neural network (PiNN): network, loss, three presets, one training."""
