"""Lock the versions and hashes of all packages: `python -m bench.lock`, which is `make lock`.

`requirements.lock` has what the app needs, signing in included, and `requirements-dev.lock` what
tests and checks need besides, each with the hashes of its files for every platform, as uv resolves
them. A version that is locked stays unless --upgrade is given. PyTorch is left to the exact version
in requirements.txt: its builds, and the CUDA packages that some of them need, differ by platform.
"""

import argparse
import re
import subprocess
import sys
from importlib.metadata import requires
from pathlib import Path

ROOT = Path(__file__).parent.parent
APP, DEV = ROOT / "requirements.txt", ROOT / "requirements-dev.txt"
SIGN_IN = "streamlit[auth]"
"""Packages of a server that asks its users to sign in."""
BY_VERSION = ("torch",)
"""Packages without hashes."""


def lock_of(path: Path) -> Path:
    """The lock file of a list of requirements."""
    return path.with_suffix(".lock")


def requirements(path: Path) -> list[str]:
    """The requirements in a file and those it includes, without comments."""
    lines = [line.partition("#")[0].strip() for line in path.read_text().splitlines()]
    listed = [line for line in lines if line and not line.startswith("-")]
    included = [line.removeprefix("-r ") for line in lines if line.startswith("-r ")]
    return listed + [line for name in included for line in requirements(path.parent / name)]


def name_of(requirement: str) -> str:
    """The package that a line of requirements, or of a lock file, is of."""
    name = re.match(r"[\w.-]+", requirement)
    return re.sub(r"[-_.]+", "-", name[0]).lower() if name else ""


def to_lock(path: Path) -> list[str]:
    """The requirements whose files have hashes; of the others what they need on every platform."""
    lines = [line for line in requirements(path) if name_of(line) not in BY_VERSION]
    needed = [line for name in BY_VERSION for line in requires(name) or () if ";" not in line]
    return [*lines, SIGN_IN, *needed]


def main(arguments: list[str] | None = None) -> int:
    """Write both lock files; 1 where the versions cannot be resolved."""
    parser = argparse.ArgumentParser(prog="python -m bench.lock", description=__doc__)
    parser.add_argument("--upgrade", action="store_true", help="take the newest versions allowed")
    options = parser.parse_args(arguments)
    for path in (APP, DEV):
        lock = lock_of(path)
        command = [
            sys.executable, "-m", "uv", "pip", "compile", "-", "--quiet", "--universal",
            "--python-version=3.11", "--generate-hashes", "--no-annotate",
            "--custom-compile-command=make lock", f"--output-file={lock.name}",
        ]  # fmt: skip
        for name in BY_VERSION:
            command.append(f"--no-emit-package={name}")
        if path is DEV:
            command.append(f"--constraints={lock_of(APP).name}")
        if options.upgrade:
            command.append("--upgrade")
        requested = "\n".join(to_lock(path))
        if subprocess.run(command, input=requested, text=True, cwd=ROOT, check=False).returncode:
            return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
