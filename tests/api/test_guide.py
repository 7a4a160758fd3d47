"""CONTRIBUTING's further model and method, pasted into a user's file, work everywhere unedited."""

import re
import subprocess
import sys
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import numpy as np
import pytest

import accpinn
from accpinn import Result
from accpinn.cli import main
from accpinn.methods.registry import METHODS
from accpinn.model.registry import FOLLOWING
from accpinn.study.scripts import Script
from tests.support.command import ROOT, Capture
from tests.support.registries import restored

MODEL, METHOD = "ovm", "moving-average"
KINDS = {"model": MODEL, "method": METHOD}
WINDOW = {"start": 0, "duration": 60}


@pytest.fixture(scope="module")
def script(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    """Both as they are printed, and the two lines that the guide names; run in this process."""
    text = (ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8")
    method, model = re.findall(r"```python\n(.*?)```", text, re.DOTALL)
    calls = re.findall(r"`(accpinn\.register_\w+\(\w+\))`", text)
    place = tmp_path_factory.mktemp("own") / "own.py"
    place.write_text("\n".join([method, model, "import accpinn", *calls]), encoding="utf-8")
    with restored():
        assert Script.read(place).names() == (MODEL, METHOD)
        yield place


@cache
def found(kind: str) -> Result:
    """A minute of a sample, estimated by the further method, or of the further model."""
    return accpinn.fit(accpinn.sample("paper_study"), **WINDOW, **{kind: KINDS[kind]})


@pytest.mark.usefixtures("script")
class TestFromPython:
    @pytest.mark.parametrize("kind", KINDS)
    def test_a_result_is_kept_confirmed_reported_and_a_table(
        self, kind: str, tmp_path: Path
    ) -> None:
        result = found(kind)
        model = FOLLOWING[result.estimate.model]
        assert (result.posterior is None) == (kind == "method")
        frame = result.to_frame()
        assert np.isfinite(frame[[*model.names]]).all(axis=None)
        snapshot = accpinn.save(result, tmp_path / "own.accpinn.zip")
        assert accpinn.load(snapshot).parameters == result.parameters
        assert accpinn.verify(snapshot, accpinn.sample_path("paper_study")).ok
        page = accpinn.report(result, tmp_path / "own.html").read_text(encoding="utf-8")
        assert (model.title if kind == "model" else METHODS[METHOD].title) in page
        assert str(result)

    def test_the_method_is_compared_with_others_and_the_model_judged_among_others(self) -> None:
        rows = accpinn.compare(
            accpinn.sample("paper_study"), **WINDOW, methods=("least-squares", METHOD)
        )
        least_squares, averaged = (row.parameters.values for row in rows)
        np.testing.assert_allclose(averaged, least_squares, rtol=0.2)
        judged = accpinn.judge(accpinn.sample("motorway"), ("cthp", MODEL), vehicles="1-2")
        assert {*judged.to_frame().model} == {"cthp", MODEL}


def test_workers_of_a_batch_run_the_file_and_its_table_needs_it(
    script: Path, tmp_path: Path, capsys: Capture
) -> None:
    study = tmp_path / "study"
    asked = {"window": 150, "methods": ("simulation", METHOD), "model": script, "workers": 1}
    done, again = (
        accpinn.batch(accpinn.sample_path("paper_study"), study, **asked) for _ in range(2)
    )
    assert (done.failed, done.rows) == (0, 2 * done.windows)
    assert again.finished == 0
    code = f"from accpinn.cli import main; raise SystemExit(main(['table', {str(study)!r}]))"
    other = subprocess.run(
        [sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=False
    )
    assert other.returncode == 1
    assert f"{MODEL} is not known here" in other.stderr
    assert main(["table", str(study), "--model", str(script), "--json"]) == 0
    assert '"kappa"' in capsys.readouterr().out


@pytest.mark.usefixtures("fresh_server", "script")
class TestOnThePages:
    @pytest.mark.parametrize("kind", KINDS)
    def test_every_page_draws_a_result(self, kind: str) -> None:
        from pages.ui.session import sessions
        from tests.support.apptest import PAGES, open_page

        session = sessions.workspaces().new()
        session.restore(found(kind), found(kind).recording)
        for title in PAGES:
            page = open_page(title, session)
            assert not page.boxes("error"), title
        for tab in ("Poles and responses", "Region", "Margin", "Measured"):
            page = open_page("Stability", session).open_tab("stability", tab)
            assert not page.boxes("error"), tab

    def test_the_model_is_trained_and_judged_and_the_method_compared(
        self, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        from tests.support.apptest import WAIT, open_page, with_pair

        # As an entry in the registry of methods does.
        monkeypatch.setattr("accpinn.tasks.COMPARED", ("least-squares", METHOD))
        session = with_pair()
        open_page("Train", session).choose("train_model", MODEL).press("Start training")
        assert session.training.wait(WAIT)
        assert session.result.estimate.model == MODEL
        assert FOLLOWING[MODEL].title in open_page("Train", session).everything()
        page = open_page("Compare", session).press("compare_run")
        assert session.comparison.wait(WAIT)
        assert METHODS[METHOD].title in page.sound().everything()
