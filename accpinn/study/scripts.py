"""A user's script that registers models and methods, as `batch` and the command line take it.

Its text travels with each window of a batch, so a worker on another machine needs no copy of it. It
is run once in each process, and never read from a study or a snapshot.
"""

import os
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Self

from accpinn.errors import AccpinnError, ConfigError
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
        return _run(self)


@cache
def _run(script: Script) -> str:
    before = dict(FOLLOWING)
    try:
        exec(compile(script.text, script.name, "exec"), {"__name__": "accpinn_script"})
    except AccpinnError as fault:
        raise ConfigError(f"{script.name}: {fault}") from None
    except Exception as fault:
        raise ConfigError(
            f"{script.name}: it fails with {type(fault).__name__}: {str(fault)[:120]}; mend it."
        ) from None
    for key, model in FOLLOWING.items():
        if before.get(key) is not model:
            return key
    raise ConfigError(f"{script.name}: it registers no model; let it call accpinn.register_model.")


def model_key(model: str) -> str:
    """The key that a model's key or its script stands for; the script is run."""
    return Script.read(model).run() if model.endswith(ENDING) else model
