"""Trainings in the background: a queue, one worker, and what is known of each at any moment.

Training keeps a processor core busy, so one runs at a time and the others wait their turn. Whoever
asks (a page, many times a second) gets answers at once and never waits for the worker. A job that
was stopped is continued by submitting the same request again: the store holds its checkpoint.
"""

from accpinn.jobs.job import Job, Request, Status, Train
from accpinn.jobs.queue import KEPT_FOR, KEPT_JOBS, Trainings

__all__ = ["KEPT_FOR", "KEPT_JOBS", "Job", "Request", "Status", "Train", "Trainings"]
