"""A user's script that registers models and methods, as `batch` and the command line take it.

Its text travels with each window of a batch, so a worker on another machine needs no copy of it. It
is run once in each process, and never read from a study or a snapshot.
"""

import os
import sys
from contextlib import redirect_stdout
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Self

from accpinn.errors import AccpinnError, ConfigError
from accpinn.methods.registry import METHODS
from accpinn.model.registry import FOLLOWING
from accpinn.storage import reported

ENDING = ".py"
"""Ending by which a model's script is told from a model's key."""


@dataclass(frozen=True)
class Script:
    """The text of a script."""

    name: str
    text: str

    @classmethod
    def read(cls, path: str | os.PathLike[str]) -> Self:
        """The script in a file.

        Raises:
            ConfigError: when it cannot be read.
        """
        sentence = "model: {} cannot be read ({}); name a script that calls register_model."
        with reported(lambda reason: ConfigError(sentence.format(path, reason))):
            content = Path(path).read_bytes()
        try:
            return cls(Path(path).name, content.decode())
        except UnicodeDecodeError:
            raise ConfigError(sentence.format(path, "it is no text")) from None

    def run(self) -> str:
        """Run it, unless this process did so before; returns the key of the first model it adds.

        Raises:
            ConfigError: when it fails, or registers no model.
        """
        models, _ = _run(self)
        if not models:
            raise ConfigError(
                f"{self.name}: it registers no model; let it call accpinn.register_model."
            )
        return models[0]

    def names(self) -> tuple[str, ...]:
        """Run it likewise; returns the keys of the models and of the methods that it adds.

        Raises:
            ConfigError: when it fails, or registers neither.
        """
        models, methods = _run(self)
        if not models + methods:
            raise ConfigError(
                f"{self.name}: it registers neither model nor method; let it call"
                " accpinn.register_model or accpinn.register_method."
            )
        return models + methods


@cache
def _run(script: Script) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Run it; returns the keys of the models, without their variants, and of the methods."""
    before = {**FOLLOWING, **METHODS}
    try:
        with redirect_stdout(sys.stderr):  # where a result is printed, nothing else is
            exec(compile(script.text, script.name, "exec"), {"__name__": "accpinn_script"})
    except AccpinnError as fault:
        raise ConfigError(f"{script.name}: {fault}") from None
    except (Exception, SystemExit) as fault:
        raise ConfigError(
            f"{script.name}: it fails with {type(fault).__name__}: {str(fault)[:120]}; mend it."
        ) from None
    new = [key for key, model in FOLLOWING.items() if before.get(key) is not model]
    late = {f"{key}-{term}" for key in new for term in ("lag", "delay")}
    methods = [key for key, method in METHODS.items() if before.get(key) is not method]
    return tuple(key for key in new if key not in late), tuple(methods)


def model_key(model: str) -> str:
    """The key that a model's key or its script stands for; the script is run."""
    return Script.read(model).run() if model.endswith(ENDING) else model
