"""Known weaknesses of the locked packages: `python -m bench.audit`, which is `make audit`.

Names and versions of the lock files, and of PyTorch, are sent to the Open Source Vulnerabilities
database (osv.dev); nothing else is. The exit status is 0 where it knows of none, 1 where it knows
of some, and 2 where it was not reached, which is no answer.
"""

import os
import re
import sys
from collections.abc import Iterator
from typing import Any

import requests

from accpinn.units import Seconds
from bench.lock import APP, BY_VERSION, DEV, lock_of, name_of, requirements

DATABASE = "https://api.osv.dev"
MIRROR_VARIABLE = "ACCPINN_ADVISORIES"
"""Environment variable with the address of a mirror of the database."""
PATIENCE: Seconds = 30.0


def locked() -> dict[str, str]:
    """The version of each package."""
    exact = [line for line in requirements(APP) if name_of(line) in BY_VERSION]
    lines = [line for path in (APP, DEV) for line in lock_of(path).read_text().splitlines()]
    pairs = (re.match(r"([\w.-]+)==([^\s;]+)", line) for line in (*exact, *lines))
    return {name_of(pair[1]): pair[2] for pair in pairs if pair}


def advisories(versions: dict[str, str], database: str) -> Iterator[tuple[str, str]]:
    """Each package with the name of an advisory on its version.

    Raises:
        requests.RequestException: where the database is not reached.
    """
    names = list(versions)
    queries: list[dict[str, Any]] = [
        {"package": {"name": name, "ecosystem": "PyPI"}, "version": versions[name]}
        for name in names
    ]
    answer = requests.post(f"{database}/v1/querybatch", json={"queries": queries}, timeout=PATIENCE)
    answer.raise_for_status()
    results = answer.json()["results"]
    if len(results) != len(names):
        raise requests.RequestException("an answer of another length")
    for name, result in zip(names, results, strict=True):
        for advisory in result.get("vulns", ()):
            yield name, advisory["id"]


def main() -> int:
    """Print a line for each advisory."""
    versions, database = locked(), os.environ.get(MIRROR_VARIABLE) or DATABASE
    try:
        known = sorted(set(advisories(versions, database)))
    except (requests.RequestException, ValueError, KeyError, TypeError) as fault:
        print(
            f"Nothing was checked: {database} gave no answer ({type(fault).__name__}); try again"
            " with a connection to the internet.",
            file=sys.stderr,
        )
        return 2
    for name, advisory in known:
        print(f"{name} {versions[name]}: {advisory}, see {DATABASE.replace('api.', '')}/{advisory}")
    print(f"{len(versions)} packages checked, {len(known)} advisories.")
    return 1 if known else 0


if __name__ == "__main__":
    sys.exit(main())
