"""The command line as a process: streams, exit codes, interrupts and kills."""

import io
import os
import re
import signal
import subprocess
import sys
import termios
from contextlib import suppress
from pathlib import Path

import pytest

from accpinn.cli import main
from accpinn.cli.output import interruptible, print_json, show
from tests.support.command import ROOT, SHORT, STUDY, Capture, refused, strict


def command(*arguments: object) -> list[str]:
    return [sys.executable, "-m", "accpinn", *map(str, arguments)]


@pytest.mark.parametrize("text", ["\x1b[31m", "\u202egnp", "\x9b", "\udcff", "two\nlines"])
def test_texts_and_documents_do_not_steer_a_terminal(capsys: Capture, text: str) -> None:
    show(f"a  {text}  1")
    assert all(line.isprintable() for line in capsys.readouterr().out.splitlines())
    print_json({"name": text, "nothing": float("inf")})
    printed = capsys.readouterr().out
    assert all(line.isprintable() for line in printed.splitlines())
    assert strict(printed) == {"name": text, "nothing": None}


def test_any_file_name_is_printed_on_one_line(capsys: Capture) -> None:
    sentence = refused(capsys, 1, "verify", os.fsdecode(b"a\nb\x1b[2Jx\xff.zip")).rstrip("\n")
    assert sentence.isprintable()
    assert all(shown in sentence for shown in ("a\\nb", "\\u001b", "\\udcff"))


def test_a_pipe_without_greek_letters_gets_them_as_utf_8(monkeypatch: pytest.MonkeyPatch) -> None:
    """A pipe on Windows has the code page of the country."""
    pipe = io.TextIOWrapper(io.BytesIO(), "cp1252")
    monkeypatch.setattr(sys, "stdout", pipe)
    assert main(["stability", "--alpha", "1", "--beta", "1", "--tau", "1"]) == 0
    assert "α [1/s²]" in pipe.buffer.getvalue().decode()


class TestAsAProcess:
    @pytest.mark.skipif(not Path("/dev/full").exists(), reason="no device that is always full")
    @pytest.mark.parametrize(
        ("redirected", "unbuffered", "status", "error"),
        [(">&- 2>&-", "", 0, ""), (">/dev/full", "1", 1, "error: standard output: ")],
    )
    def test_streams_that_are_closed_or_full(
        self, redirected: str, unbuffered: str, status: int, error: str
    ) -> None:
        line = f'"{sys.executable}" -m accpinn stability --alpha 1 --beta 1 --tau 1 {redirected}'
        environment = os.environ | {"PYTHONUNBUFFERED": unbuffered}
        done = subprocess.run(
            ["sh", "-c", line], cwd=ROOT, capture_output=True, text=True, env=environment
        )
        assert done.returncode == status
        assert done.stderr.startswith(error)
        assert done.stderr.count("\n") == bool(error)

    def test_a_reader_that_has_seen_enough_is_no_fault_and_loses_nothing(
        self, tmp_path: Path
    ) -> None:
        reading, writing = os.pipe()
        os.close(reading)
        environment = {k: v for k, v in os.environ.items() if k != "PYTHONUNBUFFERED"}
        out = tmp_path / "kept.accpinn.zip"
        fit = command("fit", STUDY, *SHORT, "--method", "least-squares", "--out", out)
        for words in (command("info", STUDY), fit):
            done = subprocess.run(words, cwd=ROOT, stdout=writing, stderr=-1, env=environment)
            assert (done.returncode, done.stderr.partition(b"Saved as")[0]) == (0, b"")
        os.close(writing)
        assert out.stat().st_size > 0

    @pytest.mark.skipif(os.name == "nt", reason="there are no such terminals")
    def test_a_terminal_shows_phases_time_left_and_the_log_likelihood(self) -> None:
        terminal, seen = os.openpty()
        termios.tcsetwinsize(seen, (24, 120))
        running = subprocess.Popen(
            command("fit", STUDY, *SHORT, "--model", "cthp", "--no-cache"),
            cwd=ROOT, stdout=subprocess.DEVNULL, stderr=seen,
        )  # fmt: skip
        os.close(seen)
        shown = b""
        with suppress(OSError):  # which ends it on Linux
            while part := os.read(terminal, 4096):
                shown += part
        os.close(terminal)
        assert running.wait() == 0
        bars = shown.decode()
        assert re.search(r"parameters .*\d:\d\d left, log likelihood -?\d+\.\d, α=\d", bars)
        assert re.search(r"intervals 100%.* 1/1, \d\d:\d\d left", bars)

    @pytest.mark.skipif(os.name == "nt", reason="there are no such terminals")
    def test_an_interrupt_stops_a_training_and_keeps_a_checkpoint(self, tmp_path: Path) -> None:
        long = ("fit", STUDY, *SHORT, "--preset", "paper", "--iterations", 1_000_000)
        terminal, seen = os.openpty()
        termios.tcsetwinsize(seen, (24, 100))
        running = subprocess.Popen(
            command(*long, "--json"), cwd=ROOT, stdout=subprocess.PIPE, stderr=seen
        )
        os.close(seen)
        shown = b""
        while not re.search(rb" [1-9]\d*/1000000, [\d:]+ left", shown):  # training is under way
            shown += os.read(terminal, 4096)
        running.send_signal(signal.SIGINT)
        out, _ = running.communicate(timeout=60)
        os.close(terminal)
        assert running.returncode == 130
        document = strict(out.decode())
        assert document["outcome"] == "stopped"
        assert 0 < document["iterations"] < 1_000_000
        assert len(list(tmp_path.glob("cache/*.state.npz"))) == 1


@pytest.mark.parametrize("kind", [signal.SIGINT, signal.SIGTERM])
def test_an_interrupt_and_a_polite_kill_ask_the_training_to_stop(kind: signal.Signals) -> None:
    before = signal.getsignal(kind)
    with interruptible() as stopped:
        signal.raise_signal(kind)
        assert stopped.is_set()
        with pytest.raises(KeyboardInterrupt):
            signal.raise_signal(kind)
    assert signal.getsignal(kind) is before
