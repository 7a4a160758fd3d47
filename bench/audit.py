"""Known weaknesses of the locked packages: `python -m bench.audit`, which is `make audit`.

Names and versions of the lock files, and of PyTorch, are sent to the Open Source Vulnerabilities
database (osv.dev); nothing else is. The exit status is 0 where it knows of none, 1 where it knows
of some, and 2 where it was not reached, which is no answer.
"""

import os
import re
import sys
from collections.abc import Iterator, Sequence
from typing import Any

import requests
from packaging.requirements import Requirement

from accpinn.units import Seconds
from bench.lock import APP, BY_VERSION, DEV, lock_of, name_of, requirements

DATABASE = "https://api.osv.dev"
MIRROR_VARIABLE = "ACCPINN_ADVISORIES"
"""Environment variable with the address of a mirror of the database."""
PATIENCE: Seconds = 30.0


Package = tuple[str, str]
"""A name and a version."""


def locked(only_here: bool = False) -> list[Package]:
    """Each package with its version; of some Pythons another, and ``only_here`` this one's."""
    exact = [line for line in requirements(APP) if name_of(line) in BY_VERSION]
    lines = [line for path in (APP, DEV) for line in lock_of(path).read_text().splitlines()]
    packages: dict[Package, None] = {}
    for line in (*exact, *lines):
        if not re.match(r"[\w.-]+==", line):
            continue
        requirement = Requirement(line.partition("\\")[0].strip())
        if not only_here or requirement.marker is None or requirement.marker.evaluate():
            [version] = requirement.specifier
            packages[name_of(requirement.name), version.version] = None
    return list(packages)


def advisories(packages: Sequence[Package], database: str) -> Iterator[tuple[Package, str]]:
    """Each package with the name of an advisory on its version.

    Raises:
        requests.RequestException: where the database is not reached.
    """
    queries: list[dict[str, Any]] = [
        {"package": {"name": name, "ecosystem": "PyPI"}, "version": version}
        for name, version in packages
    ]
    answer = requests.post(f"{database}/v1/querybatch", json={"queries": queries}, timeout=PATIENCE)
    answer.raise_for_status()
    results = answer.json()["results"]
    if len(results) != len(packages):
        raise requests.RequestException("an answer of another length")
    for package, result in zip(packages, results, strict=True):
        for advisory in result.get("vulns", ()):
            yield package, advisory["id"]


def main() -> int:
    """Print a line for each advisory."""
    packages, database = locked(), os.environ.get(MIRROR_VARIABLE) or DATABASE
    try:
        listed = sorted(set(advisories(packages, database)))
    except (requests.RequestException, ValueError, KeyError, TypeError) as fault:
        print(
            f"Nothing was checked: {database} gave no answer ({type(fault).__name__}); try again"
            " with a connection to the internet.",
            file=sys.stderr,
        )
        return 2
    for (name, version), advisory in listed:
        print(f"{name} {version}: {advisory}, see {DATABASE.replace('api.', '')}/{advisory}")
    print(f"{len(packages)} packages checked, {len(listed)} advisories.")
    return 1 if listed else 0


if __name__ == "__main__":
    sys.exit(main())
