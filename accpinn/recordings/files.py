"""One way to read a file, whatever it is: an OpenACC run, a table of pairs, or a mapped table."""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property

from accpinn.channels import METADATA, SPEED, TIME
from accpinn.errors import RecordingError
from accpinn.recordings import Recording, ValuesOutOfRange, openacc, pairs
from accpinn.recordings import mapping as mapped
from accpinn.recordings.mapping import CsvMapping, recall, remember
from accpinn.recordings.source import Source, SourceFile, read_bytes
from accpinn.recordings.tables import Layout, TableRun, choose_run, layout_of


def read(
    source: Source,
    name: str | None = None,
    *,
    trajectory: str | None = None,
    mapping: CsvMapping | None = None,
    is_kept: bool = True,
) -> Recording:
    """Read a recording.

    Args:
        source: path of the file, or the bytes of an upload.
        name: file name to show; needed for bytes only.
        trajectory: which one of a table that holds several; any pair of a platoon names it.
        mapping: which columns hold what, for a table of one's own.
        is_kept: whether the mapping is remembered for the next file with the same column names.

    Raises:
        RecordingError: one sentence of file, place, fault and cure.
    """
    return opened(source, name, mapping).read(trajectory, is_kept)


def read_all(
    source: Source, name: str | None = None, *, mapping: CsvMapping | None = None
) -> Iterator[Recording | RecordingError]:
    """All recordings of a file, one after the other; for one that cannot be read, why.

    Arguments are those of `read`.

    Raises:
        RecordingError: when the file as a whole cannot be read.
    """
    file = opened(source, name, mapping)
    if not any(run.trajectories for run in file.runs):
        yield file.read()
        return
    for run in file.runs:
        try:
            yield run.read()
        except RecordingError as fault:
            yield fault


@dataclass(frozen=True)
class File:
    """A file, and how it is read."""

    content: SourceFile
    layout: Layout | None = None
    """None where it is no table, or where a mapping is given."""
    mapping: CsvMapping | None = None
    """The given one, or the one remembered for the table's columns."""
    is_remembered: bool = False
    """Whether the mapping was not given but remembered."""

    @property
    def is_pair_table(self) -> bool:
        """Whether it is a table of leader-follower pairs."""
        return self.layout is not None and pairs.is_pair_table(self.layout)

    @property
    def is_unknown(self) -> bool:
        """Whether it is a table of no known layout, which a mapping could serve.

        A run begins with its time, as tables of one's own do, and has numbered vehicles.
        """
        if self.layout is None or self.mapping or self.is_pair_table:
            return False
        has_vehicles = openacc.numbered(self.layout, SPEED)
        return not has_vehicles or _first_cell(self.content) != TIME.column.lower()

    @cached_property
    def runs(self) -> tuple[TableRun, ...]:
        """The runs of a table of pairs, or of one with a mapping; none of any other file."""
        if self.mapping:
            return mapped.runs_of(self.content, self.mapping, self.is_remembered)
        if self.layout and self.is_pair_table:
            return pairs.runs_of(self.content, self.layout)
        return ()

    @property
    def trajectories(self) -> tuple[tuple[str, int], ...]:
        """The runs among which a choice has to be made: names for `read`, numbers of vehicles."""
        several = self.runs if len(self.runs) > 1 else ()
        return tuple((run.trajectories[0], run.vehicles) for run in several)

    def read(self, trajectory: str | None = None, is_kept: bool = True) -> Recording:
        """The recording of a trajectory, or the only one; a given mapping may be remembered."""
        if trajectory is not None and not self.runs and not self.is_unknown:
            fault = "an OpenACC file is one run, without trajectories"
            raise self.content.refusal(fault, "leave the trajectory out")
        kind = "trajectories" if self.mapping else "platoons"
        run = choose_run(self.content, self.runs, trajectory, kind) if self.runs else None
        try:
            recording = run.read() if run else openacc.read(self.content)
        except RecordingError as fault:
            cure = "name its columns"
            if self.mapping and self.is_remembered:
                cure = "map its columns again, which were read as those of an earlier file"
            elif not self.is_unknown:
                raise
            sentence = str(fault).removesuffix(".")
            raise RecordingError(
                f"{sentence}, or {cure}: on page Data, by --mapping, in Python by mapping=."
            ) from fault
        is_sound = not any(
            isinstance(found, ValuesOutOfRange) and found.is_in_another_unit
            for found in recording.findings
        )  # else units are probably wrong, and they would be for the next file, too
        if self.mapping and is_kept and is_sound and not self.is_remembered:
            remember(self.mapping, layout_of(self.content).names)
        return recording


def opened(source: Source, name: str | None = None, mapping: CsvMapping | None = None) -> File:
    """A file, and how it is read; a given mapping counts, whatever the file is.

    Raises:
        RecordingError: when the file is no text at all.
    """
    content = read_bytes(source, name)
    if mapping or _first_cell(content) in {key.lower() for key in METADATA}:
        return File(content, mapping=mapping)
    try:
        layout = layout_of(content)
    except RecordingError:
        return File(content)
    known = None if pairs.is_pair_table(layout) else recall(layout.names)
    return File(content, layout, known, is_remembered=True)


def _first_cell(content: SourceFile) -> str:
    """The cell with which an OpenACC file says that it is one, in small letters."""
    line = content.text.lstrip()[:60].decode("utf-8", "replace").splitlines()[0]
    return line.partition(",")[0].strip().lower()
