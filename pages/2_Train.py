"""Train: learn α, β, τ with the physics-inspired neural network, and watch it learn."""

from pages.ui.components.frame import guarded
from pages.ui.train import show_page

guarded(show_page)
