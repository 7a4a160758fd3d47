"""The command line: what it prints where, how it ends, and how it survives being killed."""

import json
import os
import re
import signal
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any, NoReturn

import pytest

from accpinn import __version__
from accpinn.cli import main
from accpinn.cli.fit import _Interrupt, _text, describe
from accpinn.cli.output import print_json, show, table
from accpinn.methods.store import FOLDER_VARIABLE
from accpinn.model.cthp import Parameters
from accpinn.segment.quality import assess_quality
from tests.support.driving import driven
from tests.support.methods import RIVALS as ESTIMATORS

ROOT = Path(__file__).parent.parent
STUDY = ROOT / "sample_data" / "synthetic_paper_study.csv"
PLATOON = ROOT / "sample_data" / "synthetic_astazero_like.csv"
SHORT = ("--duration", "30")


@pytest.fixture(autouse=True)
def cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A cache of the test's own."""
    folder = tmp_path / "cache"
    monkeypatch.setenv(FOLDER_VARIABLE, str(folder))
    return folder


def strict(text: str) -> Any:
    """The one JSON document in ``text``, in which NaN and infinity have no place."""

    def refuse(constant: str) -> NoReturn:
        pytest.fail(f"{constant} is no JSON")

    return json.loads(text, parse_constant=refuse)


def fit(capsys: pytest.CaptureFixture[str], *arguments: object) -> dict[str, Any]:
    assert main(["fit", *map(str, arguments), "--json"]) == 0
    document: dict[str, Any] = strict(capsys.readouterr().out)
    return document


class TestInfo:
    def test_has_the_keys_others_rely_on(self, capsys: pytest.CaptureFixture[str]) -> None:
        assert main(["info", str(PLATOON), "--json"]) == 0
        document = strict(capsys.readouterr().out)
        assert document.keys() >= {
            "campaign",
            "date",
            "acc_flag",
            "distance_setting",
            "samples",
            "duration",
            "sample_time",
            "vehicles",
            "warnings",
        }
        assert (document["samples"], document["duration"]) == (4001, 400.0)
        assert document["sample_time"] == 0.1
        assert [vehicle["index"] for vehicle in document["vehicles"]] == [1, 2, 3, 4, 5]
        for vehicle in document["vehicles"]:
            assert vehicle.keys() >= {"index", "name", "present", "missing", "modes"}
        leader, follower = document["vehicles"][:2]
        assert leader["modes"] is None
        assert follower["modes"]["ACC"] == 4001

    def test_reads_well_without_json(self, capsys: pytest.CaptureFixture[str]) -> None:
        assert main(["info", str(STUDY)]) == 0
        out = capsys.readouterr().out
        assert "synthetic_paper_study.csv" in out
        assert "300 s in 3001 samples of 0.1 s" in out
        assert "2 Synthetic(ACC)" in out


