"""What a fit is worth: errors of two kinds, never mixed, and what the law leaves unexplained.

*Surrogate fit*: the method's own trajectories (the network's, the spline's) against the data.
This is what the paper's tables report; it says how well a curve was drawn, not how well the law
drives. *Closed-loop simulation*: only the leader's measured speed goes in, the law integrates its
own state from the first measured instant.
"""
