"""Transform the rows of a grid to waves and back, for a `Convolution`."""

from __future__ import annotations

from functools import partial
from typing import Any

from ..base import Indices
from ..base.compiled import parts
from .fft_plans import Axis, Call, Planned, fftw
from .wave_loops import copy_back, copy_in_order

#: Smallest number of points of the rows that are transformed together.
ROW_POINTS = 2**16
#: Largest number of parts into which all rows are divided.
ROW_PARTS = 16


class Rows:
    """Transform the rows of a grid and back, for rows that need neither reordering nor padding.

    pressure : pressure (n1, n2) [Pa].
    rows : displacement (n1, >= n2) [m], followed by unused values in each row.
    waves : waves of all rows of the grid, followed by the waves of rows of zeros if the first axis is padded.
    axis2 : second axis of the grid, along which the rows run.
    """

    def __init__(self, pressure: Any, rows: Any, waves: Any, axis2: Axis) -> None:
        self.points = pressure
        self.target = rows[:, : axis2.length]
        self.waves = waves
        self.length = axis2.length

    def calls(self, planned: Planned) -> tuple[list[list[Call]], list[list[Call]]]:
        """Return two nested lists of calls (part, call): one for the transforms, and one for the inverse transforms.

        A part consists of successive rows.
        """
        forward_parts = []
        backward_parts = []
        n1 = len(self.target)
        rows_of_part = max(ROW_POINTS / self.length, n1 / ROW_PARTS)
        for first, end in parts(n1, rows_of_part):
            forward, backward = planned(
                self.points[first:end], self.waves[first:end], self.target[first:end], axis=1
            )
            forward_parts.append([*self.before(first, end), forward])
            backward_parts.append([backward, *self.after(first, end)])
        return forward_parts, backward_parts

    def before(self, first: int, end: int) -> list[Call]:
        """Return the calls that must run before the rows `first` to `end` − 1 are transformed."""
        return []

    def after(self, first: int, end: int) -> list[Call]:
        """Return the calls that must run after the rows `first` to `end` − 1 have been transformed back."""
        return []


class ReorderedRows(Rows):
    """Transform rows whose points must first be reordered (mirror axis) or padded with zeros (free axis).

    order1 : order in which the rows are copied. On small grids, this is the order of the transform along the first
        axis; on large grids, it is the order of the grid.
    is_mirror : whether at least one axis is a mirror, so that its points are reordered.
    """

    def __init__(
        self,
        pressure: Any,
        rows: Any,
        waves: Any,
        axis2: Axis,
        order1: Indices,
        is_mirror: bool,
        is_large: bool,
    ) -> None:
        super().__init__(pressure, rows, waves, axis2)
        # On small grids, the reordered rows need additional memory. On large grids only the points of each row are
        # reordered, which is possible within the memory of the row.
        if is_mirror and not is_large:
            self.target = fftw().empty_aligned(self.target.shape, self.target.dtype)
        self.points = self.target  # the points are copied there before the transform
        self.pressure = pressure
        self.displacement = rows[:, : axis2.points] if is_mirror else None
        self.orders = order1, axis2.order

    def before(self, first: int, end: int) -> list[Call]:
        """Return the call that copies the rows `first` to `end` − 1 in the order of the transform and appends zeros."""
        return [partial(copy_in_order, self.pressure, self.target, *self.orders, first, end)]

    def after(self, first: int, end: int) -> list[Call]:
        """Return the call that restores the grid order of the points, or no call if they were not reordered."""
        if self.displacement is None:
            return []
        return [partial(copy_back, self.target, self.displacement, *self.orders, first, end)]