class TestFit:
    def test_has_the_keys_others_rely_on(self, capsys: pytest.CaptureFixture[str]) -> None:
        document = fit(capsys, PLATOON, "--start", 10, *SHORT)
        assert document.keys() >= {
            "method",
            "case",
            "preset",
            "seed",
            "segment",
            "parameters",
            "mae",
            "mean_time_gap",
            "loss",
            "network_weights",
            "iterations",
            "seconds",
            "cached",
            "outcome",
        }
        assert (document["method"], document["case"]) == ("pinn", "II")
        assert (document["preset"], document["seed"]) == ("fast", 0)
        segment = document["segment"]
        assert (segment["start"], segment["duration"], segment["samples"]) == (10, 30, 301)
        assert segment["vehicles"] == [1, 2, 3, 4, 5]
        rows = document["parameters"]
        assert [row["vehicle"] for row in rows] == [2, 3, 4, 5]
        assert rows[3]["name"] == "Tesla(Model3-like)"
        assert all(row["alpha"] > 0 and row["beta"] > 0 and row["tau"] > 0 for row in rows)
        assert len(document["mae"]["v"]) == 5
        assert len(document["mae"]["p"]) == 4
        assert len(document["mean_time_gap"]) == 4
        loss = document["loss"]
        assert loss["total"] == pytest.approx(loss["data"] + loss["physics"])
        assert document["outcome"] == "settled"
        assert document["cached"] is False

    def test_learns_the_truth_of_a_sample(self, capsys: pytest.CaptureFixture[str]) -> None:
        (law,) = fit(capsys, STUDY)["parameters"]
        found = (law["alpha"], law["beta"], law["tau"])
        assert found == pytest.approx((0.08, 0.12, 1.5), rel=0.03)

    def test_the_same_again_comes_from_the_cache(
        self, capsys: pytest.CaptureFixture[str], cache: Path
    ) -> None:
        first, again = fit(capsys, STUDY, *SHORT), fit(capsys, STUDY, *SHORT)
        assert not first["cached"]
        assert again["cached"]
        for key in ("parameters", "loss", "seconds", "iterations", "notes"):
            assert again[key] == first[key]
        assert len(list(cache.glob("*.fit.npz"))) == 1

    def test_without_cache_nothing_is_kept(
        self, capsys: pytest.CaptureFixture[str], cache: Path
    ) -> None:
        for _ in range(2):
            assert not fit(capsys, STUDY, *SHORT, "--no-cache")["cached"]
        assert not cache.exists()

    @pytest.mark.parametrize("method", ["splines", "least-squares"])
    def test_every_other_method(self, capsys: pytest.CaptureFixture[str], method: str) -> None:
        document = fit(capsys, PLATOON, "--method", method, "--vehicles", "1-3", "--case", "I")
        assert document["method"] == method
        assert document["outcome"] == "solved"
        assert document["preset"] is None
        assert document["network_weights"] == 0
        assert (document["mae"] is None) == (method == "least-squares")
        assert len(document["closed_loop_mae"]["p"]) == 2
        first, second = document["parameters"]
        assert first["alpha"] == second["alpha"]

    def test_the_paper_preset_with_its_options(self, capsys: pytest.CaptureFixture[str]) -> None:
        document = fit(
            capsys,
            *(PLATOON, *SHORT, "--preset", "paper", "--iterations", 4, "--lbfgs", 3),
            *("--initial", "0.1,0.2,1.3", "--seed", 7, "--threads", 1, "--case", "II"),
        )
        assert document["network_weights"] == 7989
        assert document["iterations"] == 7
        assert document["seed"] == 7
        assert document["outcome"] == "finished"
        assert document["loss"].keys() >= {"test_data", "test_physics"}
        for row in document["parameters"]:
            assert (row["alpha"], row["beta"], row["tau"]) != (0.1, 0.2, 1.3)
            assert row["tau"] == pytest.approx(1.3, abs=0.3)

    def test_vehicles_are_those_named(self, capsys: pytest.CaptureFixture[str]) -> None:
        document = fit(capsys, PLATOON, *SHORT, "--vehicles", "3,4", "--method", "splines")
        assert document["segment"]["vehicles"] == [3, 4]
        assert [row["vehicle"] for row in document["parameters"]] == [4]

    def test_what_is_undetermined_is_null(
        self, capsys: pytest.CaptureFixture[str], tmp_path: Path
    ) -> None:
        """Vehicles that never move: no headway, no time gap, no closed loop, and no NaN."""
        lines = STUDY.read_text().splitlines()
        still = [f"{0.1 * k:.1f},0.0000,0.0000,5.0000,ACC" for k in range(301)]
        path = tmp_path / "still.csv"
        path.write_text("\n".join([*lines[:6], *still]) + "\n")
        document = fit(capsys, path, *SHORT, "--method", "least-squares")
        (law,) = document["parameters"]
        assert (law["alpha"], law["tau"]) == (0, None)
        assert document["mean_time_gap"] == [None]
        assert document["closed_loop_mae"] is None
        assert document["notes"]

    def test_progress_goes_to_standard_error(self, capsys: pytest.CaptureFixture[str]) -> None:
        assert main(["fit", str(STUDY), *SHORT, "--json"]) == 0
        printed = capsys.readouterr()
        strict(printed.out)
        assert "it/s" in printed.err
        assert "α=" in printed.err

    def test_reads_well_without_json(self, capsys: pytest.CaptureFixture[str]) -> None:
        assert main(["fit", str(STUDY), *SHORT]) == 0
        out = capsys.readouterr().out
        assert "synthetic_paper_study.csv, 0 to 30 s, pinn, Case II" in out
        assert "α (1/s²)" in out
        assert "gap MAE, surrogate (m)" in out
        assert "gap MAE, closed loop (m)" in out
        assert "Settled:" in out

    def test_a_collision_stands_beside_the_closed_loop_errors(self) -> None:
        segment = driven(duration=100.0)
        found = ESTIMATORS["least-squares"](segment, "II")
        swaying = replace(found, parameters=(Parameters(0.05, 0.0, 1.0),))
        (said,) = describe(segment, swaying, assess_quality(segment))["incidents"]
        assert "runs into the vehicle ahead at" in said
        assert said in _text(segment, swaying, assess_quality(segment))
        assert describe(segment, found, assess_quality(segment))["incidents"] == []

    def test_a_cache_that_cannot_be_used_is_said_once(
        self, capsys: pytest.CaptureFixture[str], cache: Path
    ) -> None:
        cache.write_text("a file, no folder")
        notes = fit(capsys, STUDY, *SHORT)["notes"]
        assert [("no folder" in note) for note in notes if "cache" in note] == [True]


