"""Tables of numbers that are no matrix of heights: coordinates x y z on a regular grid, profiles, axes beside a map.

A table x y z names the points of a grid in any order. Points that it does not name are undefined. Coordinates are
rounded as they are written, so that equal steps differ by a few per cent.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..base import Indices, InputError, Pair, as_text, counted

#: Coordinates may lie this fraction of a step beside the grid.
_OFF_GRID = 0.15
#: A table whose points fill this fraction of a grid is taken for coordinates whatever the number of its columns; one
#: of three columns from the second fraction on, and if it has as many lines.
_WELL_FILLED, _HARDLY_FILLED, _FEWEST_LINES = 0.5, 0.1, 9
#: Grids and profiles have no fewer points.
_FEWEST_OF_GRID, _SHORTEST_PROFILE = 4, 3


@dataclass(frozen=True, eq=False)
class MapOfTable:
    """Heights (n1, n2), x first, that a table of numbers holds.

    steps : between coordinates along x and y, in their unit; None of a matrix. columns : of x, y and z, from 0.
    notes : sentences on how the table was understood.
    """

    heights: NDArray
    steps: Pair | None = None
    columns: tuple[int, int, int] = (0, 1, 2)
    notes: tuple[str, ...] = ()


def map_of_table(table: NDArray, names: Sequence[str] = ()) -> MapOfTable:
    """Heights of a table of numbers (lines, columns), a matrix or coordinates.

    names : of the columns, "" or none where they are not known.

    Raises InputError: a profile, or coordinates on no regular grid.
    """
    refuse_profile(table)
    found = grid_of_coordinates(table, names)
    if found is not None:
        return found
    places = _columns_of(table, names)
    if places is not None and _is_of_three(table, places):
        raise _no_grid(table, places)
    return _without_axes(table)


def grid_of_coordinates(table: NDArray, names: Sequence[str] = ()) -> MapOfTable | None:
    """Heights of a table of coordinates (lines, columns) on a regular grid; None of another table.

    Raises InputError: several heights of one point, in a table of three columns.
    """
    places = _columns_of(table, names)
    return None if places is None else _on_grid(table, places)


def refuse_profile(table: NDArray) -> None:
    """Raise InputError if a table holds a profile: heights along a line, with their places or without."""
    lines, columns = table.shape
    if min(lines, columns) > 2 or max(lines, columns) < _SHORTEST_PROFILE:
        return
    along = table if lines >= columns else table.T
    place, z = along[:, 0], along[:, -1]
    if along.shape[1] == 2:
        steps = np.diff(place)
        is_place = bool((steps > 0).all() or (steps < 0).all())
        if not is_place and len(along) < _FEWEST_LINES:
            return
    kind = ("column", "columns") if lines >= columns else ("line", "lines")
    given = f"a single {kind[0]}" if along.shape[1] == 1 else f"two {kind[1]}, x and z"
    raise profile_error(z, given)


def profile_error(z: NDArray, given: str) -> InputError:
    """InputError about heights along a line, with what they are good for."""
    defined = z[np.isfinite(z)]
    described = ""
    if defined.size > 2:
        n = np.arange(defined.size)
        flat = defined - np.polynomial.Polynomial.fit(n, defined, 1)(n)
        ra, rq = np.abs(flat).mean(), flat.std()
        described = f"; Ra {ra:.3g}, Rq {rq:.3g} in its unit"
    expected = (
        "a map, n1 × n2 heights. What a profile says, Rq, its slope and the pitch of its grooves, makes a face: "
        "rms_height or rms_slope, hurst and roll_off of kind = 'self-affine', or pitch and depth of kind = 'turned', "
        "see the page 'From a drawing to a face'"
    )
    return InputError("file", f"a profile of {z.size} points ({given}{described})", expected)


def _columns_of(table: NDArray, names: Sequence[str]) -> tuple[int, int, int] | None:
    """Columns of x, y and z: by their names, or the first three behind an index; None where there are fewer."""
    named = tuple(
        next((n for n, name in enumerate(names) if name.startswith(letters)), -1)
        for letters in ("x", "y", ("z", "height", "höhe"))
    )
    if min(named) >= 0 and len(set(named)) == 3:
        return named[0], named[1], named[2]
    columns = table.shape[1]
    if columns >= 4 and np.array_equal(table[:, 0] - table[0, 0], np.arange(len(table))):
        return 1, 2, 3
    return (0, 1, 2) if columns >= 3 else None


def _is_of_three(table: NDArray, places: tuple[int, int, int]) -> bool:
    """Whether a table has no columns but x, y and z, and an index, and more lines than a matrix of three columns."""
    return table.shape[1] - min(places) == 3 and len(table) >= _FEWEST_LINES


def _on_grid(table: NDArray, places: tuple[int, int, int]) -> MapOfTable | None:
    """Heights of a table of coordinates that lie on a regular grid; None of any other table.

    Raises InputError: two heights of one point.
    """
    if len(table) < _FEWEST_OF_GRID:
        return None
    is_known = np.isfinite(table[:, places[:2]]).all(axis=1)
    if is_known.mean() > _WELL_FILLED:
        table = table[is_known]
    x, y, z = (table[:, place] for place in places)
    along_x, along_y = find_lattice(x), find_lattice(y)
    if along_x is None or along_y is None:
        return None
    shape = along_x.points, along_y.points
    place = along_x.index * shape[1] + along_y.index
    distinct = np.unique(place).size
    fraction = distinct / (shape[0] * shape[1])
    is_three = _is_of_three(table, places)
    if distinct < len(table) and not is_three:
        return None
    if min(shape) < 2 or not fraction > (_HARDLY_FILLED if is_three else _WELL_FILLED):
        return None
    heights = np.full(shape[0] * shape[1], np.nan)
    heights[place] = z
    again = (heights[place] != z) & ~(np.isnan(heights[place]) & np.isnan(z))
    if again.any():
        n = int(np.argmax(again))
        given = f"several heights at x = {x[n]:.6g}, y = {y[n]:.6g}"
        raise InputError("file", given, "a table x y z with one height for each point")
    missing = heights.size - distinct
    notes = [f"the table x y z is a grid of {shape[0]} × {shape[1]} points"]
    if missing:
        share = as_text(missing / heights.size, percent=True)
        verb = "is" if missing == 1 else "are"
        notes[0] += f"; {counted(missing, 'point')} of them, {share}, {verb} not in it: undefined"
    if min(places) == 0 and table.shape[1] > 3:
        notes.append(
            f"columns of the table behind x, y and z are not read: {table.shape[1]} in all"
        )
    return MapOfTable(heights.reshape(shape), (along_x.step, along_y.step), places, tuple(notes))


@dataclass(frozen=True, eq=False)
class Lattice:
    """Equidistant values: index of each, their number and step."""

    index: Indices
    points: int
    step: float


def find_lattice(values: NDArray) -> Lattice | None:
    """Index of values that lie on a regular lattice, some of whose points may be missing; None of others.

    The step is first that between most neighbours, then that of a straight line through all values over their index.
    """
    if not np.isfinite(values).all():
        return None
    places, inverse = np.unique(values, return_inverse=True)
    gaps = np.diff(places)
    if not gaps.size:
        return Lattice(np.zeros(values.shape, np.int64), 1, 0.0)
    # the same place is written with different digits
    gaps = gaps[gaps > 1e-3 * gaps.max()]
    small = gaps[gaps < 1.5 * np.quantile(gaps, 0.1)]
    step = float(small.mean())
    index = np.concatenate([[0], np.cumsum(np.rint(np.diff(places) / step))])
    start = float(places[0])
    for _ in range(2):
        if index[-1] < 1 or index[-1] > 100 * values.size:
            return None
        step, start = np.polynomial.polynomial.polyfit(index, places, 1)[::-1]
        if not step > 0:
            return None
        index = np.rint((places - start) / step)
    off = np.abs(places - start - index * step).max()
    if off > _OFF_GRID * step:
        return None
    index = (index - index[0]).astype(np.int64)
    return Lattice(index[inverse], int(index[-1]) + 1, float(step))


def _no_grid(table: NDArray, places: tuple[int, int, int]) -> InputError:
    """InputError about coordinates that lie on no regular grid."""
    x, y, z = (table[:, place] for place in places)
    for line, other in ((x, y), (y, x)):
        if np.unique(other).size == 1 and np.unique(line).size == len(table):
            return profile_error(z, "coordinates x y z along one line")
    counts = [np.unique(axis).size for axis in (x, y)]
    given = (
        f"a table of {len(table)} lines x y z, whose points lie on no regular grid "
        f"({counts[0]} different x, {counts[1]} different y)"
    )
    expected = (
        "a grid with equal steps along x and y: export it as a grid, or interpolate the points (Gwyddion; "
        "scipy.interpolate.griddata); a matrix of three columns needs '# Width: …' and '# Height: …' before it"
    )
    return InputError("file", given, expected)


def _without_axes(table: NDArray) -> MapOfTable:
    """A matrix without its first column, or its first line, where that holds places or counts and no heights."""
    notes = []
    if min(table.shape) >= _FEWEST_LINES:
        for name, axis in (("column", 1), ("line", 0)):
            first, second = (np.take(table, n, axis)[1:] for n in (0, 1))
            if _is_even(first) and not _is_even(second):
                table = np.delete(table, 0, axis)
                notes.append(f"the first {name} counts in even steps: it is an axis, not heights")
    return MapOfTable(table.T, notes=tuple(notes))


def _is_even(values: NDArray) -> bool:
    """Whether values rise or fall in equal steps."""
    steps = np.diff(values)
    return bool(steps[0] != 0 and np.allclose(steps, steps[0], rtol=1e-6, atol=0))
