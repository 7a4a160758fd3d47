"""Train: learn α, β, τ with the physics-inspired neural network, and watch it learn."""

from pages.ui.components.frame import draw_page
from pages.ui.train import show_page

draw_page("Train", show_page)
