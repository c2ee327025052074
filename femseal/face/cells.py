"""Cut a surface into cells: rectangles of its contact, each with two permeabilities between closed sides.

A cell lies in the contact of the whole surface, whose long waves hold its valleys open; pressed by itself, a cell of a
few waves would flatten them. Closed sides cut off detours, so that the cells in their own order leak less than the
surface. A correction factor for each axis in every state makes up for that.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..base import Array, Flags, Floats, Indices, InputError, Pair, Shape, validate
from ..loads import LoadProgramme
from ..topography import Surface
from .cell_flow import Failed, FlowSettings, SolveCounts, attempt, cell_permeabilities

#: Cells along the shorter side of a surface where they are put together at random, and where they stay in order. There,
#: two cells keep the channels that cross from row to row. Measured in docs/evidence/drawn_seals.md.
CELLS, CELLS_IN_ORDER = 4, 2
#: Fewest points of a cell along a side.
FEWEST_POINTS = 8
#: Overlap of a cell with each neighbour beside the flow, as a fraction of the cell. Channels that leave the cell and
#: come back are kept; only the flux in the cell itself counts, see `flow.core_flux`.
OVERLAP = 0.125
#: Largest correction factor, and largest ratio of the leakage of a seal to that of the surface where cells stay in
#: order. Beyond these limits both would be those of single constrictions.
MOST_FACTOR, MOST_RATIO = 3.0, 2.0


def usual_cells(surface: Surface, in_order: bool = False) -> Shape:
    """Return the usual numbers of about square cells along x1 and x2: four on the shorter side of a patch.

    in_order : whether cells stay in order, because the seal is as broad as the surface; then two.
    """
    widths = surface.widths
    (d1, d2), n1 = surface.spacing, surface.shape[0]
    side = min(n1 * d1, min(widths) * d2) / (CELLS_IN_ORDER if in_order else CELLS)
    m1 = max(1, min(round(n1 * d1 / side), n1 // FEWEST_POINTS))
    return m1, sum(
        max(1, min(round(width * d2 / side), width // FEWEST_POINTS)) for width in widths
    )


#: How a surface continues along x1 and x2, as of a `HalfSpace`.
Boundary = tuple[str, str]


@dataclass(frozen=True, eq=False)
class WidenedCell:
    """A cell with parts of its neighbours on both sides of the flow.

    Parameters
    ----------
    field : values at its points, array (n1, n2).
    core : first number of the points across the flow that belong to the cell itself, and the number after the last one.
    """

    field: NDArray[Any]
    core: tuple[int, int]


@dataclass(frozen=True)
class Cut:
    """The lines between points at which a surface is cut into cells.

    Parameters
    ----------
    rows, columns : number of the first point of each cell along x1 and x2, and the number of all points.
    place : number of the measured patch of every column of cells, from 0.
    spacing : of the points, m.
    """

    rows: tuple[int, ...]
    columns: tuple[int, ...]
    place: tuple[int, ...]
    spacing: Pair

    @classmethod
    def of(cls, surface: Surface, cells: Shape) -> Cut:
        """Cut a surface into cells along x1 and x2; several patches are cut separately.

        Raises InputError: cells of fewer than 8 points a side; fewer columns than patches.
        """
        widths, (m1, m2) = surface.widths, validate.grid("cells", cells)
        if m2 < len(widths):
            raise InputError("cells", cells, f"along x2 from {len(widths)}, one for each patch")
        of_patch = _shares(widths, min(m2, sum(widths)))
        sides = [(surface.shape[0], m1), *zip(widths, of_patch, strict=True)]
        if any(n // m < FEWEST_POINTS for n, m in sides if m > 1):
            given = "{} × {} of {} × {} points".format(m1, m2, *surface.shape)
            raise InputError(
                "cells", given, f"cells of at least {FEWEST_POINTS} × {FEWEST_POINTS} points"
            )
        columns, place = [0], []
        for number, (width, count) in enumerate(zip(widths, of_patch, strict=True)):
            columns += _lines(columns[-1], width, count)[1:]
            place += [number] * count
        return cls(
            tuple(_lines(0, surface.shape[0], m1)), tuple(columns), tuple(place), surface.spacing
        )

    @property
    def shape(self) -> Shape:
        """Numbers of cells along x1 and x2."""
        return len(self.rows) - 1, len(self.columns) - 1

    @property
    def size(self) -> Pair:
        """Mean sides of the cells [m]."""
        (m1, m2), (d1, d2) = self.shape, self.spacing
        return self.rows[-1] * d1 / m1, self.columns[-1] * d2 / m2

    @property
    def centres(self) -> tuple[Array, Array]:
        """Coordinates x1 and x2 of the centres of the cells [m]."""
        rows, columns = (
            np.array(of) * d for of, d in zip((self.rows, self.columns), self.spacing, strict=True)
        )
        return (rows[:-1] + rows[1:]) / 2, (columns[:-1] + columns[1:]) / 2

    @property
    def patch_columns(self) -> list[slice]:
        """Columns of cells of every measured patch."""
        numbers = np.array(self.place)
        ends = [*np.flatnonzero(np.diff(numbers)) + 1, len(numbers)]
        return [slice(int(a), int(b)) for a, b in pairwise([0, *ends])]

    def split(self, fields: NDArray[Any]) -> list[NDArray[Any]]:
        """Cut fields (…, n1, n2) into cells, row by row."""
        return [
            fields[..., a:b, c:d] for a, b in pairwise(self.rows) for c, d in pairwise(self.columns)
        ]

    def widened(
        self, field: NDArray[Any], axis: int, boundary: Boundary = ("free", "periodic")
    ) -> list[WidenedCell]:
        """Cut a field (n1, n2) into cells that overlap with their neighbours beside the flow along an axis, row by row.

        boundary : how the surface continues along x1, and each measured patch along x2: "periodic", as its "mirror"
            image, or not at all ("free"), so that the overlap ends there.
        """
        cells = []
        for rows in pairwise(self.rows):
            for column, columns in enumerate(pairwise(self.columns)):
                if axis == 0:
                    beside, core = _overlapping(columns, self._place(column), boundary[1])
                    wide = field[rows[0] : rows[1], beside]
                else:
                    beside, core = _overlapping(rows, (0, self.rows[-1]), boundary[0])
                    wide = field[beside, columns[0] : columns[1]]
                cells.append(WidenedCell(wide, core))
        return cells

    def _place(self, column: int) -> tuple[int, int]:
        """Return the first point, and the one after the last, of the measured patch of a column of cells."""
        first = self.place.index(self.place[column])
        return self.columns[first], self.columns[first + self.place.count(self.place[column])]

    def sums(self, field: NDArray[Any]) -> Array:
        """Sum a field (n1, n2) over each cell (m1, m2)."""
        return np.array([cell.sum(dtype=float) for cell in self.split(field)]).reshape(self.shape)

    def means(self, field: NDArray[Any]) -> Array:
        """Average a field (n1, n2) over each cell (m1, m2)."""
        return self.sums(field) / np.outer(np.diff(self.rows), np.diff(self.columns))


def _shares(widths: Sequence[int], columns: int) -> list[int]:
    """Distribute columns over patches in proportion to their widths; those left over go to the largest remainders."""
    wanted = np.array(widths) * (columns / sum(widths))
    shares = np.maximum(wanted.astype(int), 1)
    while shares.sum() != columns:
        if shares.sum() < columns:
            shares[np.argmax(wanted - shares)] += 1
        else:
            shares[np.argmin(np.where(shares > 1, wanted - shares, np.inf))] -= 1
    return [int(share) for share in shares]


def _overlapping(
    cell: tuple[int, int], patch: tuple[int, int], boundary: str
) -> tuple[Indices, tuple[int, int]]:
    """Find the points across the flow of a cell with its overlaps, and which of them are its core.

    Parameters
    ----------
    cell, patch : first point, and the one after the last, of the cell and of the measured patch that it belongs to.
    boundary : how the patch continues, see `Cut.widened`.
    """
    first, end = patch
    overlap = round(OVERLAP * (cell[1] - cell[0]))
    points = np.arange(cell[0] - overlap, cell[1] + overlap) - first
    size = end - first
    if boundary == "periodic":
        inside = points % size
    elif boundary == "mirror":
        image = points % (2 * size)
        inside = np.minimum(image, 2 * size - 1 - image)
    else:
        inside = points[(points >= 0) & (points < size)]
    before = int((points[:overlap] >= 0).sum()) if boundary == "free" else overlap
    return inside + first, (before, before + cell[1] - cell[0])


def _lines(first: int, points: int, count: int) -> list[int]:
    """Return the numbers of points at which so many points are cut into equal parts, to a point."""
    return [first + round(n * points / count) for n in range(count + 1)]


@dataclass(frozen=True, eq=False)
class CellState:
    """The cells of a surface in one state.

    Parameters
    ----------
    k : permeability at each pressure of the fluid, along x1 and x2, array (pressures, 2, m1, m2), m³.
    pressure, mean_gap, contact_fraction, plastic_fraction : means over the cells, arrays (m1, m2), Pa, m, 1, 1.
    drop_fraction : fraction of the dissipation in each cell, array (m1, m2); NaN where nothing flows.
    rows : mean pressure of the rows of points, array (n1,), Pa.
    counts : numbers of flows through cells that were solved, or known without solving.
    failures : reasons of NaN.
    face, patches : permeability of the whole surface, and of its patches, m³.
    surface_k2 : permeability of the whole surface along x2, m³, mean over its patches; NaN if it was not solved.
    failed : why the flow through the whole surface is unknown; "" if it is known.
    carriers : number of blocks that effectively carry the flow through the whole surface, see `participation_number`.
    """

    k: Array
    pressure: Array
    mean_gap: Array
    contact_fraction: Array
    plastic_fraction: Array
    drop_fraction: Array
    rows: Array
    counts: SolveCounts
    failures: tuple[str, ...] = ()
    face: float = np.nan
    surface_k2: float = np.nan
    patches: Array | None = None
    failed: str = ""
    carriers: float = np.nan

    @classmethod
    def of(
        cls,
        gap: Floats,
        pressure: Floats,
        cut: Cut,
        flow: FlowSettings,
        plastic: Flags | float = np.nan,
        fractions: Floats | float = np.nan,
        boundary: Boundary = ("free", "periodic"),
    ) -> CellState:
        """Cut gap and contact pressure of a surface into cells, and solve the flow through each.

        Parameters
        ----------
        gap, pressure : arrays (n1, n2), m and Pa.
        cut : of the surface into cells.
        flow : how the flow is solved.
        plastic : whether a point is at the hardness, array (n1, n2); its mean is NaN without it.
        fractions : of the pressure drop at every point, array (n1, n2); its sum is NaN without it.
        boundary : how the surface continues, see `Cut.widened`.
        """
        k = np.full((flow.drop.pressures.size, 2, *cut.shape), np.nan)
        counts, failures = [], []
        for axis in (0, 1):
            cells = cut.widened(gap, axis, boundary)
            for place, cell in zip(np.ndindex(*cut.shape), cells, strict=True):
                if not np.isfinite(cell.field).all():
                    continue
                wide = np.array(cell.field, float)
                solution = attempt(cell_permeabilities, wide, cut.spacing, axis, flow, cell.core)
                if isinstance(solution, Failed):
                    failures.append(f"cell {place}, x{axis + 1}: {solution.reason}")
                    continue
                k[:, axis, *place] = solution.k
                counts.append(solution.counts)
        return cls(
            k=k,
            pressure=cut.means(pressure),
            mean_gap=cut.means(gap),
            contact_fraction=cut.means(pressure > 0),
            plastic_fraction=cut.means(np.broadcast_to(plastic, gap.shape)),
            drop_fraction=cut.sums(np.broadcast_to(fractions, gap.shape)),
            rows=pressure.mean(axis=1, dtype=float),
            counts=SolveCounts.total(counts),
            failures=tuple(failures),
        )


def factors(face: Array, own: Array, steps: LoadProgramme, most: float = MOST_FACTOR) -> Array:
    """Compute the correction factor of one axis in every state, by which the cells leak what the surface leaks.

    Where the surface or its cells are sealed, or unknown, the factor is that of the nearest state of the same branch
    that has one; it is 1 without any. It is limited to `most` times larger or smaller than 1: near closing it is that
    of single constrictions, which no other seal repeats.

    Parameters
    ----------
    face, own : leakage or permeability of the surface along the axis, and of its cells in their own order, arrays
        (steps,).
    steps : the load programme.
    most : limit of the factor.

    Returns an array (steps,).
    """
    with np.errstate(divide="ignore", invalid="ignore"):
        logs = np.log(face / own)
    log_factor = np.zeros(len(steps))
    for branch in steps.branches:
        known = np.flatnonzero(np.isfinite(logs[branch]))
        if known.size:
            position = np.arange(len(branch))
            nearest = known[np.abs(position[:, None] - known).argmin(axis=1)]
            log_factor[branch] = logs[branch[nearest]]
    return np.exp(np.clip(log_factor, -np.log(most), np.log(most)))
