"""What is wrong with data, files or usage: one line, the right exit status, nothing printed."""

from pathlib import Path

import pytest

from accpinn import __version__
from accpinn.cli import COMMANDS, main
from accpinn.methods.registry import METHODS
from tests.support.command import PLATOON, STUDY, Capture, refused


@pytest.mark.parametrize("command", ["info", "fit"])
@pytest.mark.parametrize("content", [None, b"", b"\0" * 5000, b"a,b\n1,2\n", bytes(range(256))])
def test_a_file_that_is_missing_or_no_recording(
    capsys: Capture, tmp_path: Path, command: str, content: bytes | None
) -> None:
    path = tmp_path / "odd.csv"
    if content is not None:
        path.write_bytes(content)
    assert "odd.csv" in refused(capsys, 1, command, path, "--json")


def test_an_empty_name_is_not_the_folder(capsys: Capture) -> None:
    assert "No file is named" in refused(capsys, 1, "info", "")


@pytest.mark.parametrize(
    ("command", "options", "kind"),
    [
        ("fit", ["--out", ""], "snapshot"),
        ("report", ["--out", ""], "report"),
        ("export", ["--json", "--sumo", ""], "SUMO"),
    ],
)
def test_nothing_goes_nowhere(capsys: Capture, command: str, options: list[str], kind: str) -> None:
    assert kind in refused(capsys, 1, command, STUDY, *options)


@pytest.mark.parametrize(
    "options",
    [
        ("--start", 5000),
        ("--start", -1),
        ("--start", "inf"),
        ("--duration", 1),
        ("--duration", "nan"),
        ("--windows", "0-60,5000-5060"),
        ("--windows", "all", "--duration", 1000),
        ("--vehicles", "1,3"),
        ("--vehicles", "7,8"),
    ],
)
def test_a_window_or_platoon_that_the_recording_does_not_have(
    capsys: Capture, options: tuple[object, ...]
) -> None:
    assert PLATOON.name in refused(capsys, 1, "fit", PLATOON, *options)


@pytest.mark.parametrize(
    "arguments",
    [
        [],
        ["paint"],
        ["info"],
        *(["fit", str(STUDY), *wrong] for wrong in (
            ["--case", "III"], ["--method", "magic"], ["--preset", "slow"], ["--start", "noon"],
            ["--vehicles", "all"], ["--iterations", "many"],
        )),
    ],
)  # fmt: skip
def test_what_cannot_be_parsed_exits_with_2(capsys: Capture, arguments: list[str]) -> None:
    assert "see python -m accpinn" in refused(capsys, 2, *arguments)


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["fit", STUDY, "--initial", "1,1"], "α,β,τ"),
        (["fit", STUDY, "--model", "idm", "--preset", "fast", "--initial", "1,1,1"], "a,b,T,s0,v0"),
        (
            ["fit", STUDY, "--model", "idm", "--preset", "fast", "--initial", "1,1,1,3,400"],
            "v0 5 to 100",
        ),
        (["fit", STUDY, "--initial", "", "--method", "least-squares"], "α,β,τ"),
        (["fit", STUDY, "--initial=-1,1,1"], "initial"),
        (["fit", STUDY, "--initial", "-1,1,1"], "initial"),
        (["fit", STUDY, "--threads", 10**20], "threads"),
        (["fit", STUDY, "--lbfgs", 5], "paper preset"),
        (["starts", STUDY, "--seeds", 0], "choose 1 to 100"),
        (["fit", STUDY, "--windows", "0-60,60-120", "--start", "10"], "leave --start out"),
        (["fit", STUDY, "--windows", "0-60,60-120", "--duration", "60"], "leave --duration out"),
        (["fit", STUDY, "--windows", "all", "--start", "10"], "leave --start out"),
        (["starts", STUDY, "--seeds", 10**9], "choose 1 to 100"),
        (["stability", "--alpha", 1], "--beta and --tau missing"),
        (["stability", "--snapshot", "x", "--alpha", 1], "not both"),
        (["stability", "--alpha", 1, 2, "--beta", 1, "--tau", 1], "2 of --alpha"),
        (["simulate", "--alpha", 1, "--beta", 1, "--tau", 1, "--vehicles", 101], "1 to 100"),
        (["simulate", "--alpha", 1, 1, "--beta", 1, 1, "--tau", 1, 1, "--vehicles", 3], "not 3"),
        (["simulate", "--alpha", 1, "--beta", 1, "--tau", 1, "--frequency", 0], "frequency"),
    ],
)
def test_settings_out_of_range_exit_with_2_and_a_sentence(
    capsys: Capture, arguments: list[object], words: str
) -> None:
    assert words in refused(capsys, 2, *arguments)


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
