"""Each public function's docstring has an example that runs and prints what it says."""

import doctest
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

import accpinn
from tests.support.studies import row, write_study

FLAGS = doctest.NORMALIZE_WHITESPACE | doctest.ELLIPSIS
DOCUMENTED_ELSEWHERE = {"download"}
"""Functions whose examples need the network."""
FUNCTIONS = {
    name: value
    for name in accpinn.__all__
    if getattr(value := getattr(accpinn, name), "__name__", "") == name
    and not isinstance(value, type)
}
FUNCTIONS |= {
    method.__qualname__: method
    for method in (
        accpinn.Result.to_frame,
        accpinn.Result.frequency_response,
        accpinn.Result.transfer_functions,
    )
}


@pytest.fixture
def _study(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A folder "study" as a batch leaves it, where examples run."""
    about = (("Volvo", "a"), ("Audi", "b"))
    write_study(tmp_path / "study", *(row(make, sha256=sha, file=sha) for make, sha in about))
    monkeypatch.chdir(tmp_path)


@pytest.mark.usefixtures("registries", "_study")
@pytest.mark.parametrize("name", sorted(FUNCTIONS.keys() - DOCUMENTED_ELSEWHERE))
def test_an_example_prints_what_it_says(name: str) -> None:
    function: Callable[..., Any] = FUNCTIONS[name]
    finder = doctest.DocTestFinder(recurse=False)
    (test,) = finder.find(function, name, module=False, globs={})
    assert test.examples, "there is no example"
    runner = doctest.DocTestRunner(optionflags=FLAGS)
    printed: list[str] = []
    runner.run(test, out=printed.append)
    assert not runner.failures, "".join(printed)
