"""Where studies are kept that have a name in place of a path, as those of the app.

Beside its results such a study keeps what it was asked to do, so that it can be continued.
"""

import os
import re
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

import msgspec
from platformdirs import user_data_path

from accpinn.errors import ConfigError
from accpinn.study.journal import JOURNAL, replace_file
from accpinn.study.process import BatchSettings

FOLDER_VARIABLE = "ACCPINN_STUDIES"
"""Environment variable that names another folder than the one among the user's data."""
REQUEST = "request.json"
_NAME = re.compile(r"[^\W_][\w .()-]{0,59}")


def default_folder() -> Path:
    """The folder of all studies; it need not exist."""
    named = os.environ.get(FOLDER_VARIABLE)
    return Path(named) if named else user_data_path("accpinn") / "studies"


def study_path(name: str, folder: Path) -> Path:
    """The folder of the study of that name, which need not exist.

    Args:
        name: letters, digits, spaces, points and hyphens.
        folder: of all studies.

    Raises:
        ConfigError: for what is no name, and for a link that leads out of the folder.
    """
    path = folder / name
    outside = path.resolve().parent != folder.resolve()
    if not _NAME.fullmatch(name) or name != name.strip(" .") or outside:
        raise ConfigError(
            f'study: "{name[:60]}" is no name; take up to 60 letters, digits, spaces, points and'
            " hyphens, a letter or digit first."
        )
    return path


def studies(folder: Path) -> tuple[str, ...]:
    """The names of the studies in a folder, the one that was written to last first."""
    found: dict[str, float] = {}
    for journal in folder.glob(f"*/{JOURNAL}"):
        name = journal.parent.name
        try:
            study_path(name, folder)
            found[name] = journal.stat().st_mtime
        except (ConfigError, OSError):  # no study of ours, or gone meanwhile
            continue
    return tuple(sorted(found, key=lambda name: -found[name]))


@dataclass(frozen=True)
class Request:
    """What a study was last asked to do."""

    settings: BatchSettings
    finished: bool
    """Whether that came to its end."""


def keep_request(request: Request) -> None:
    """Write it into the study's folder, which must be there; a full disk is no fault."""
    with suppress(OSError):
        replace_file(Path(request.settings.study) / REQUEST, msgspec.json.encode(request))


def recall_request(study: Path) -> Request | None:
    """What a study was last asked to do; None where that is not known."""
    try:
        return msgspec.json.decode((study / REQUEST).read_bytes(), type=Request)
    except (OSError, msgspec.DecodeError):
        return None
