"""A table that waits for the meaning of its columns or the choice of a run."""

from dataclasses import dataclass, field, replace
from functools import cached_property
from math import isnan, nan

from msgspec.structs import replace as changed

from accpinn.errors import AccpinnError, RecordingError
from accpinn.recordings import Recording
from accpinn.recordings.clocks import FRAME
from accpinn.recordings.draft import Proposal, roles_of
from accpinn.recordings.files import File
from accpinn.recordings.mapping import CsvMapping, GapColumn


@dataclass(eq=False)
class Pending:
    """A table, and how it would be read."""

    file: File
    """The table as it was opened, without a mapping."""
    mapping: CsvMapping | None = None
    """The meaning of the columns as chosen so far; None for a table of pairs.

    What a person has to choose yet is empty: the name of a column, the step of even rows and of
    frames, a length (nan).
    """
    _readings: dict[str | None, Recording | AccpinnError] = field(default_factory=dict)

    @classmethod
    def of(cls, file: File, served: CsvMapping | None = None) -> "Pending":
        """A file and a mapping that served its columns before, or else the proposed one."""
        mapping = served or (to_complete(file.proposal) if file.is_unknown else None)
        return cls(file, mapping)

    def read_by(self, mapping: CsvMapping) -> "Pending":
        """The same table by another mapping."""
        return Pending(self.file, mapping)

    @cached_property
    def _mapped(self) -> File:
        return replace(self.file, mapping=self.mapping)

    @cached_property
    def runs(self) -> tuple[tuple[str, int], ...]:
        """The runs among which a choice has to be made, as `File.trajectories`; empty for one.

        Also empty while the mapping does not serve; `reading` has the reason.
        """
        try:
            return self._mapped.trajectories
        except AccpinnError:
            return ()

    def reading(self, trajectory: str | None = None) -> Recording | AccpinnError:
        """The recording of a run, or the only one; the reason where it cannot be read."""
        if trajectory not in self._readings:
            try:
                self._readings[trajectory] = self._mapped.read(trajectory)
            except RecordingError as fault:
                self._readings[trajectory] = fault
        return self._readings[trajectory]

    @property
    def nbytes(self) -> int:
        """Memory that the file takes, in bytes."""
        return self.file.content.nbytes


def to_complete(proposal: Proposal) -> CsvMapping:
    """The proposed mapping without the numbers that a person has to enter."""
    mapping = proposal.mapping
    if proposal.is_supported:
        return mapping
    if mapping.time and mapping.time.unit == FRAME:
        mapping = changed(mapping, sample_time=None)
    gaps = tuple(changed(gap, subtract=nan) if lacks_length(gap) else gap for gap in mapping.gaps)
    return changed(mapping, gaps=gaps)


def is_complete(mapping: CsvMapping) -> bool:
    """Whether nothing is left for a person to choose."""
    numbers = [gap.subtract for gap in mapping.gaps] + [mapping.sample_time]
    if any(isinstance(number, float) and isnan(number) for number in numbers):
        return False
    if not mapping.time and mapping.sample_time is None:
        return False
    if mapping.time and mapping.time.unit == FRAME and mapping.sample_time is None:
        return False
    return all(name for name, *_ in roles_of(mapping))


def lacks_length(gap: GapColumn) -> bool:
    """Whether a gap between positions is without the length of the vehicle ahead."""
    if isinstance(gap.subtract, str):
        return False
    return bool(gap.minus) and (gap.subtract == 0.0 or isnan(gap.subtract))
