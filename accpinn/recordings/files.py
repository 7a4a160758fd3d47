"""One way to read a file, whatever it is: an OpenACC run, a table of pairs, or a mapped table."""

from collections.abc import Iterator

from accpinn.channels import METADATA, TIME
from accpinn.errors import RecordingError
from accpinn.recordings import openacc, pairs
from accpinn.recordings.mapping import CsvMapping, read_mapped, recall, remember, trajectories_of
from accpinn.recordings.recording import Recording
from accpinn.recordings.samples import Source, SourceFile, read_bytes
from accpinn.recordings.tables import Layout, layout_of

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
    if used:
        recording = read_mapped(
            source_file, used, trajectory=trajectory, remembered=mapping is None
        )
        if mapping:
            remember(mapping, layout_of(source_file).names)
        return recording
    if layout and pairs.is_pair_table(layout):
        found = pairs.platoons(source_file, layout)
        chosen = pairs.choose(source_file, found, trajectory)
        return pairs.recording_of(source_file, layout, chosen, len(found) == 1)
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
    if layout and pairs.is_pair_table(layout):
        found = pairs.platoons(source_file, layout)
        for platoon in found:
            try:
                yield pairs.recording_of(source_file, layout, platoon, len(found) == 1)
            except RecordingError as fault:
                yield fault
        return
    runs = trajectories_of(source_file, used) if used else ()
    if used and runs:
        for run in runs:
            try:
                yield read_mapped(source_file, used, trajectory=run, remembered=mapping is None)
            except RecordingError as fault:
                yield fault
        return
    yield read(source, name, mapping=mapping)


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
    """The runs among which a table makes its reader choose: a name of each, and its vehicles.

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
    layout, used = _table_of(source_file, mapping)
    found: tuple[tuple[str, int], ...] = ()
    if layout and pairs.is_pair_table(layout):
        platoons = pairs.platoons(source_file, layout)
        found = tuple((one.trajectories[0], len(one.pairs) + 1) for one in platoons)
    elif used:
        found = tuple((run, len(used.speeds)) for run in trajectories_of(source_file, used))
    return found if len(found) > 1 else ()


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
