"""Whole arrays in the cells of a table, as data frames write them."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np

from excite.conversion.recording import Column, Stream

_ARRAY = re.compile(r"\s*(?:(?:np\.|torch\.)?(?:array|tensor)\()?\s*[\[(]")
# Not the 64 of np.float64(0.5), as numpy writes the numbers of a list.
_NUMBER = re.compile(r"(?<![A-Za-z\d.])[+-]?(?:\d+\.?\d*(?:[eE][+-]?\d+)?|\.\d+(?:[eE][+-]?\d+)?|nan|inf)")
_WORD = re.compile(r"""["']([^"']+)["']""")
# Rows that a killed logger leaves incomplete are few.
_WHOLE = 0.95


def unpack_cells(stream: Stream) -> tuple[Stream, str]:
    """The stream with ``NAME[0] … NAME[k-1]`` for a column whose cells hold ``k`` numbers each, and a note.

    Cells that hold words, as names of joints, are words of ``NAME[0]`` and so on.
    """
    columns, words, done = list(stream.columns), dict(stream.words), []
    for name, cells in stream.words.items():
        first = next((str(cell) for cell in cells if cell), "")
        if not _ARRAY.match(first):
            continue
        quoted = _WORD.findall(first)
        if quoted:
            del words[name]
            if all(cell == cells[0] for cell in cells):
                words |= {f"{name}[{k}]": np.full(len(cells), word, object) for k, word in enumerate(quoted)}
            continue
        found = [_NUMBER.findall(str(cell)) for cell in cells]
        width = len(_NUMBER.findall(first))
        whole = np.array([len(numbers) == width for numbers in found])
        if not width or whole.mean() < _WHOLE:
            continue
        none = [float("nan")] * width
        table = np.array(
            [numbers if there else none for numbers, there in zip(found, whole, strict=True)], float
        )
        columns += [Column(f"{name}[{k}]", table[:, k]) for k in range(width)]
        del words[name]
        done.append(name)
    note = f"cells of {', '.join(done)} hold arrays, a column each here" if done else ""
    return replace(stream, columns=tuple(columns), words=words), note
