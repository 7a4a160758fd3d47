"""`runs`: all results that the cache keeps can be searched."""

from accpinn.cli import main
from tests.support.command import PLATOON, SHORT, STUDY, Capture, document


def test_all_runs_can_be_searched(capsys: Capture) -> None:
    assert document(capsys, "runs") == {"runs": []}
    fitted = document(capsys, "fit", STUDY, *SHORT, "--method", "splines")
    document(capsys, "fit", PLATOON, *SHORT, "--vehicles", "1-3")
    document(capsys, "fit", PLATOON, *SHORT, "--vehicles", "3-4", "--method", "splines")
    document(capsys, "fit", PLATOON, *SHORT, "--method", "splines", "--no-cache")
    runs = document(capsys, "runs")["runs"]
    assert len(runs) == 3
    times = [run["created"] for run in runs]
    assert times == sorted(times, reverse=True)
    (run,) = document(capsys, "runs", "splines", "paper_STUDY")["runs"]
    assert (run["method"], run["window"]) == ("splines", "0–30 s")
    own = fitted["parameters"][0]
    assert run["parameters"] == [{name: own[name] for name in ("alpha", "beta", "tau")}]
    assert main(["runs", "bmw"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert sum("astazero" in line for line in lines) == 2
    assert any("pinn calibrated" in line and "1–3" in line for line in lines)
    assert main(["runs", "nowhere"]) == 0
    assert capsys.readouterr().out.count("\n") == 1
