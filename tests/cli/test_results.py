"""`runs`: kept results can be searched; `compare --models`: each model in windows left out."""

from accpinn.cli import main
from tests.support.command import PLATOON, SHORT, STUDY, Capture, document, refused


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


PART = ("--start", 0, "--duration", 120, "--vehicles", "1,2")


def test_the_document_has_every_model_and_which_is_best(capsys: Capture) -> None:
    found = document(capsys, "compare", PLATOON, *PART, "--models", "cthp,cthp-s0")
    (car,) = found["vehicles"]
    assert (car["vehicle"], len(car["windows"])) == (2, 3)
    assert [model["model"] for model in car["models"]] == ["cthp", "cthp-s0"]
    for model in car["models"]:
        assert len(model["gap_rmse"]) == len(model["collided"]) == 3
        assert model["stability"]["speed"] == car["speeds"]["median"]
        for parameter in model["parameters"].values():
            low, high = parameter["interval"]
            assert low < parameter["value"] < high
    errors = {model["model"]: sum(model["gap_rmse"]) for model in car["models"]}
    assert car["best"] == min(errors, key=errors.get)
    assert sum(model["wins"] for model in car["models"]) == 1
    assert car["sentences"]


def test_what_cannot_be_judged_is_refused_in_a_sentence(capsys: Capture) -> None:
    assert "krauss is not known" in refused(capsys, 2, "compare", STUDY, "--models", "krauss")
    asked = ("compare", STUDY, "--models", "cthp", "--leave-out", "standstill")
    assert "--leave-out" in refused(capsys, 2, *asked)
    asked = ("compare", STUDY, "--models", "cthp", "--duration", 60)
    assert "too short to judge a model by" in refused(capsys, 1, *asked)
