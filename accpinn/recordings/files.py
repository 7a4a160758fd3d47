"""Reading a file as a recording: an OpenACC run, a table of pairs, or any other table.

    read -> source.py, containers.py    bytes, unpacked to CSV text
         -> table_layout.py, tables.py  rows and columns by name
         -> openacc.py, pairs.py        layouts that say themselves what columns hold
         -> proposal.py, mapping.py     other tables: a mapping, proposed or given
         -> mapped.py, trajectories.py  read by the mapping
         -> sampling.py                 missing rows inserted, as a `Recording`

Any other table is read by a mapping: the one that is given, the one that was remembered for the
same column names, or the one that is proposed, if something supports every choice of it and nothing
in the data contradicts it. Else it is refused, and the mapping offered.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property

from accpinn.channels import METADATA, TIME
from accpinn.errors import RecordingError
from accpinn.findings import Finding, Labelled, Words
from accpinn.recordings import Recording, ValuesOutOfRange, mapped, openacc, pairs
from accpinn.recordings.draft import Proposal
from accpinn.recordings.inconsistency import GapJumps, Inconsistency
from accpinn.recordings.mapped import UnitContradictsHeader
from accpinn.recordings.mapping import (
    CsvMapping,
    MappingRemembered,
    remember_mapping,
    remembered_mapping,
)
from accpinn.recordings.proposal import proposed
from accpinn.recordings.source import Source, SourceFile, excerpt, read_bytes
from accpinn.recordings.table_layout import Layout, layout_of
from accpinn.recordings.tables import TableRun, choose_run

MOST_VEHICLES = 300
"""Vehicles of one recording, each of which pages, findings and tables list."""
LONGEST_SUMMARY = 200
"""Characters of a sentence about how columns were read."""


_OFFER = "map its columns on page Home, or by --mapping (info --propose prints a proposal)"


class ColumnsProposed(Finding, frozen=True):
    """The table was read by the proposed mapping, as none was given."""

    text = "Columns were read as their names say: {summary}. If that is wrong, give a mapping."

    choices: str
    """Columns, roles and units."""

    def _words(self, about: Labelled) -> Words:
        return {"summary": excerpt(self.choices, LONGEST_SUMMARY)}


def read(
    source: Source,
    name: str | None = None,
    *,
    trajectory: str | None = None,
    mapping: CsvMapping | None = None,
    remember: bool = False,
) -> Recording:
    """Read a recording.

    Args:
        source: path of the file, or the bytes of an upload.
        name: file name to show; needed for bytes only.
        trajectory: which one of a table that holds several; any pair of a platoon names it.
        mapping: which columns hold what, for a table of one's own.
        remember: whether the mapping is kept for the next file with the same column names, unless
            a finding contradicts it, and whether one that was kept is used.

    Raises:
        RecordingError: one sentence of file, place, fault and cure.

    Examples:
        >>> import accpinn
        >>> recording = accpinn.read(accpinn.sample_path("motorway"))
        >>> recording.duration, [vehicle.name for vehicle in recording.vehicles][:2]
        (600.0, ['Synthetic(Van)', 'Synthetic(Hatchback)'])
    """
    file = opened(source, name, mapping)
    if not remember:
        return file.read(trajectory)
    if file.is_unknown and (remembered := remembered_mapping(file.names)):
        return replace(file, mapping=remembered, notes=(MappingRemembered(),)).read(trajectory)
    recording = file.read(trajectory)
    differs = any(isinstance(note, UnitContradictsHeader) for note in recording.notes)
    if mapping and not differs and not contradictions(recording):
        remember_mapping(mapping, file.names)
    return recording


def read_all(
    source: Source, name: str | None = None, *, mapping: CsvMapping | None = None
) -> Iterator[Recording | RecordingError]:
    """All recordings of a file, one after the other; for one that cannot be read, why.

    Arguments are those of `read`.

    Raises:
        RecordingError: when the file as a whole cannot be read.
    """
    file = opened(source, name, mapping)
    runs = replace(file, mapping=file.supported_mapping, notes=file.read_as).runs
    if not any(run.trajectories for run in runs):
        yield file.read()
        return
    for run in runs:
        try:
            yield file.checked(file.bounded(run.read()))
        except RecordingError as fault:
            yield fault


def contradictions(recording: Recording) -> tuple[Finding, ...]:
    """The findings by which columns, units or signs are probably others than were read."""
    return tuple(
        finding for finding in recording.findings
        if (
            isinstance(finding, Inconsistency)
            and finding.is_contradiction
            and not isinstance(finding, GapJumps)
        )
        or (
            isinstance(finding, ValuesOutOfRange)
            and (finding.is_in_another_unit or finding.is_of_other_sign)
        )
    )  # fmt: skip


@dataclass(frozen=True)
class File:
    """A file, and how it is read."""

    content: SourceFile
    layout: Layout | None = None
    """None where it is no table but an OpenACC run."""
    mapping: CsvMapping | None = None
    """The one that it is read by; None for an OpenACC run and a table of pairs."""
    notes: tuple[Finding, ...] = ()
    """Findings about where the mapping comes from."""

    @property
    def names(self) -> tuple[str, ...]:
        """The names of the table's columns."""
        return (self.layout or layout_of(self.content)).names

    @property
    def is_pair_table(self) -> bool:
        """Whether it is a table of leader-follower pairs."""
        return self.layout is not None and not self.mapping and pairs.is_pair_table(self.layout)

    @property
    def is_unknown(self) -> bool:
        """Whether it is a table that needs a mapping, and none is given.

        A run begins with its time, as tables of one's own do, and has numbered vehicles.
        """
        return self.layout is not None and not self.mapping and not self.is_pair_table

    @cached_property
    def proposal(self) -> Proposal:
        """The mapping proposed for the columns, with reasons.

        Raises:
            RecordingError: where the rows cannot be split into cells.
        """
        return proposed(self.content, self.layout or layout_of(self.content))

    @property
    def supported_mapping(self) -> CsvMapping | None:
        """The mapping to read by, or the one proposed where something supports all of it."""
        if self.is_unknown and self.proposal.is_supported:
            return self.proposal.mapping
        return self.mapping

    @property
    def read_as(self) -> tuple[Finding, ...]:
        """Findings about where the mapping to read by comes from."""
        if self.is_unknown and self.proposal.is_supported:
            return (*self.notes, ColumnsProposed(self.proposal.summary))
        return self.notes

    @cached_property
    def runs(self) -> tuple[TableRun, ...]:
        """The runs of a table of pairs, or of one with a mapping; none of any other file."""
        if self.mapping:
            return mapped.runs_of(self.content, self.mapping, self.layout, self.notes)
        if self.layout and self.is_pair_table:
            return pairs.runs_of(self.content, self.layout)
        return ()

    @property
    def nbytes(self) -> int:
        """Memory that the file and its runs take, in bytes, as far as they were read."""
        runs: tuple[TableRun, ...] = self.__dict__.get("runs", ())  # reading takes it
        return self.content.nbytes + sum({id(r.columns): r.columns.nbytes for r in runs}.values())

    @property
    def trajectories(self) -> tuple[tuple[str, int], ...]:
        """The runs among which a choice has to be made: names for `read`, numbers of vehicles."""
        several = self.runs if len(self.runs) > 1 else ()
        return tuple((run.trajectories[0], run.vehicles) for run in several)

    def read(self, trajectory: str | None = None) -> Recording:
        """The recording of a trajectory, or the only one.

        Raises:
            RecordingError: for a table without a mapping, whose proposal is not supported or
                contradicts the data, and for anything wrong with the file.
        """
        if self.is_unknown:
            if not self.proposal.is_supported:
                question = excerpt(self.proposal.undecided[0].rstrip("."), 120)
                raise self.content.refusal(f"its columns leave open: {question}", _OFFER)
            file = replace(self, mapping=self.supported_mapping, notes=self.read_as)
            return self.checked(file.read(trajectory))
        if trajectory is not None and not self.runs:
            fault = "an OpenACC file is one run, without trajectories"
            raise self.content.refusal(fault, "leave the trajectory out")
        kind = "trajectories" if self.mapping else "platoons"
        run = choose_run(self.content, self.runs, trajectory, kind) if self.runs else None
        return self.bounded(run.read() if run else openacc.read(self.content))

    def bounded(self, recording: Recording) -> Recording:
        """The recording, unless it has more vehicles than can be listed.

        Raises:
            RecordingError: with their number.
        """
        vehicles = recording.speed.shape[1]
        if vehicles > MOST_VEHICLES:
            fault = f"it has {vehicles:,} vehicles, and {MOST_VEHICLES} are read"
            raise self.content.refusal(fault, "split it into shorter platoons")
        return recording

    def checked(self, recording: Recording) -> Recording:
        """The recording, refused where its mapping was proposed and the data contradict it.

        Raises:
            RecordingError: with the contradiction.
        """
        against = contradictions(recording) if self.is_unknown else ()
        if against:
            sentence = excerpt(against[0].sentence(recording).rstrip("."), 180)
            raise self.content.refusal(sentence, _OFFER)
        return recording


def opened(source: Source, name: str | None = None, mapping: CsvMapping | None = None) -> File:
    """Open a file and find how it is read; a given mapping is used for any kind of file.

    Raises:
        RecordingError: when the file is no text, or cannot be unpacked.
    """
    content = read_bytes(source, name)
    if mapping:
        return File(content, layout_of(content), mapping)
    first_row = content.text.lstrip()[:60].decode("utf-8", "replace").splitlines()[0]
    first, second = (*(cell.strip() for cell in first_row.split(",")), "")[:2]
    # A table may have columns named Date or ACC; in an OpenACC file a number follows these words.
    names_columns = first.lower() in ("date", "acc") and second[:1].isalpha()
    if first.lower() in {key.lower() for key in METADATA} and not names_columns:
        return File(content)
    try:
        layout = layout_of(content)
    except RecordingError:
        if first.lower() == TIME.column.lower() or openacc.accompanies_runs(content):
            return File(content)  # whose own sentence says more
        raise
    if openacc.is_run(layout):
        return File(content)
    return File(content, layout)
