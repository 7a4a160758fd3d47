"""Folders of studies: the user's own, the supplied one, and one that a link opens.

Where all users are one person, a study is a folder below that of `ACCPINN_STUDIES`. On a server
that others use, each user's studies lie one level lower, in a folder named by a digest of whose
they are, so nobody learns another's names, nor meets them when choosing one. A study is called by
its name; an administrator's list has those of others as "_DIGEST/NAME". A link has "NAME@KEY": the
key, 128 random bits that are made when the owner first sees the study, names it in the folder
`_links`. The study that comes with the program has a name that none of these can have.
"""

import secrets
from contextlib import suppress
from pathlib import Path
from shutil import rmtree

from accpinn.errors import AccpinnError, ConfigError
from accpinn.storage import folder, reported, write_whole
from accpinn.study.studies import DROPPED, FILE, StudyError, state_of, study_path
from accpinn.study.supplied import supplied_study
from pages.ui.session.resources import batch_queue
from pages.ui.session.users import is_admin, owner_mark, sees_all

OWNERS, LINKS, LINK = "_", "_links", ".link"
"""Prefix of users' folders, folder of links, and file with the key of a study's link. No
study's name begins with "_" or a point."""
SUPPLIED, SUPPLIED_TITLE = "supplied:openacc", "OpenACC cars (supplied)"
"""Name and title of the study that comes with the program."""
MOST_DROPPED = 1_000_000_000
"""Largest size of all files that were dropped for batches, in bytes."""
DIGITS = 32
"""Hexadecimal digits of the digest in the name of a user's folder."""


def listed_studies(session: str) -> tuple[str, ...]:
    """The studies that the user may list, active batches first, then by the last change."""
    place = _place(session)
    patterns = ["*", f"{OWNERS}*/*"] if sees_all() or is_admin() else ["*"]
    changed: dict[str, int] = {}
    for pattern in patterns:
        for path in place.glob(f"{pattern}/{FILE}"):
            name = path.parent.relative_to(place).as_posix()
            with suppress(AccpinnError):  # a link that leads elsewhere
                changed[name] = max(state_of(path_of(session, name))[1::2], default=0)
    # Of a batch that waits nothing may be written yet.
    active = []
    for owner in batch_queue().active_owners("batch"):
        path = folder("studies") / owner
        if path.is_relative_to(place):
            active.append(path.relative_to(place).as_posix())
    return tuple(dict.fromkeys((*active, *sorted(changed, key=lambda name: -changed[name]))))


def path_of(session: str, name: str) -> Path:
    """The folder of a study that the user may see, which need not exist.

    Raises:
        ConfigError: for what is no name, a link that is none, and another's study.
    """
    if name == SUPPLIED:
        if (supplied := supplied_study()) is None:
            raise ConfigError("study: the supplied study is not installed here.")
        return supplied
    title, is_link, key = name.partition("@")
    if is_link:
        return _linked(title, key)
    owner, _, title = name.rpartition("/")
    if owner and not (_is_owner(owner) and (sees_all() or is_admin())):
        raise ConfigError(f"study: there is no study {name[:60]} here.")
    return _inside(_place(session) / owner, title)


def is_changed_by(name: str) -> bool:
    """Whether the user of a study by that name may continue and stop its batch."""
    return "@" not in name and name != SUPPLIED


def title_of(name: str) -> str:
    """The title of a study on pages."""
    return SUPPLIED_TITLE if name == SUPPLIED else name.partition("@")[0].rpartition("/")[2]


def task_owner(path: Path) -> str:
    """The owner of the task that fills a study."""
    return path.relative_to(folder("studies")).as_posix()


def link_to(session: str, name: str) -> str:
    """The name by which others may open a study, made at the first call.

    Raises:
        StudyError: where it cannot be written.
    """
    if not is_changed_by(name) or sees_all():
        return name
    path = path_of(session, name)
    sentence = "{}: a link to the study cannot be made there ({})."
    with reported(lambda reason: StudyError(sentence.format(folder("studies"), reason))):
        with suppress(OSError):
            return f"{path.name}@{(path / LINK).read_text()}"
        key, links = secrets.token_hex(16), folder("studies") / LINKS
        links.mkdir(parents=True, exist_ok=True)
        write_whole(links / key, task_owner(path).encode())
        write_whole(path / LINK, key.encode())
    return f"{path.name}@{key}"


def make_room(session: str, name: str, nbytes: int) -> None:
    """Remove dropped files of idle studies until those of one study have room.

    Raises:
        StudyError: where the files of all users together would be too large.
    """
    active = batch_queue().active_owners("batch")
    for other in listed_studies(session):
        path = path_of(session, other)
        if other != name and "/" not in other and task_owner(path) not in active:
            rmtree(path / DROPPED, ignore_errors=True)
    files = (
        path for level in ("*", "*/*")
        for path in folder("studies").glob(f"{level}/{DROPPED}/**/*") if path.is_file()
    )  # fmt: skip
    if sum(path.stat().st_size for path in files) + nbytes > MOST_DROPPED:
        raise StudyError(
            f"This server keeps {MOST_DROPPED / 1e9:g} GB of dropped files, which are in use; wait"
            " until a batch has ended."
        )


def _place(session: str) -> Path:
    """The folder of the user's own studies."""
    if sees_all() or is_admin():
        return folder("studies")
    return folder("studies") / f"{OWNERS}{owner_mark(session)[:DIGITS]}"


def _is_owner(name: str) -> bool:
    digits = name.removeprefix(OWNERS)
    return name != digits and len(digits) == DIGITS and set(digits) <= set("0123456789abcdef")


def _linked(title: str, key: str) -> Path:
    if len(key) == DIGITS and _is_owner(f"{OWNERS}{key}"):
        with suppress(OSError, UnicodeDecodeError):
            owner, _, name = (folder("studies") / LINKS / key).read_text().rpartition("/")
            if name == title and (not owner or _is_owner(owner)):
                return _inside(folder("studies") / owner, name)
    raise ConfigError(f"study: the link to {title[:60]} leads to no study here.")


def _inside(place: Path, title: str) -> Path:
    """A study's folder in a place, which no link in it leaves."""
    path = place / study_path(title).name
    if path.resolve().parent != place.resolve():
        raise ConfigError(f'study: "{title[:60]}" lies elsewhere; take another name.')
    return path
