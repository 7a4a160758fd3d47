"""The command line as tests call it: in this process, with its one JSON document read strictly."""

import json
import subprocess
import sys
from pathlib import Path
from typing import Any, NoReturn

import pytest

from accpinn.cli import main

Capture = pytest.CaptureFixture[str]
ROOT = Path(__file__).parents[2]
STUDY = ROOT / "sample_data" / "synthetic_paper_study.csv"
PLATOON = ROOT / "sample_data" / "synthetic_astazero_like.csv"
THREE = ROOT / "sample_data" / "synthetic_vicolungo_like.csv"
SHORT = ("--duration", "30")


def strict(text: str) -> Any:
    """The one JSON document in ``text``, in which NaN and infinity have no place."""

    def refuse(constant: str) -> NoReturn:
        pytest.fail(f"{constant} is no JSON")

    return json.loads(text, parse_constant=refuse)


def document(capsys: Capture, *arguments: object) -> dict[str, Any]:
    """What a command prints with --json."""
    assert main([*map(str, arguments), "--json"]) == 0
    return strict(capsys.readouterr().out)


def refused(capsys: Capture, status: int, *arguments: object) -> str:
    """The one line on standard error of a command that fails with that status."""
    try:
        ended = main(list(map(str, arguments)))
    except SystemExit as refusal:  # of a line that cannot be parsed
        ended = refusal.code
    assert ended == status
    printed = capsys.readouterr()
    assert printed.out == ""
    assert printed.err.startswith("error: ")
    assert printed.err.count("\n") == 1
    return printed.err


def loaded_after(code: str, *names: str) -> set[str]:
    """Which of these modules a fresh interpreter has loaded after running the code."""
    code += f"\nimport sys; print(*set({names!r}) & sys.modules.keys())"
    found = subprocess.run(
        [sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=True
    )
    return set(found.stdout.splitlines()[-1].split())
