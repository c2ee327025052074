"""Shapes of seals that a case can choose: each lays out a map of windows, cut from a face or drawn, as a seal.

To add a shape, write a frozen dataclass with its `kind`, the parameters that a case gives besides the map (see
`base.parameters`) and `seal`, and put it into `LAYOUTS`.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar, Protocol

from .shapes import RectangularSeal


class Layout(Protocol):
    """Interface of the shapes of seals that studies take."""

    def seal(self, size: tuple[float, float], cells: tuple[int, int], rows: tuple[float, ...] = ()) -> RectangularSeal:
        """The seal of a map of windows.

        Parameters
        ----------
        size : of the map along x1, from inlet to outlet, and along x2 [m].
        cells : windows along x1 and x2.
        rows : x1 of the rows of nodes [m]; equidistant unless given.
        """
        ...


@dataclass(frozen=True)
class RectangularLayout:
    """A straight strip, which is the map itself; it goes on periodically along x2."""

    kind: ClassVar[str] = "rectangular"

    def seal(self, size: tuple[float, float], cells: tuple[int, int], rows: tuple[float, ...] = ()) -> RectangularSeal:
        """The strip."""
        return RectangularSeal(size, cells, rows)


#: Shapes that a case can choose, by their kind.
LAYOUTS: dict[str, Any] = {layout.kind: layout for layout in (RectangularLayout,)}
