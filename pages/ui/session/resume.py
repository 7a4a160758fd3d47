"""What each session has open, on disk: after a restart its address shows the same again.

Kept are names and choices, never the recording: one of the server's own is read again, and an
upload is asked for; its window and result return with it.
"""

from contextlib import suppress

import msgspec
from accpinn.results.snapshot.saved import write_whole

from accpinn.errors import AccpinnError, SnapshotError
from accpinn.recordings.recording import Recording
from accpinn.recordings.synthetic import Truth
from pages.ui.session.recordings import find_recording, find_sample
from pages.ui.session.workspace import Opened, Workspace

FILE = "open.json"
"""In the session's folder."""
LARGEST = 100_000
"""Bytes of such a file at most."""


def keep(workspace: Workspace) -> None:
    """Write what is open, where that has changed; a full disk costs no page."""
    recording = workspace.recording
    if recording is None:
        return
    now = Opened(
        recording.source, recording.sha256, recording.trajectory, recording.campaign,
        workspace.vehicles, workspace.window.start, workspace.window.end, workspace.case,
        workspace.excluded_regimes, workspace.preset, workspace.run,
    )  # fmt: skip
    if now == workspace.kept_open:
        return
    workspace.kept_open = now
    folder = workspace.runs.made()
    if folder:
        with suppress(SnapshotError):
            write_whole(msgspec.json.encode(now), folder / FILE, "session")


def resume(workspace: Workspace) -> None:
    """Open again what the session had open, as far as the server has it."""
    try:
        with (workspace.runs.folder / FILE).open("rb") as file:
            kept = msgspec.json.decode(file.read(LARGEST), type=Opened)
    except (OSError, msgspec.MsgspecError):  # nothing was open, or a damaged file
        return
    workspace.preset = kept.preset
    with suppress(SnapshotError):
        if kept.run:
            workspace.restore(workspace.runs.open(kept.run))
    workspace.awaited = kept
    with suppress(AccpinnError):
        workspace.open(*_find(kept))


def _find(kept: Opened) -> tuple[Recording, Truth | None]:
    sample = find_sample(kept.source, kept.sha256)
    if sample:
        return sample
    return find_recording(kept.source, kept.sha256, kept.trajectory, kept.campaign), None