class TestErrors:
    def refused(self, capsys: pytest.CaptureFixture[str], *arguments: object) -> str:
        """The sentence of a refusal, and nothing else printed."""
        assert main(list(map(str, arguments))) == 1
        printed = capsys.readouterr()
        assert printed.out == ""
        assert printed.err.startswith("error: ")
        assert printed.err.count("\n") == 1
        return printed.err

    @pytest.mark.parametrize("command", ["info", "fit"])
    def test_a_missing_file(self, capsys: pytest.CaptureFixture[str], command: str) -> None:
        assert "nowhere.csv" in self.refused(capsys, command, "nowhere.csv", "--json")

    def test_no_name_is_no_folder(self, capsys: pytest.CaptureFixture[str]) -> None:
        assert "No file is named" in self.refused(capsys, "info", "")

    @pytest.mark.parametrize("command", ["info", "fit"])
    @pytest.mark.parametrize("content", [b"", b"\0" * 5000, b"a,b\n1,2\n", bytes(range(256))])
    def test_a_file_that_is_no_recording(
        self, capsys: pytest.CaptureFixture[str], tmp_path: Path, command: str, content: bytes
    ) -> None:
        path = tmp_path / "odd.csv"
        path.write_bytes(content)
        assert "odd.csv" in self.refused(capsys, command, path, "--json")

    @pytest.mark.parametrize(
        "options",
        [
            ("--start", 5000),
            ("--start", -1),
            ("--duration", 1),
            ("--duration", "nan"),
            ("--duration", 0),
            ("--start", "inf"),
            ("--vehicles", "1,3"),
            ("--vehicles", "7,8"),
        ],
    )
    def test_a_window_or_platoon_the_recording_has_not(
        self, capsys: pytest.CaptureFixture[str], options: tuple[str, object]
    ) -> None:
        assert PLATOON.name in self.refused(capsys, "fit", PLATOON, *options)

    def test_real_damaged_recordings(
        self, capsys: pytest.CaptureFixture[str], openacc_dir: Path
    ) -> None:
        damaged = sorted((openacc_dir / "corrupt").iterdir())
        assert damaged
        for path in damaged:
            assert path.name in self.refused(capsys, "info", path, "--json")


class TestUsage:
    @pytest.mark.parametrize(
        "arguments",
        [
            [],
            ["paint"],
            ["info"],
            ["fit", str(STUDY), "--case", "III"],
            ["fit", str(STUDY), "--method", "magic"],
            ["fit", str(STUDY), "--preset", "slow"],
            ["fit", str(STUDY), "--start", "noon"],
            ["fit", str(STUDY), "--vehicles", "all"],
            ["fit", str(STUDY), "--iterations", "many"],
        ],
    )
    def test_what_cannot_be_understood_exits_with_2(
        self, capsys: pytest.CaptureFixture[str], arguments: list[str]
    ) -> None:
        with pytest.raises(SystemExit) as ended:
            main(arguments)
        assert ended.value.code == 2
        printed = capsys.readouterr()
        assert printed.out == ""
        assert printed.err.startswith("error: ")
        assert printed.err.count("\n") == 1
        assert "see python -m accpinn" in printed.err

    def test_what_only_the_network_has_is_said_to_have_no_effect(
        self, capsys: pytest.CaptureFixture[str]
    ) -> None:
        options = ["--method", "least-squares", "--seed", "0", "--preset", "fast", "--json"]
        assert main(["fit", str(STUDY), *options]) == 0
        printed = capsys.readouterr()
        assert json.loads(printed.out)["method"] == "least-squares"
        assert "--preset, --seed has no effect" in printed.err

    @pytest.mark.parametrize(
        ("options", "sentence"),
        [
            (["--initial", "1,1"], "α,β,τ"),
            (["--initial=-1,1,1"], "initial"),
            (["--initial", "-1,1,1"], "initial"),
            (["--iterations", "0"], "iterations"),
            (["--seed", "-1"], "seed"),
            (["--threads", "0"], "threads"),
            (["--threads", "100000"], "threads"),
            (["--threads", "99999999999999999999"], "threads"),
            (["--lbfgs", "5"], "paper preset"),
        ],
    )
    def test_settings_out_of_range_exit_with_2_and_a_sentence(
        self, capsys: pytest.CaptureFixture[str], options: list[str], sentence: str
    ) -> None:
        assert main(["fit", str(STUDY), *options]) == 2
        printed = capsys.readouterr()
        assert printed.out == ""
        assert printed.err.startswith("error: ")
        assert printed.err.count("\n") == 1
        assert sentence in printed.err

    @pytest.mark.parametrize("seeds", [0, 101, 1_000_000_000])
    def test_starts_are_bounded(self, capsys: pytest.CaptureFixture[str], seeds: int) -> None:
        assert main(["starts", str(STUDY), "--seeds", str(seeds)]) == 2
        assert "choose 1 to 100" in capsys.readouterr().err

    def test_help_and_version(self, capsys: pytest.CaptureFixture[str]) -> None:
        for arguments in (["--help"], ["fit", "--help"], ["--version"]):
            with pytest.raises(SystemExit) as ended:
                main(arguments)
            assert ended.value.code == 0
        assert __version__ in capsys.readouterr().out


