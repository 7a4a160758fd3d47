"""What a fit is worth: errors of two kinds, never mixed, and what the law leaves unexplained.

*Surrogate fit*: the method's own trajectories (the network's, the spline's) against the data.
This is what the paper's tables report; it says how well a curve was drawn, not how well the law
drives. *Closed-loop simulation*: only the leader's measured speed goes in, the law integrates its
own state from the first measured instant.
"""

from accpinn.assessment.appraisal import Assessment, appraise
from accpinn.assessment.driving import closed_loop, closed_loop_errors, collisions, incidents
from accpinn.assessment.errors import TrackingErrors, surrogate_errors, tracking_errors
from accpinn.assessment.held_out import (
    BLOCKS,
    Block,
    Unseen,
    blocks_held_out,
    drive_unseen,
    held_out_errors,
)
from accpinn.assessment.hidden import part, without
from accpinn.assessment.whiteness import Whiteness, whiteness

__all__ = [
    "BLOCKS",
    "Assessment",
    "Block",
    "TrackingErrors",
    "Unseen",
    "Whiteness",
    "appraise",
    "blocks_held_out",
    "closed_loop",
    "closed_loop_errors",
    "collisions",
    "drive_unseen",
    "held_out_errors",
    "incidents",
    "part",
    "surrogate_errors",
    "tracking_errors",
    "whiteness",
    "without",
]
