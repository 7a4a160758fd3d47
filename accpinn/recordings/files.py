"""One way to read a file, whatever it is: an OpenACC run, a table of pairs, or a mapped table."""

from collections.abc import Iterator

from accpinn.channels import METADATA, TIME
from accpinn.errors import RecordingError
from accpinn.recordings import mapping as mapped
from accpinn.recordings import openacc, pairs
from accpinn.recordings.mapping import CsvMapping, recall, remember
from accpinn.recordings.recording import Recording
from accpinn.recordings.source import Source, SourceFile, read_bytes
from accpinn.recordings.tables import Layout, TableRun, choose_run, layout_of

_HEADER_STARTS = tuple(key.lower() for key in (*METADATA, TIME.column))


def read(
    source: Source,
    name: str | None = None,
    *,
    trajectory: str | None = None,
    mapping: CsvMapping | None = None,
) -> Recording:
    """Read a recording.

    Args:
        source: path of the file, or the bytes of an upload.
        name: file name to show; needed for bytes only.
        trajectory: which one of a table that holds several; any pair of a platoon names it.
        mapping: which columns hold what, for a table of one's own; it is remembered for the next
            file with the same column names.

    Raises:
        RecordingError: one sentence of file, place, fault and cure.
    """
    source_file = read_bytes(source, name)
    layout, used = _table_of(source_file, mapping)
    runs = _runs_of(source_file, layout, used, remembered=mapping is None)
    if runs and used:
        recording = mapped.choose_mapped(source_file, runs, trajectory).read()
        if mapping:
            remember(mapping, layout_of(source_file).names)
        return recording
    if runs:
        return choose_run(source_file, runs, trajectory, "platoons").read()
    if layout and not _is_openacc(source_file):
        return _refuse_unknown(source_file)
    if trajectory is not None:
        fault = "an OpenACC file is one run, without trajectories"
        raise source_file.refusal(fault, "leave the trajectory out")
    return openacc.read(source_file)


def read_all(
    source: Source, name: str | None = None, *, mapping: CsvMapping | None = None
) -> Iterator[Recording | RecordingError]:
    """All recordings of a file, one after the other; for one that cannot be read, why.

    Args:
        source: see `read`, as all others.
        name: needed for bytes only.
        mapping: for a table of one's own.

    Raises:
        RecordingError: when the file as a whole cannot be read.
    """
    source_file = read_bytes(source, name)
    layout, used = _table_of(source_file, mapping)
    has_names = used.trajectory if used else layout and pairs.is_pair_table(layout)
    if not has_names:
        yield read(source, name, mapping=mapping)
        return
    for run in _runs_of(source_file, layout, used, remembered=mapping is None):
        try:
            yield run.read()
        except RecordingError as fault:
            yield fault


def mapping_of(
    source: Source, name: str | None = None, mapping: CsvMapping | None = None
) -> CsvMapping | None:
    """The mapping by which a file is read: the given one, or the one remembered for its columns.

    Args:
        source: see `read`, as all others.
        name: needed for bytes only.
        mapping: that is given, if any.

    Raises:
        RecordingError: when the file is no text at all.
    """
    return _table_of(read_bytes(source, name), mapping)[1]


def is_unknown(source: Source, name: str | None = None) -> bool:
    """Whether a file is a table of no known layout, which a mapping could serve.

    Args:
        source: see `read`.
        name: needed for bytes only.

    Raises:
        RecordingError: when the file is no text at all.
    """
    source_file = read_bytes(source, name)
    layout, used = _table_of(source_file, None)
    known = used or layout is None or pairs.is_pair_table(layout) or _is_openacc(source_file)
    return not known


def trajectories(
    source: Source, name: str | None = None, *, mapping: CsvMapping | None = None
) -> tuple[tuple[str, int], ...]:
    """The runs of a table among which a choice has to be made: names and numbers of vehicles.

    Args:
        source: see `read`, as all others.
        name: needed for bytes only.
        mapping: for a table of one's own.

    Returns:
        Names for `read`; empty where there is nothing to choose.

    Raises:
        RecordingError: when the file as a whole cannot be read.
    """
    source_file = read_bytes(source, name)
    runs = _runs_of(source_file, *_table_of(source_file, mapping))
    return tuple((run.trajectories[0], run.vehicles) for run in runs) if len(runs) > 1 else ()


def _runs_of(
    source_file: SourceFile,
    layout: Layout | None,
    mapping: CsvMapping | None,
    remembered: bool = False,
) -> tuple[TableRun, ...]:
    """The runs of a table of pairs, or of one whose mapping is known; none of any other file."""
    if mapping:
        return mapped.runs_of(source_file, mapping, remembered)
    if layout and pairs.is_pair_table(layout):
        return pairs.runs_of(source_file, layout)
    return ()


def _is_openacc(source_file: SourceFile) -> bool:
    """Whether the first cell is one that an OpenACC file begins with."""
    first = source_file.text.lstrip()[:60].decode("utf-8", "replace").splitlines()[:1]
    return bool(first) and first[0].split(",")[0].strip().lower() in _HEADER_STARTS


def _table_of(
    source_file: SourceFile, mapping: CsvMapping | None
) -> tuple[Layout | None, CsvMapping | None]:
    """Layout of a table that is no OpenACC run, and the mapping that it is read by; None for none.

    A given mapping counts, whatever the file is.
    """
    if mapping:
        return None, mapping
    starts = source_file.text.lstrip()[:60].decode("utf-8", "replace").lower()
    if starts.startswith(tuple(f"{key.lower()}," for key in METADATA)):
        return None, None
    try:
        layout = layout_of(source_file)
    except RecordingError:
        return None, None
    return layout, None if pairs.is_pair_table(layout) else recall(layout.names)


def _refuse_unknown(source_file: SourceFile) -> Recording:
    """OpenACC's own sentence, which says what is expected; a mapping is the other way."""
    try:
        return openacc.read(source_file)
    except RecordingError as fault:
        raise RecordingError(
            f"{str(fault).removesuffix('.')}, or name its columns in a mapping (--mapping)."
        ) from None
