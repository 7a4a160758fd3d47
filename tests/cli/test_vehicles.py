"""`stability` and `simulate`: what is computed from given parameters."""

from accpinn.cli import main
from accpinn.model.published import ASTAZERO
from accpinn.platoon import simulate_platoon
from accpinn.platoon.leader import Sinusoid
from accpinn.stability.report import stability_report
from tests.support.command import Capture, document

TESLA = ASTAZERO.parameters[3]
GIVEN = ("--alpha", TESLA.alpha, "--beta", TESLA.beta, "--tau", TESLA.tau)
TWO = ("--alpha", 0.1, 0.2, "--beta", 0.2, 0.3, "--tau", 1, 1)


def test_stability_has_the_document_of_the_contract(capsys: Capture) -> None:
    (found,) = document(capsys, "stability", *GIVEN)["vehicles"]
    (expected,) = stability_report(ASTAZERO.parameters[3:]).vehicles
    assert [found[name] for name in ("alpha", "beta", "tau")] == [float(v) for v in TESLA.values]
    assert found["l2"]["criterion"] == expected.l2.value
    assert (found["l2"]["stable"], found["linf_paper"]["stable"]) == (False, True)
    assert found["linf_exact"]["gain"] == expected.linf_gain
    assert found["peak"] == vars(expected.peak)
    assert found["crossover"] == expected.crossover
    assert found["smallest_tau"] == vars(expected.smallest_tau)
    assert all(found[name]["reason"] for name in ("l2", "linf_paper", "linf_exact"))


def test_stability_without_gap_control_has_nulls(capsys: Capture) -> None:
    found = document(capsys, "stability", "--alpha", 0, "--beta", 0.3, "--tau", 1)
    assert found["vehicles"][0]["crossover"] is None
    assert found["vehicles"][0]["smallest_tau"] is None


def test_stability_as_text_gives_reasons_and_the_platoon(capsys: Capture) -> None:
    assert main(["stability", *map(str, TWO)]) == 0
    text = capsys.readouterr().out
    assert "Vehicle 2, L₂ string stability: " in text
    assert "Platoon, Weak L∞ string stability: NO." in text


def test_simulate_has_the_document_of_the_contract(capsys: Capture) -> None:
    options = ("--vehicles", 3, "--frequency", 0.2, "--amplitude", 0.5, "--speed", 22)
    times = ("--settle", 10, "--duration", 400)
    found = document(capsys, "simulate", *GIVEN, *options, *times)
    run = simulate_platoon(ASTAZERO.parameters[[3] * 3], Sinusoid(0.2, 0.5, 22.0, 10.0, 400.0))
    assert found["amplitude"] == run.amplitudes.measured.tolist()
    assert found["predicted_amplitude"] == run.amplitudes.predicted.tolist()
    assert found["minimum_gap"] == run.minimum_gap.tolist()
    assert found["collisions"] == []


def test_simulate_repeats_one_set_eight_times_and_keeps_several(capsys: Capture) -> None:
    assert len(document(capsys, "simulate", *GIVEN)["minimum_gap"]) == 8
    assert len(document(capsys, "simulate", *TWO)["minimum_gap"]) == 2


def test_simulate_names_a_collision(capsys: Capture) -> None:
    options = [str(v) for v in ("--alpha", 0.05, "--beta", 0, "--tau", 1, "--amplitude", 5)]
    found = document(capsys, "simulate", *options)
    assert found["collisions"][0]["follower"] >= 1
    assert found["warnings"]
    assert main(["simulate", *options]) == 0
    assert f"Note: {found['warnings'][0]}" in capsys.readouterr().out
