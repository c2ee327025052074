"""Pieces of a face: rectangles cut out of its contact, each with two permeabilities by closed sides.

A piece lies in the contact of the whole face, whose long waves hold its valleys open; pressed by itself, a piece of a
few waves flattens them. Closed sides cut detours off, so that the pieces in their own order leak less than the face:
a correction factor for each axis in every state makes up for that.
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
from .piece_flow import Failed, FlowSettings, SolveCounts, attempt, piece_permeability

#: Pieces along the shorter side of a face from which seals are drawn, and where a seal is as broad as the face: in
#: their own rows two keep the channels that cross from row to row. Measured in docs/evidence/drawn_seals.md.
PIECES, PIECES_IN_PLACE = 4, 2
#: Fewest points of a piece along a side.
FEWEST_POINTS = 8
#: Overlap of a cell with each neighbour beside the flow, as a fraction of the cell. Channels that leave the cell and
#: come back are kept; only the flux in the cell itself counts, see `flow.core_flux`.
OVERLAP = 0.125
#: Most by which the factor of a state may differ from 1 where pieces are drawn from the whole face, and the leakage of
#: a seal from that of the face where they stay in their rows. Beyond, both are those of single constrictions.
MOST_FACTOR, MOST_RATIO = 3.0, 2.0


def usual_pieces(surface: Surface, in_place: bool = False) -> Shape:
    """Numbers of about square pieces along x1 and x2, four on the shorter side of a place.

    in_place : pieces stay in their rows, as where a seal is as broad as the face: two.
    """
    widths = _widths(surface)
    (d1, d2), n1 = surface.spacing, surface.shape[0]
    side = min(n1 * d1, min(widths) * d2) / (PIECES_IN_PLACE if in_place else PIECES)
    m1 = max(1, min(round(n1 * d1 / side), n1 // FEWEST_POINTS))
    return m1, sum(
        max(1, min(round(width * d2 / side), width // FEWEST_POINTS)) for width in widths
    )


def _widths(surface: Surface) -> tuple[int, ...]:
    """Points along x2 of every measured place."""
    return surface.widths


#: How a surface continues along x1 and x2, as of a `HalfSpace`.
Boundary = tuple[str, str]


@dataclass(frozen=True, eq=False)
class WidenedCell:
    """A cell with parts of its neighbours on both sides of the flow.

    field : values at its points (n1, n2). core : first number of the points across the flow that belong to the cell
    itself, and the number after the last one.
    """

    field: NDArray[Any]
    core: tuple[int, int]


@dataclass(frozen=True)
class Cut:
    """The lines at which a face is cut into pieces, between points.

    rows, columns : numbers of the first point of each piece along x1 and x2, and the number of all points.
    place : number of the measured place of every column of pieces, from 0.
    spacing : of the points [m].
    """

    rows: tuple[int, ...]
    columns: tuple[int, ...]
    place: tuple[int, ...]
    spacing: Pair

    @classmethod
    def of(cls, surface: Surface, pieces: Shape) -> Cut:
        """Cut a face into pieces along x1 and x2, in each of several places by itself.

        Raises InputError: pieces of fewer than 8 points a side, fewer columns than places.
        """
        widths, (m1, m2) = _widths(surface), validate.grid("cells", pieces)
        if m2 < len(widths):
            raise InputError("cells", pieces, f"along x2 from {len(widths)}, one for each place")
        of_place = _shares(widths, min(m2, sum(widths)))
        sides = [(surface.shape[0], m1), *zip(widths, of_place, strict=True)]
        if any(n // m < FEWEST_POINTS for n, m in sides if m > 1):
            given = "{} × {} of {} × {} points".format(m1, m2, *surface.shape)
            raise InputError(
                "cells", given, f"pieces of at least {FEWEST_POINTS} × {FEWEST_POINTS} points"
            )
        columns, place = [0], []
        for number, (width, count) in enumerate(zip(widths, of_place, strict=True)):
            columns += _lines(columns[-1], width, count)[1:]
            place += [number] * count
        return cls(
            tuple(_lines(0, surface.shape[0], m1)), tuple(columns), tuple(place), surface.spacing
        )

    @property
    def shape(self) -> Shape:
        """Number of pieces along x1 and x2."""
        return len(self.rows) - 1, len(self.columns) - 1

    @property
    def size(self) -> Pair:
        """Mean sides of the pieces [m]."""
        (m1, m2), (d1, d2) = self.shape, self.spacing
        return self.rows[-1] * d1 / m1, self.columns[-1] * d2 / m2

    @property
    def centres(self) -> tuple[Array, Array]:
        """x1 and x2 of the centres of the pieces [m]."""
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

    def pieces(self, fields: NDArray[Any]) -> list[NDArray[Any]]:
        """The pieces of fields (…, n1, n2), row by row."""
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
        """First point, and that after the last, of the measured place of a column of pieces."""
        first = self.place.index(self.place[column])
        return self.columns[first], self.columns[first + self.place.count(self.place[column])]

    def sums(self, field: NDArray[Any]) -> Array:
        """Sum over each piece (m1, m2) of a field (n1, n2)."""
        return np.array([piece.sum(dtype=float) for piece in self.pieces(field)]).reshape(
            self.shape
        )

    def means(self, field: NDArray[Any]) -> Array:
        """Mean over each piece (m1, m2) of a field (n1, n2)."""
        return self.sums(field) / np.outer(np.diff(self.rows), np.diff(self.columns))


def _shares(widths: Sequence[int], columns: int) -> list[int]:
    """Columns of each place, in proportion to its width; those left over go to the largest remainders."""
    wanted = np.array(widths) * (columns / sum(widths))
    found = np.maximum(wanted.astype(int), 1)
    while found.sum() != columns:
        if found.sum() < columns:
            found[np.argmax(wanted - found)] += 1
        else:
            found[np.argmin(np.where(found > 1, wanted - found, np.inf))] -= 1
    return [int(n) for n in found]


def _overlapping(
    cell: tuple[int, int], patch: tuple[int, int], boundary: str
) -> tuple[Indices, tuple[int, int]]:
    """Find the points across the flow of a cell and its overlaps, and which of them are its core.

    cell, patch : first point, and that after the last, of the cell and of the measured patch that it belongs to.
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
    """Numbers of points at which so many points are cut into equal parts, to a point."""
    return [first + round(n * points / count) for n in range(count + 1)]