@pytest.mark.parametrize("text", ["\x1b[31m", "\u202egnp", "\x9b", "\udcff", "two\nlines"])
def test_tables_and_documents_do_not_steer_a_terminal(
    capsys: pytest.CaptureFixture[str], text: str
) -> None:
    show(table(["a", "b"], [[text, "1"]]))
    assert all(line.isprintable() for line in capsys.readouterr().out.splitlines())
    print_json({"name": text})
    printed = capsys.readouterr().out
    assert all(line.isprintable() for line in printed.splitlines())
    assert strict(printed) == {"name": text}


def command(*arguments: object) -> list[str]:
    return [sys.executable, "-m", "accpinn", *map(str, arguments)]


class TestAsAProcess:
    def test_exit_codes_and_streams(self) -> None:
        found = [
            subprocess.run(command(*arguments), cwd=ROOT, capture_output=True, text=True)
            for arguments in (
                ("info", STUDY, "--json"),
                ("info", "nowhere.csv"),
                ("fit", STUDY, "--case", "III"),
            )
        ]
        assert [done.returncode for done in found] == [0, 1, 2]
        assert strict(found[0].stdout)["samples"] == 3001
        assert found[0].stderr == ""
        assert found[1].stderr.splitlines() == [found[1].stderr.rstrip()]
        assert not any("Traceback" in done.stderr for done in found)

    @pytest.mark.skipif(not Path("/dev/full").exists(), reason="no device that is always full")
    @pytest.mark.parametrize("unbuffered", ["", "1"])
    def test_an_output_that_is_full_is_said_in_one_line(self, unbuffered: str) -> None:
        with open("/dev/full", "w") as full:
            done = subprocess.run(
                command("info", STUDY),
                cwd=ROOT,
                stdout=full,
                stderr=subprocess.PIPE,
                text=True,
                env=os.environ | {"PYTHONUNBUFFERED": unbuffered},
            )
        assert done.returncode == 1
        assert done.stderr.startswith("error: standard output: ")
        assert done.stderr.count("\n") == 1

    def test_a_reader_that_has_seen_enough_is_no_fault(self) -> None:
        reading, writing = os.pipe()
        os.close(reading)
        environment = {k: v for k, v in os.environ.items() if k != "PYTHONUNBUFFERED"}
        done = subprocess.run(
            command("info", STUDY), cwd=ROOT, stdout=writing, stderr=-1, env=environment
        )
        os.close(writing)
        assert (done.returncode, done.stderr) == (0, b"")

    @pytest.mark.skipif(os.name == "nt", reason="needs a POSIX shell")
    @pytest.mark.parametrize(("closed", "status"), [(">&-", 0), ("2>&-", 0), (">&- 2>&-", 0)])
    def test_closed_streams_are_borne(self, closed: str, status: int) -> None:
        line = f'"{sys.executable}" -m accpinn stability --alpha 1 --beta 1 --tau 1 {closed}'
        done = subprocess.run(["sh", "-c", line], cwd=ROOT, capture_output=True)
        assert (done.returncode, done.stderr) == (status, b"")

    @pytest.mark.skipif(os.name == "nt", reason="names are no bytes there")
    @pytest.mark.parametrize(
        ("name", "shown"), [(b"x\xff.zip", "\\udcff"), (b"a\nb", "a\\nb"), (b"\x1b[2J", "\\u001b")]
    )
    def test_any_file_name_is_printed_on_one_line(self, name: bytes, shown: str) -> None:
        done = subprocess.run([*command("verify"), name], cwd=ROOT, stdout=-1, stderr=-1, text=True)
        assert (done.returncode, done.stdout) == (1, "")
        assert done.stderr.splitlines() == [done.stderr.rstrip("\n")]
        assert shown in done.stderr
        assert done.stderr.rstrip("\n").isprintable()

    def test_help_imports_no_command(self) -> None:
        code = (
            "import sys, accpinn.cli\n"
            "try: accpinn.cli.main(['--help'])\n"
            "except SystemExit: print(sorted({'numpy', 'pandas'} & set(sys.modules)))\n"
        )
        done = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True)
        assert done.stdout.decode().splitlines()[-1] == "[]"

    def test_a_pipe_without_greek_letters_gets_them_as_utf_8(self) -> None:
        """As on Windows, where a pipe has the code page of the country."""
        done = subprocess.run(
            command("fit", STUDY, "--method", "splines"),
            cwd=ROOT,
            capture_output=True,
            env=os.environ | {"PYTHONIOENCODING": "cp1252"},
        )
        assert done.returncode == 0
        assert "α (1/s²)" in done.stdout.decode()

    def test_an_interrupt_stops_keeps_a_checkpoint_and_says_so(self, cache: Path) -> None:
        long = ("fit", STUDY, *SHORT, "--preset", "paper", "--iterations", 1_000_000)
        running = subprocess.Popen(
            command(*long, "--json"), cwd=ROOT, stdout=subprocess.PIPE, stderr=subprocess.PIPE
        )
        assert running.stderr is not None
        shown = b""
        while not re.search(rb" [1-9]\d*/1000000 ", shown):  # training is under way
            piece = os.read(running.stderr.fileno(), 4096)
            assert piece, "it ended before it was interrupted"
            shown += piece
        running.send_signal(signal.SIGINT)
        out, _ = running.communicate(timeout=60)
        assert running.returncode == 130
        document = strict(out.decode())
        assert document["outcome"] == "stopped"
        assert 0 < document["iterations"] < 1_000_000
        assert len(list(cache.glob("*.state.npz"))) == 1


