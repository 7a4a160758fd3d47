"""Faults of data, files or usage end in one line and the right exit status."""

import pytest

from accpinn import __version__
from accpinn.cli import COMMANDS, main
from accpinn.methods.registry import METHODS
from tests.support.command import PLATOON, STUDY, Capture, refused

OF_PLATOON = (
    ("--start", 5000), ("--start", -1), ("--start", "inf"), ("--duration", 1),
    ("--duration", "nan"), ("--windows", "0-60,5000-5060"),
    ("--windows", "all", "--duration", 1000), ("--vehicles", "1,3"), ("--vehicles", "7,8"),
)  # fmt: skip
"""Windows and platoons that the recording does not have."""
UNREAD = (
    [], ["paint"], ["info"],
    *(["fit", STUDY, *wrong] for wrong in (
        ["--case", "III"], ["--preset", "slow"], ["--start", "noon"], ["--vehicles", "all"],
        ["--iterations", "many"], ["--fixed", "s0"],
    )),
)  # fmt: skip
"""Command lines that cannot be parsed."""
FIT, SETS = ("fit", STUDY), ("--beta", 1, "--tau", 1)
JUDGE = ("compare", STUDY, "--models")


@pytest.mark.parametrize(
    ("status", "words", "arguments"),
    [
        (1, "No file is named", ["info", ""]),
        (1, "snapshot", [*FIT, "--out", ""]),
        (1, "report", ["report", STUDY, "--out", ""]),
        (1, "SUMO", ["export", STUDY, "--json", "--sumo", ""]),
        *((1, PLATOON.name, ["fit", PLATOON, *options]) for options in OF_PLATOON),
        *((2, " --help", arguments) for arguments in UNREAD),
        (2, "α,β,τ", [*FIT, "--initial", "1,1"]),
        (2, "a,b,T,s0,v0", [*FIT, "--model", "idm", "--preset", "fast", "--initial", "1,1,1"]),
        (2, "v0 5 to 100",
         [*FIT, "--model", "idm", "--preset", "fast", "--initial", "1,1,1,3,400"]),
        (2, "α,β,τ", [*FIT, "--initial", "", "--method", "least-squares"]),
        (2, "initial", [*FIT, "--initial=-1,1,1"]),
        (2, "initial", [*FIT, "--initial", "-1,1,1"]),
        (2, "threads", [*FIT, "--threads", 10**20]),
        (2, "paper preset", [*FIT, "--lbfgs", 5]),
        (2, "leave start out", [*FIT, "--windows", "0-60,60-120", "--start", "10"]),
        (2, "leave duration out", [*FIT, "--windows", "0-60,60-120", "--duration", "300"]),
        (2, "leave start out", [*FIT, "--windows", "all", "--start", "0"]),
        (2, "magic is not known; choose pinn, least-squares", [*FIT, "--method", "magic"]),
        (2, "cannot estimate idm; it can cthp", [*FIT, "--preset", "calibrated", "--model", "idm"]),
        (2, "choose the method simulation or the PiNN's preset fast or paper",
         [*FIT, "--preset", "calibrated", "--model", "idm"]),
        (2, "cannot estimate idm; it can cthp",
         [*FIT, "--method", "least-squares", "--model", "idm"]),
        (2, "the method splines has none", [*FIT, "--method", "splines", "--preset", "fast"]),
        (2, "leave maximum-likelihood out",
         [*FIT, "--method", "maximum-likelihood", "--preset", "fast"]),
        (2, "s0 is given twice", [*FIT, "--fixed", "s0=1", "--hold", "s0=2"]),
        (2, "cthp-s0-delay has s0, delay to fix", [*FIT, "--fixed", "T=1"]),
        (2, "magic is not known; choose pinn, pinn-fast, pinn-paper",
         ["compare", STUDY, "--methods", "pinn,magic"]),
        (2, "choose 1 to 100", ["starts", STUDY, "--seeds", 0]),
        (2, "choose 1 to 100", ["starts", STUDY, "--seeds", 10**9]),
        (2, "--beta and --tau missing", ["stability", "--alpha", 1]),
        (2, "not both", ["stability", "--snapshot", "x", "--alpha", 1]),
        (2, "--s0 or", ["stability", "--snapshot", "x", "--s0", 3]),
        (2, "2 of --alpha", ["stability", "--alpha", 1, 2, *SETS]),
        (2, "1 to 100", ["simulate", "--alpha", 1, *SETS, "--vehicles", 101]),
        (2, "not 3",
         ["simulate", "--alpha", 1, 1, "--beta", 1, 1, "--tau", 1, 1, "--vehicles", 3]),
        (2, "frequency", ["simulate", "--alpha", 1, *SETS, "--frequency", 0]),
        (2, "choose from catching-up, manual, standstill", [*FIT, "--leave-out", "car-following"]),
        (2, "krauss is not known", [*JUDGE, "krauss"]),
        (2, "--exclude", [*JUDGE, "cthp", "--leave-out", "standstill"]),
        (2, "seed: the method splines has no such", [*FIT, "--method", "splines", "--seed", "0"]),
        (2, "width: the method", [*FIT, "--method", "splines", "--settings", "width=9"]),
        (2, "seed is given twice", [*FIT, "--seed", "1", "--settings", "seed=2"]),
        (2, "depth is not known", [*FIT, "--settings", "depth=2"]),
        (2, "sets nothing; write --settings", [*FIT, "--settings", "width"]),
        (2, "preset: the method splines", [*FIT, "--method", "splines", "--preset", "fast"]),
        (2, "name: only a snapshot", [*FIT, "--name", "A car"]),
        (2, "model: nowhere.py cannot be read", [*FIT, "--model", "nowhere.py"]),
        (2, "host: it needs an --address", ["app", "--host", "lab"]),
        (1, "too short to judge models by", [*JUDGE, "cthp", "--duration", 50]),
        (2, "leave --fixed and --case out", [*JUDGE, "idm", "--fixed", "T=0.5", "--case", "I"]),
    ],
)  # fmt: skip
def test_wrong_usage_ends_in_one_line_with_its_exit_status(
    capsys: Capture, status: int, words: str, arguments: list[object]
) -> None:
    assert words in refused(capsys, status, *arguments)


def test_help_explains_commands_and_methods(capsys: Capture) -> None:
    def printed(*arguments: str) -> str:
        with pytest.raises(SystemExit) as ended:
            main(arguments)
        assert ended.value.code == 0
        return capsys.readouterr().out

    assert __version__ in printed("--version")
    assert all(command in printed("--help") for command in COMMANDS)
    for command in COMMANDS:
        shown = printed(command, "--help")
        assert "Exit status" in " ".join(shown.split())
        assert max(map(len, shown.splitlines())) <= 100
        if command in ("fit", "compare"):
            assert all(method.summary in shown for method in METHODS.values())
            assert "maximum-likelihood" not in shown
