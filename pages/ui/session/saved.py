"""A user's saved results: finished runs in the store, and snapshots in the library."""

from dataclasses import replace

from accpinn.recordings import Facts
from accpinn.study.result import Result
from accpinn.study.store import Entry
from pages.ui.session.resources import library, store
from pages.ui.session.users import digest, is_admin, is_own, owner_mark, sees_all
from pages.ui.session.workspace import Workspace


def may_delete(session: str, name: str) -> bool:
    """Whether this user may delete that snapshot."""
    return is_own(session, library().owner(name))


def own_snapshots(session: str) -> tuple[Entry, ...]:
    """The snapshots that this user saved, also damaged ones; others open by their links."""
    entries = library().entries()
    if sees_all() or is_admin():
        return entries
    return tuple(entry for entry in entries if is_own(session, library().owner(entry.id)))


def readable_snapshots(session: str) -> tuple[Entry, ...]:
    """The user's snapshots that can be read."""
    return tuple(entry for entry in own_snapshots(session) if not entry.fault)


def results_to_see(workspace: Workspace) -> tuple[Entry, ...]:
    """The user's results, newest first: finished runs, and snapshots of no such run.

    They are those of this computer, or of the user where others use the server. A run that was
    saved as a snapshot has its name.
    """

    def content(entry: Entry) -> tuple[object, ...]:
        """Properties that two entries of the same result share."""
        return (
            entry.sha256, entry.window, entry.numbers, entry.method, entry.model, entry.parameters,
        )  # fmt: skip

    session, is_everything = workspace.id, sees_all()
    entries = store().entries(session="" if is_everything else owner_mark(session))
    runs = {content(entry): entry for entry in reversed(entries) if not entry.fault}
    marks = owner_mark(session), digest(session)
    for entry in reversed(library().entries()):
        is_mine = is_everything or library().owner(entry.id) in marks
        if is_mine and not entry.fault:
            run = runs.get(content(entry), entry)
            runs[content(entry)] = replace(run, name=entry.name)
    return tuple(sorted(runs.values(), key=lambda entry: entry.created, reverse=True))


def result_of(name: str) -> Result:
    """The training of that key in the store, or the snapshot of that short name.

    Raises:
        SnapshotError: for an unknown name, or a damaged file.
    """
    if store().has(name):
        return store().read(name)
    return library().read(name)


def own_result(workspace: Workspace, name: str) -> Result:
    """The result of that name, with file and vehicles named as the user's session has shown them.

    Users with the same data share one result, and may have named files and vehicles differently.
    """
    result = result_of(name)
    for session in (workspace.key, owner_mark(workspace.id)):
        if entry := store().shown_as(session, name):
            return _named(result, entry)
    return result


def _named(result: Result, entry: Entry) -> Result:
    info, source = result.info, result.analysis.source
    if (info.source, info.labels, source.sha256) == (entry.source, entry.vehicles, entry.sha256):
        return result
    names = tuple(label.removeprefix(f"{number} ") for number, label in
                  zip(entry.numbers, entry.vehicles, strict=True))  # fmt: skip
    segments = tuple(
        replace(segment, source=entry.source, names=names, sha256=entry.sha256)
        for segment in result.segments
    )
    source = replace(source, name=entry.source, sha256=entry.sha256)
    analysis = replace(result.analysis, source=source)
    facts: Facts = {"campaign": entry.campaign} if entry.campaign else {}
    return replace(result.on(segments, None), analysis=analysis, facts=facts, name="", note="")