@pytest.mark.parametrize("kind", [signal.SIGINT, signal.SIGTERM])
def test_an_interrupt_and_a_polite_kill_ask_the_training_to_stop(kind: signal.Signals) -> None:
    before = signal.getsignal(kind)
    with _Interrupt() as interrupted:
        signal.raise_signal(kind)
        assert interrupted.raised
        with pytest.raises(KeyboardInterrupt):
            signal.raise_signal(kind)
    assert signal.getsignal(kind) is before


KILLED = """
import sys
from accpinn.cli import (main)
from accpinn.methods.pinn import (training)
from accpinn.methods.store import (Store)

keep = Store.save_state

def save_state(self, key, state, say=None):
    keep(self, key, state, say)
    print("kept", int(state["history.rows"][-1][0]), flush=True)

training.CHECKPOINT_EVERY = 0.1
Store.save_state = save_state
main(sys.argv[1:])
"""


def test_a_killed_training_continues_from_its_last_checkpoint(
    capsys: pytest.CaptureFixture[str], cache: Path
) -> None:
    request = ("fit", str(STUDY), *SHORT, "--preset", "paper", "--threads", "1")
    running = subprocess.Popen(
        [sys.executable, "-c", KILLED, *request, "--iterations", "1000000"],
        cwd=ROOT,
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        text=True,
    )
    assert running.stdout is not None
    kept = [int(running.stdout.readline().split()[1]) for _ in range(3)]
    running.kill()
    rest = running.stdout.read()
    assert running.wait() == -signal.SIGKILL
    running.stdout.close()
    kept += [int(line.split()[1]) for line in rest.splitlines()]
    assert kept[0] > 0

    planned = kept[-1] + 200
    assert main([*request, "--iterations", str(planned), "--json"]) == 0
    document = strict(capsys.readouterr().out)
    (note,) = [note for note in document["notes"] if note.startswith("Continued")]
    continued = int(note.split()[3].replace(",", ""))
    # At most the checkpoint that was being written when the process died is newer.
    assert continued >= kept[-1]
    assert document["iterations"] == planned
    assert document["outcome"] == "finished"
    assert not list(cache.glob("*.damaged"))
    assert kept[-1] - kept[-2] < 1000, "a tenth of a second's work, so little is lost"
