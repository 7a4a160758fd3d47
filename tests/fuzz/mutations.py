"""Files and documents spoilt in ways that a seed repeats: bytes, cells of tables, trees of JSON.

Everything is drawn from a `random.Random`, which a long run makes of a seed and hypothesis of its
own choices, so that it can make a finding smaller.
"""

import string
from copy import deepcopy
from random import Random
from typing import Any

TOKENS = (
    "", " ", "nan", "NaN", "inf", "-inf", "-0", "0", "-1", "1e308", "-1e308", "1e-320", "1e400",
    "9" * 400, "999999999999", "0x1f", "1,5", "1;5", "1 000", "1_000", "1.2.3", "١٢", '"', '""',
    '"a\nb"', "'", "=1+1", "Human", "ACC", "None", "true", "null", "\0", "\ufeff", "\u202e",
    "\u2028", "é", "😀", "A" * 5000, "2020-02-30", "0000-00-00", "Time", "Speed1", "IVS1",
    "../../etc/passwd",
    "%s%n", "{}", "[]", "<b>", "\\", "\t", "\r", "\n", ",", ";", ",,,,,,,,", "#", "\x1b[31m",
)  # fmt: skip
"""Values of a cell, an argument or a link."""
VALUES = (
    None, True, False, 0, -1, 1, 2**62, -(2**62), 0.0, -0.0, 1e308, -1e308, 1e-320, 1e40, 1e-40,
    0.5, "nan", "inf", "-inf", "", "x", "x" * 5000, "\x1b[31m", "\u202e", [], {}, [[]], [0.5] * 3,
    "segments.0.speeds", "estimate.curves.0.time",
)  # fmt: skip
"""Values in a JSON document."""


def text(draw: Random) -> str:
    """A token, or a few letters."""
    if draw.random() < 0.7:
        return draw.choice(TOKENS)
    return "".join(draw.choice(string.printable) for _ in range(draw.randrange(12)))


def spoil_bytes(data: bytes, draw: Random) -> bytes:
    """A file with stretches of bytes lost, doubled or replaced, or one byte made another."""
    for _ in range(draw.choice((1, 1, 2, 5))):
        at, other = (draw.randrange(len(data) + 1) for _ in range(2))
        end = at + draw.choice((1, 2, 8, 100, 3000))
        part, inserted = data[at:end], text(draw).encode()
        noise = draw.randbytes(min(20, len(part)))
        several = part * draw.choice((2, 3, 51))
        pieces = (b"", noise, several, inserted, inserted + part, data[other : other + 500])
        replaced = [data[:at] + piece + data[end:] for piece in pieces]
        old, new = (bytes([draw.choice(b',;\t\n\r. "0159-e')]) for _ in range(2))
        data = draw.choice((*replaced, data[:at], inserted + data, data.replace(old, new)))
    return data


def spoil_table(table: bytes, draw: Random, header: int) -> bytes:
    """A table of comma-separated values with cells, columns or rows changed.

    Args:
        table: its bytes.
        draw: what to change.
        header: the row with the names of the columns.
    """
    rows = [line.split(",") for line in table.decode().splitlines()]
    for _ in range(draw.choice((1, 1, 2, 4))):
        if len(rows) < header + 2 or not rows[header]:  # some files are empty
            break
        body, width = rows[header + 1 :], len(rows[header])
        at, count = draw.randrange(header + 1, len(rows)), draw.choice((1, 10, 100))
        change = draw.choice(("cell", "cell", "cell", "repeat", "shuffle", "head"))
        if change == "cell":
            column, other, word = draw.randrange(width), draw.randrange(width), text(draw)
            factor, share = draw.choice((0.0, -1.0, 1e-6, 1e6, 3.6, 1e300)), draw.random()
            some = [row for row in body if draw.random() < share]
            places = ([rows[at]], rows[: header + 1], [rows[header]], some, body, rows[header:])
            cells = draw.choice(("word", "word", "scaled", "lost", "doubled", "another"))
            for row in draw.choice(places):
                if column < len(row):
                    row[column : column + 1] = {
                        "word": [word], "scaled": [_scaled(row[column], factor)], "lost": [],
                        "doubled": 2 * [row[column]], "another": row[other : other + 1],
                    }[cells]  # fmt: skip
        elif change == "repeat":
            rows[at : at + count] = rows[at : at + count] * draw.choice((0, 2))
        elif change == "shuffle":
            draw.shuffle(body)
            rows[header + 1 :] = body
        else:
            del rows[draw.randrange(header + 1)]
            header = max(0, header - 1)
    end = draw.choice(("\n", "\n", "\r\n", "\r", "\n\n"))
    return end.join(",".join(row) for row in rows).encode("utf-8", "replace")


def _scaled(cell: str, factor: float) -> str:
    try:
        return repr(float(cell) * factor)
    except ValueError:
        return cell


def spoil_tree(tree: Any, draw: Random) -> Any:
    """A JSON document with values, names or parts changed."""
    tree = deepcopy(tree)
    for _ in range(draw.choice((1, 1, 1, 2, 4))):
        holder, key = _somewhere(tree, draw)
        if holder is None:
            return draw.choice(VALUES)
        kind = draw.randrange(8)
        if kind == 0:
            del holder[key]
        elif kind == 1 and isinstance(holder, dict):
            holder[text(draw)] = holder[key]
        elif kind == 1:
            holder.insert(0, deepcopy(holder[key]))
        elif kind == 2:
            other, name = _somewhere(tree, draw)
            holder[key] = deepcopy(other[name])
        elif kind == 3 and isinstance(holder[key], int | float):
            holder[key] = holder[key] * draw.choice((-1, 0, 1.0001, 1e6, 1e-6, 0.6))
        else:
            holder[key] = deepcopy(draw.choice(VALUES))
    return tree


def _somewhere(tree: Any, draw: Random) -> tuple[Any, Any]:
    """A container within a tree and one of its keys; None where the tree is none."""
    parent = (None, None)
    while isinstance(tree, dict | list) and tree:
        key = draw.choice(sorted(tree)) if isinstance(tree, dict) else draw.randrange(len(tree))
        parent, tree = (tree, key), tree[key]
        if draw.random() < 0.15:
            break
    return parent