@dataclass(frozen=True, eq=False)
class PieceState:
    """The pieces of a face in one state.

    k : permeability at each pressure of the drop, along x1 and x2 (pressures, 2, m1, m2) [m³].
    pressure [Pa], mean_gap [m], contact_fraction, plastic_fraction : means of the pieces (m1, m2). drop_fraction : the
    dissipation in a piece over that in all of them; NaN where nothing flows. rows : mean pressure of the rows of points
    (n1,) [Pa]. counts : flows through pieces, solved or known without solving. failures : reasons of NaN.
    face, places : permeability of the whole face, and by its places [m³]. failed : why the flow through it is unknown.
    carriers : number of blocks that effectively carry the flow through the whole surface, see `participation_number`.
    surface_k2 : permeability of the whole surface along x2 [m³], mean over its measured patches; NaN if not solved.
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
    places: Array | None = None
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
    ) -> PieceState:
        """Cut gap [m] and contact pressure [Pa] of a face (n1, n2) into pieces, and solve the flow through each.

        plastic : whether a point is at the hardness. fractions : of the pressure drop at every point. Their means and
        sums are NaN without them. boundary : how the surface continues, see `Cut.widened`.
        """
        k = np.full((flow.drop.pressures.size, 2, *cut.shape), np.nan)
        counts, failures = [], []
        for axis in (0, 1):
            cells = cut.widened(gap, axis, boundary)
            for place, cell in zip(np.ndindex(*cut.shape), cells, strict=True):
                if not np.isfinite(cell.field).all():
                    continue
                wide = np.array(cell.field, float)
                found = attempt(piece_permeability, wide, cut.spacing, axis, flow, cell.core)
                if isinstance(found, Failed):
                    failures.append(f"piece {place}, x{axis + 1}: {found.reason}")
                    continue
                k[:, axis, *place] = found.k
                counts.append(found.counts)
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
    """Compute the correction factor of every state by which the cells in their own order leak what the face leaks.

    It is that of one axis. Where one of both is sealed, or unknown, that of the nearest state of the same branch that
    has one; 1 without any.
    At most `most` times larger or smaller than 1: near closing single constrictions decide, which no seal repeats.

    face, own : leakage or permeability of the face along the axis, and of its cells in their own order (steps,).

    Returns the factors (steps,).
    """
    with np.errstate(divide="ignore", invalid="ignore"):
        logs = np.log(face / own)
    found = np.zeros(len(steps))
    for branch in steps.branches:
        known = np.flatnonzero(np.isfinite(logs[branch]))
        if known.size:
            at = np.arange(len(branch))
            nearest = known[np.abs(at[:, None] - known).argmin(axis=1)]
            found[branch] = logs[branch[nearest]]
    return np.exp(np.clip(found, -np.log(most), np.log(most)))
