"""Work in the background: a queue, one worker, and what is known of each task at any moment.

A training (`Job`) and a series of estimations (`Series`) keep a processor core busy, so one task
runs at a time and the others wait their turn. Whoever asks (a page, many times a second) gets
answers at once and never waits for the worker. A training that was stopped is continued by
submitting the same request again: the store holds its checkpoint.
"""

from accpinn.jobs.job import Job, Request, Train
from accpinn.jobs.queue import KEPT_FOR, KEPT_JOBS, Trainings
from accpinn.jobs.series import Means, Series, Steps
from accpinn.jobs.task import Status, Task

__all__ = [
    "KEPT_FOR",
    "KEPT_JOBS",
    "Job",
    "Means",
    "Request",
    "Series",
    "Status",
    "Steps",
    "Task",
    "Train",
    "Trainings",
]
