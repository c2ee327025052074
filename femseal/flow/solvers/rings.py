"""Continue the fields of a ring periodically over the borders of a grid."""

from __future__ import annotations

from ...base.compiled import REORDERED, inlined


@inlined(**REORDERED)
def wrap_row(row):
    """Continue a row of a ring periodically: copy the last node to the left border, and the first node to the right."""
    row[0], row[-1] = row[-2], row[1]


@inlined(**REORDERED)
def wrap_rows(field, first, end):
    """Continue the rows `first` to `end` − 1 of a ring periodically."""
    for i in range(first, end):
        wrap_row(field[i])
