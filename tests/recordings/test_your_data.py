"""docs/your-data.md: each table of it is read as it says, and as the drive that it was made of."""

import json
import re
from pathlib import Path

import numpy as np
import pytest
from msgspec.structs import replace

from accpinn.errors import RecordingError
from accpinn.recordings.files import opened, read
from accpinn.recordings.mapping import CsvMapping, parse_mapping, write_mapping
from tests.support.your_data import KINDS, SETS, STEP, TRUE, Kind

PAGE = Path(__file__).parents[2] / "docs" / "your-data.md"
SECTIONS = {
    part.partition("\n")[0]: part for part in PAGE.read_text(encoding="utf-8").split("\n### ")[1:]
}


def with_length(mapping: CsvMapping, kind: Kind) -> CsvMapping:
    """The proposal with what only a person knows: the length of the vehicle ahead."""
    if not kind.subtract:
        return mapping
    return replace(mapping, gaps=tuple(replace(g, subtract=kind.subtract) for g in mapping.gaps))


@pytest.mark.parametrize("kind", [*KINDS, *SETS], ids=lambda kind: kind.title)
def test_a_table_of_the_page_is_the_drive_that_it_was_made_of(kind: Kind) -> None:
    text = kind.made()
    (shown,) = re.findall(r"```text\n(.*?)```", SECTIONS[kind.title].split("\n## ")[0], re.DOTALL)
    assert text.startswith(shown)
    mapping = None
    if not kind.is_read:
        with pytest.raises(RecordingError, match="--mapping"):
            read(text.encode(), "drive.csv")
        mapping = with_length(opened(text.encode(), "drive.csv").proposal.mapping, kind)
    recording = read(text.encode(), "drive.csv", mapping=mapping)
    at = recording.time + (recording.speed.shape[0] < len(TRUE)) * STEP  # merged: from the second
    assert recording.duration == pytest.approx(TRUE["t"].iloc[-1], abs=2 * STEP)
    values = np.column_stack([recording.speed, recording.gap])
    for column, name in zip(values.T, ("lead", "ego", "gap"), strict=True):
        np.testing.assert_allclose(column, np.interp(at, TRUE["t"], TRUE[name]), atol=0.02)


@pytest.mark.parametrize("kind", SETS, ids=lambda kind: kind.title)
def test_the_mapping_of_a_public_data_set_is_the_proposed_one(kind: Kind) -> None:
    blocks = re.findall(r"```json\n(.*?)```", SECTIONS[kind.title].split("\n## ")[0], re.DOTALL)
    file = opened(kind.made().encode(), "drive.csv")
    if not file.is_unknown:
        assert blocks == []
        return
    printed = parse_mapping(blocks[0])
    assert printed == with_length(file.proposal.mapping, kind)
    assert json.loads(write_mapping(printed)) == json.loads(blocks[0])
