"""How good a fit is: errors of two kinds, never mixed, hold-out errors, and the residual.

*Surrogate fit*: the method's own trajectories (the network's, the spline's) against the data. The
paper's tables report this; it measures how well a curve was drawn, not how well the model predicts.
*Closed-loop simulation*: only the leader's measured speed is given, and the model's own states are
integrated from the first measured instant on.
"""
