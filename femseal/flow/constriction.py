"""The critical constriction: the narrowest place of the widest path, which controls the leakage near closing.

Links open in the order of their gap, the widest first; the one that joins inlet and outlet is critical. Source:
Ambegaokar, Halperin & Langer, Phys. Rev. B 4, 1971, 2612; for seals Persson & Yang, J. Phys. Condens. Matter 20, 2008,
315011.
"""

from __future__ import annotations

from bisect import bisect_left
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike

from ..base.arrays import Lengths
from .coefficient import gap_on_links, validated_cell
from .percolation import nodes_reached


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
    # a link is as wide as the number of those after it, as two may have the same gap
    width = np.empty(values.size)
    width[widest_first] = np.arange(values.size, 0, -1)
    width[values <= 0] = 0
    along, across = width[: h1.size].reshape(h1.shape), width[h1.size :].reshape(h2.shape)
    opened = bisect_left(
        range(1, np.count_nonzero(width) + 1),
        True,
        key=lambda n: bool(nodes_reached(along, across, values.size - n + 1)[0, 0] == 3),
    )
    if opened == np.count_nonzero(width):
        return None
    link = int(widest_first[opened])
    if link < h1.size:
        i, j = divmod(link, h1.shape[1])
        position = (i * d1, (j + 0.5) * d2)
    else:
        i, j = divmod(link - h1.size, h2.shape[1])
        position = ((i + 0.5) * d1, (j + 1) * d2)
    return Constriction(position if axis == 0 else position[::-1], float(values[link]))
