"""Everything of a result in one file: complete, equal for equal results, readable as numbers."""

import io
import zipfile

import numpy as np
import pandas as pd

from accpinn.evaluation.closed_loop import closed_loop
from accpinn.results.report import bundle
from accpinn.study.snapshot import load
from tests.support.snapshots import small, whole


def test_holds_report_snapshot_tables_history_and_motion() -> None:
    content = bundle(whole())
    assert bundle(small()) == bundle(small())
    archive = zipfile.ZipFile(io.BytesIO(content))
    names = set(archive.namelist())
    assert {"report.html", "result.accpinn.zip", "tables/parameters.csv", "tables/stability.tex",
            "tables/methods_1.csv", "training.csv", "motion_measured.csv"} <= names  # fmt: skip
    assert load(archive.read("result.accpinn.zip")).fit.parameters == whole().fit.parameters
    segment, history = whole().segment, whole().fit.history
    motion = pd.read_csv(io.BytesIO(archive.read("motion_measured.csv")))
    assert np.allclose(motion["gap_2_m"], segment.gaps[:, 0])
    assert np.allclose(motion["speed_1_m_per_s"], segment.speeds[:, 0])
    driven = closed_loop(segment, whole().fit)
    motion = pd.read_csv(io.BytesIO(archive.read("motion_closed_loop.csv")))
    assert np.allclose(motion["gap_3_m"], driven.gaps[:, 1], rtol=1e-7)
    training = pd.read_csv(io.BytesIO(archive.read("training.csv")))
    assert np.allclose(training["tau_2_s"], history.parameters.tau[:, 0])
    assert np.allclose(training["alpha_2_per_s2"], history.parameters.alpha[:, 0], rtol=1e-7)
