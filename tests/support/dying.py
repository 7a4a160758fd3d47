"""A job at which workers die; they load little else, as each is a new process."""

import os
from pathlib import Path

from accpinn.study.batch import WindowJob
from accpinn.study.rows import COLUMNS
from accpinn.study.studies import Computed

DEATHS = "ACCPINN_TEST_DEATHS"
"""The variable that names where each try leaves its mark."""


def dying(job: WindowJob) -> list[Computed]:
    """Computed, but of run2.csv."""
    with (Path(os.environ[DEATHS]) / job.file.name).open("a") as marks:
        marks.write("x")
    if job.file.name == "run2.csv":
        os._exit(1)
    return [Computed(job.analyses[0], [dict.fromkeys(column.name for column in COLUMNS)])]
