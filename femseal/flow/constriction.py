"""The critical constriction: the narrowest place of the widest path, which controls the leakage near closing.

Links open in the order of their gap, the widest first; the one that joins inlet and outlet is critical. Source:
Ambegaokar, Halperin & Langer, Phys. Rev. B 4, 1971, 2612; for seals Persson & Yang, J. Phys. Condens. Matter 20, 2008,
315011.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike

from ..base.arrays import Lengths
from ..base.compiled import compiled
from .coefficient import gap_on_links, validated_cell
from .percolation import find, union


@dataclass(frozen=True)
class Constriction:
    """Where the widest path from inlet to outlet is narrowest, and how wide it is there."""

    position: tuple[float, float] = field(
        metadata={"unit": "m", "long_name": "place between two pixels (x1, x2)"}
    )
    gap: float = field(metadata={"unit": "m", "long_name": "gap there"})


def critical_constriction(
    gap: ArrayLike, spacing: Lengths, *, axis: int = 0, sides: str = "mirror"
) -> Constriction | None:
    """Critical constriction of a cell, None where the gap does not percolate.

    Parameters
    ----------
    gap, spacing, axis, sides : as in `cell_permeability`, whose gap midway between two pixels is used.

    Raises
    ------
    InputError : as `cell_permeability`.
    """
    h, (d1, d2) = validated_cell(gap, spacing, axis, sides)
    h1, h2 = gap_on_links(h, False, sides == "periodic")
    values = np.concatenate([h1.ravel(), h2.ravel()])
    widest_first = np.argsort(-values, kind="stable")
    link = _joining(widest_first, values, h.shape[0], h.shape[1], h2.shape[1])
    if link < 0:
        return None
    if link < h1.size:
        i, j = divmod(int(link), h1.shape[1])
        position = (i * d1, (j + 0.5) * d2)
    else:
        i, j = divmod(int(link) - h1.size, h2.shape[1])
        position = ((i + 0.5) * d1, (j + 1) * d2)
    return Constriction(position if axis == 0 else position[::-1], float(values[link]))


@compiled()
def _joining(widest_first, values, n1, n2, m2):
    """Number of the link that joins inlet and outlet; −1 without an open path."""
    parent = np.arange(n1 * n2 + 2).astype(np.int32)
    inlet, outlet = n1 * n2, n1 * n2 + 1
    along = (n1 + 1) * n2
    for link in widest_first:
        if values[link] <= 0.0:
            return -1
        if link < along:
            i, j = link // n2, link % n2
            a = inlet if i == 0 else (i - 1) * n2 + j
            b = outlet if i == n1 else i * n2 + j
        else:
            i, j = (link - along) // m2, (link - along) % m2
            a, b = i * n2 + j, i * n2 + (j + 1) % n2
        if union(parent, a, b) and find(parent, inlet) == find(parent, outlet):
            return link
    return -1
