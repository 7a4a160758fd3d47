"""`runs`: all results that the cache keeps can be searched."""

from accpinn.cli import main
from tests.support.command import PLATOON, SHORT, STUDY, Capture, document


def test_all_runs_can_be_searched(capsys: Capture) -> None:
    assert document(capsys, "runs") == {"runs": []}
    fitted = document(capsys, "fit", STUDY, *SHORT, "--method", "splines")
    document(capsys, "fit", PLATOON, *SHORT, "--vehicles", "2-3", "--method", "least-squares")
    document(capsys, "fit", STUDY, *SHORT, "--method", "recursive", "--no-cache")
    assert len(document(capsys, "runs")["runs"]) == 2
    (run,) = document(capsys, "runs", "splines", "paper_STUDY")["runs"]
    assert (run["method"], run["window"]) == ("splines", "0–30 s")
    own = fitted["parameters"][0]
    assert run["parameters"] == [{name: own[name] for name in ("alpha", "beta", "tau")}]
    assert main(["runs", "bmw"]) == 0
    (line,) = [one for one in capsys.readouterr().out.splitlines() if "astazero" in one]
    assert "least-squares" in line
    assert "2–3" in line
    assert main(["runs", "nowhere"]) == 0
    assert capsys.readouterr().out.count("\n") == 1
