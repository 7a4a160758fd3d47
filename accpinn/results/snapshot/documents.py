"""JSON as a snapshot has it: one text for one content, and nothing that could exhaust a reader."""

import json
import re
from typing import Any, NoReturn

from accpinn.errors import SnapshotError
from accpinn.results.snapshot.sanitise import plainly_printable, sanitise

DEEPEST = 20
"""Brackets within brackets."""
LONGEST_NUMBER = 40
"""Characters; a double has 24 at most, and 64 bits 20."""

# An unclosed string reaches to the end, so that no byte is looked at twice.
_STRINGS = re.compile(rb'"(?:[^"\\]|\\.)*+"?', re.DOTALL)
_OTHERS = re.compile(rb"[^\[\]{}]+")
_STEP = {ord("["): 1, ord("{"): 1, ord("]"): -1, ord("}"): -1}


def write(tree: Any) -> bytes:
    """The one text of a tree of plain values; keys sorted, numbers finite."""
    text = json.dumps(
        tree, sort_keys=True, ensure_ascii=False, allow_nan=False, separators=(",", ":")
    )
    return text.encode()


def read(data: bytes, what: str) -> Any:
    """The tree of a text that `write` wrote; characters that cannot be shown are replaced.

    Args:
        data: its bytes; who calls has bounded their number.
        what: how sentences name it, as "the provenance".

    Raises:
        SnapshotError: for anything that `write` would not have written.
    """
    if _depth(data) > DEEPEST:
        raise SnapshotError(
            f"The snapshot is refused: {what} is nested more than {DEEPEST} levels deep."
        )
    try:
        text = data.decode("utf-8")
        tree = json.loads(
            text,
            parse_int=_integer,
            parse_float=_real,
            parse_constant=_no_number,
            object_pairs_hook=_distinct,
        )
        same = write(tree) == data
    except (ValueError, RecursionError) as fault:
        raise SnapshotError(
            f"The snapshot is refused: {what} cannot be read ({str(fault)[:60]})."
        ) from None
    if not same:
        raise SnapshotError(f"The snapshot is damaged: {what} is not as it was written.")
    return tree if plainly_printable(text) else sanitise(tree)


def _depth(data: bytes) -> int:
    """How deep brackets are nested, those inside strings aside."""
    deepest = level = 0
    for byte in _OTHERS.sub(b"", _STRINGS.sub(b"", data)):
        level += _STEP[byte]
        deepest = max(deepest, level)
        if deepest > DEEPEST:
            break
    return deepest


def _integer(text: str) -> int:
    if len(text) > LONGEST_NUMBER or abs(value := int(text)) >= 2**63:
        raise ValueError(f"the number {text[:12]}... is absurd")
    return value


def _real(text: str) -> float:
    if len(text) > LONGEST_NUMBER or abs(value := float(text)) == float("inf"):
        raise ValueError(f"the number {text[:12]}... is absurd")
    return value


def _no_number(text: str) -> NoReturn:
    raise ValueError(f"{text} is no number")


def _distinct(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    result = dict(pairs)
    if len(result) != len(pairs):
        raise ValueError("a name stands twice")
    return result
