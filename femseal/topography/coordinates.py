"""Read tables of numbers that are not a plain matrix of heights.

A table may contain coordinates x y z on a regular grid, a profile, or a matrix of heights with the coordinates of an
axis in its first line or column. A table x y z lists the points of a grid in any order; points of the grid that are not
in the table are undefined. Files contain rounded coordinates, so that the steps of a regular grid may differ by a few
per cent.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..base import Indices, InputError, Pair, as_text, counted

#: Largest distance of a coordinate from the grid, as a fraction of a step.
_OFF_GRID = 0.15
#: A table is treated as coordinates if its points fill this fraction of a grid, whatever the number of its columns.
_WELL_FILLED = 0.5
#: A table with three columns is treated as coordinates if its points fill this fraction of a grid.
_HARDLY_FILLED = 0.1
#: Smallest number of lines of a table with three columns that is not a narrow matrix.
_FEWEST_LINES = 9
#: Smallest number of points of a grid.
_FEWEST_OF_GRID = 4
#: Smallest number of points of a profile.
SHORTEST_PROFILE = 3


class Columns(NamedTuple):
    """Indices of the columns with x, y and z in a table."""

    x: int
    y: int
    z: int


#: Columns of a table that contains only x, y and z.
_FIRST_COLUMNS = Columns(0, 1, 2)


@dataclass(frozen=True, eq=False)
class MapOfTable:
    """Heights that were read from a table of numbers.

    Parameters
    ----------
    heights : array, (n1, n2)
        Heights, with x of the table along the first axis.
    steps : tuple of two float, optional
        Steps of the grid along x and y, in the unit of the coordinates. None for a matrix.
    columns : Columns
        Columns of x, y and z in the table.
    notes : tuple of str
        Notes on how the table was interpreted.
    """

    heights: NDArray
    steps: Pair | None = None
    columns: Columns = _FIRST_COLUMNS
    notes: tuple[str, ...] = ()


def map_of_table(table: NDArray, names: Sequence[str] = ()) -> MapOfTable:
    """Read the heights from a table of numbers: a matrix of heights, or a list of coordinates x, y and z.

    Parameters
    ----------
    table : array, (lines, columns)
        The numbers.
    names : sequence of str
        Names of the columns in lower case, "" for an unknown name.

    Raises
    ------
    InputError
        The table is a profile, or its coordinates are not on a regular grid.
    """
    refuse_profile(table)
    grid = grid_of_coordinates(table, names)
    if grid is not None:
        return grid
    columns = _find_columns(table, names)
    if columns is not None and _has_only_coordinates(table, columns):
        raise _irregular_error(table, columns)
    return _read_matrix(table)


def grid_of_coordinates(table: NDArray, names: Sequence[str] = ()) -> MapOfTable | None:
    """Read the heights from a table of coordinates on a regular grid; return None for any other table.

    Parameters
    ----------
    table : array, (lines, columns)
        The numbers.
    names : sequence of str
        Names of the columns in lower case, "" for an unknown name.

    Raises
    ------
    InputError
        A table of three columns has several heights at one point.
    """
    columns = _find_columns(table, names)
    return None if columns is None else _read_grid(table, columns)


def refuse_profile(table: NDArray) -> None:
    """Raise InputError if a table is a profile: heights along a single line, with or without positions."""
    lines, columns = table.shape
    if min(lines, columns) > 2 or max(lines, columns) < SHORTEST_PROFILE:
        return  # more than x and z, or too few points
    is_upright = lines >= columns
    profile = table if is_upright else table.T  # (points, 1 or 2)
    if profile.shape[1] == 2:
        steps = np.diff(profile[:, 0])
        is_monotonic = bool((steps > 0).all() or (steps < 0).all())
        if not is_monotonic and len(profile) < _FEWEST_LINES:
            return  # a narrow matrix of heights
        given = "two columns, x and z" if is_upright else "two lines, x and z"
    else:
        given = "a single column" if is_upright else "a single line"
    raise profile_error(profile[:, -1], given)


def profile_error(z: NDArray, given: str) -> InputError:
    """Make an InputError about a file that contains a profile; its message says how to use a profile.

    z : heights (points,), NaN where undefined.
    given : description of the content of the file, for the message.
    """
    defined = z[np.isfinite(z)]
    roughness = ""
    if defined.size > 2:
        n = np.arange(defined.size)
        line = np.polynomial.Polynomial.fit(n, defined, 1)
        deviation = defined - line(n)
        ra, rq = np.abs(deviation).mean(), deviation.std()
        roughness = f"; Ra {ra:.3g}, Rq {rq:.3g} in its unit"
    expected = (
        "a map, n1 × n2 heights. From a profile you can generate a face: with its Rq or slope as rms_height or "
        "rms_slope, hurst and roll_off of kind = 'self-affine', or with pitch and depth of its grooves as those of "
        "kind = 'turned'; see the page 'From a drawing to a face'"
    )
    return InputError("file", f"a profile of {z.size} points ({given}{roughness})", expected)


def _find_columns(table: NDArray, names: Sequence[str]) -> Columns | None:
    """Find the columns of x, y and z.

    The columns are recognised by their names. If the columns have no names, x, y and z are the first three columns, or
    columns 2 to 4 if column 1 is a running index. Returns None if the table has fewer than three columns.
    """
    named = Columns(
        _column_with_name(names, "x"),
        _column_with_name(names, "y"),
        _column_with_name(names, ("z", "height", "höhe")),
    )
    # an unknown column has the index −1
    if min(named) >= 0 and len(set(named)) == 3:
        return named
    columns = table.shape[1]
    if columns < 3:
        return None
    begins_with_index = np.array_equal(table[:, 0] - table[0, 0], np.arange(len(table)))
    if columns >= 4 and begins_with_index:
        return Columns(1, 2, 3)
    return Columns(0, 1, 2)


def _column_with_name(names: Sequence[str], beginnings: str | tuple[str, ...]) -> int:
    """Return the index of the first column whose name begins with one of the given words; -1 if there is none."""
    for n, name in enumerate(names):
        if name.startswith(beginnings):
            return n
    return -1


def _has_only_coordinates(table: NDArray, columns: Columns) -> bool:
    """Return whether a table has only the columns x, y, z and perhaps an index, and is too long to be a matrix."""
    # an index is the column before x, so that min(columns) is 1 with an index and 0 without
    return table.shape[1] - min(columns) == 3 and len(table) >= _FEWEST_LINES


def _read_grid(table: NDArray, columns: Columns) -> MapOfTable | None:
    """Read the heights from a table of coordinates on a regular grid; return None for any other table.

    Raises InputError if a point has two heights.
    """
    if len(table) < _FEWEST_OF_GRID:
        return None
    # a few lines without coordinates are left out
    has_coordinates = np.isfinite(table[:, columns[:2]]).all(axis=1)
    if has_coordinates.mean() > _WELL_FILLED:
        table = table[has_coordinates]
    x, y, z = table[:, columns.x], table[:, columns.y], table[:, columns.z]
    x_lattice, y_lattice = find_lattice(x), find_lattice(y)
    if x_lattice is None or y_lattice is None:
        return None
    n1, n2 = x_lattice.points, y_lattice.points
    # index in the grid, row by row, of the point in each line of the table
    flat_index = x_lattice.index * n2 + y_lattice.index
    filled_points = np.unique(flat_index).size
    # A table with further columns may also be a matrix of heights. Such a table counts as coordinates only if no point
    # occurs twice and the points fill a large part of the grid.
    has_only_coordinates = _has_only_coordinates(table, columns)
    if filled_points < len(table) and not has_only_coordinates:
        return None
    least_fraction = _HARDLY_FILLED if has_only_coordinates else _WELL_FILLED
    if min(n1, n2) < 2 or filled_points / (n1 * n2) <= least_fraction:
        return None
    heights = np.full(n1 * n2, np.nan)
    heights[flat_index] = z
    _check_unique_heights(x, y, z, heights[flat_index])
    return MapOfTable(
        heights.reshape(n1, n2),
        steps=(x_lattice.step, y_lattice.step),
        columns=columns,
        notes=_notes_on_grid(n1, n2, filled_points, table.shape[1], columns),
    )


def _check_unique_heights(x: NDArray, y: NDArray, z: NDArray, stored: NDArray) -> None:
    """Raise InputError if a point has several heights.

    x, y, z : columns of the table, (lines,).
    stored : height stored in the grid at the point given by each line of the table, (lines,). If several lines give a
        height for the same point, the grid contains the height in the last of these lines.
    """
    differs = (stored != z) & ~(np.isnan(stored) & np.isnan(z))
    if differs.any():
        n = int(np.argmax(differs))
        given = f"several heights at x = {x[n]:.6g}, y = {y[n]:.6g}"
        raise InputError("file", given, "a table x y z with one height for each point")


def _notes_on_grid(
    n1: int, n2: int, filled_points: int, table_columns: int, columns: Columns
) -> tuple[str, ...]:
    """Return notes on how a table of coordinates was interpreted."""
    note = f"the table x y z is a grid of {n1} × {n2} points"
    missing = n1 * n2 - filled_points
    if missing:
        fraction = as_text(missing / (n1 * n2), percent=True)
        verb = "is" if missing == 1 else "are"
        note += (
            f"; {counted(missing, 'point')} ({fraction}) {verb} missing in it and {verb} undefined"
        )
    notes = [note]
    if min(columns) == 0 and table_columns > 3:
        notes.append(f"columns of the table after x, y and z are not read: {table_columns} in all")
    return tuple(notes)


@dataclass(frozen=True, eq=False)
class Lattice:
    """Describe a lattice of equidistant points, and the position of each value on the lattice.

    Parameters
    ----------
    index : array of int, (values,)
        Index of the lattice point at which each value lies, counted from 0.
    points : int
        Number of points of the lattice, including points without a value.
    step : float
        Distance between neighbouring points of the lattice.
    """

    index: Indices
    points: int
    step: float


def find_lattice(values: NDArray) -> Lattice | None:
    """Find the lattice of equidistant points on which values lie; return None if there is no such lattice.

    Lattice points without a value are allowed. The step is first estimated from the smallest distances between values.
    Each value is then assigned a lattice index. The slope of a straight line fitted to the values as a function of
    their index is the improved step. Indexing and fitting are repeated once.

    values : array (values,), in any order.
    """
    if not np.isfinite(values).all():
        return None
    # different values in rising order, and the index in `positions` of each value
    positions, inverse = np.unique(values, return_inverse=True)
    distances = np.diff(positions)
    if not distances.size:
        return Lattice(np.zeros(values.shape, np.int64), 1, 0.0)
    step = _estimate_step(distances)
    index = np.concatenate([[0], np.cumsum(np.rint(distances / step))])
    for _ in range(2):
        if index[-1] < 1 or index[-1] > 100 * values.size:
            return None  # a single point, or a lattice that is almost empty
        start, step = np.polynomial.polynomial.polyfit(index, positions, 1)
        if not step > 0:
            return None
        index = np.rint((positions - start) / step)
    deviation = np.abs(positions - start - index * step).max()
    if deviation > _OFF_GRID * step:
        return None
    index = (index - index[0]).astype(np.int64)
    return Lattice(index[inverse], int(index[-1]) + 1, float(step))


def _estimate_step(distances: NDArray) -> float:
    """Estimate the step of a lattice as the mean of the smallest distances between values."""
    # the same position may be written with different digits, which gives tiny distances
    distances = distances[distances > 1e-3 * distances.max()]
    smallest = distances[distances < 1.5 * np.quantile(distances, 0.1)]
    return float(smallest.mean())


def _irregular_error(table: NDArray, columns: Columns) -> InputError:
    """Make an InputError about coordinates that are not on a regular grid."""
    x, y, z = table[:, columns.x], table[:, columns.y], table[:, columns.z]
    different_x, different_y = np.unique(x).size, np.unique(y).size
    # all points lie on a line if one coordinate is constant and the values of the other coordinate are all different
    is_line = {different_x, different_y} == {1, len(table)}
    if is_line:
        return profile_error(z, "coordinates x y z along one line")
    given = (
        f"a table of {len(table)} lines x y z, whose points lie on no regular grid "
        f"({different_x} different x, {different_y} different y)"
    )
    expected = (
        "a grid with equal steps along x and y: export it as a grid, or interpolate the points (Gwyddion; "
        "scipy.interpolate.griddata); a matrix of three columns needs '# Width: …' and '# Height: …' before it"
    )
    return InputError("file", given, expected)


def _read_matrix(table: NDArray) -> MapOfTable:
    """Read a matrix of heights; skip the first column or line if it contains the coordinates of an axis."""
    notes = []
    if min(table.shape) >= _FEWEST_LINES:
        for name, axis in (("column", 1), ("line", 0)):
            # the corner belongs to both axes and is not compared
            first = np.take(table, 0, axis)[1:]
            second = np.take(table, 1, axis)[1:]
            if _has_equal_steps(first) and not _has_equal_steps(second):
                table = np.delete(table, 0, axis)
                notes.append(f"the first {name} counts in even steps: it is an axis, not heights")
    return MapOfTable(table.T, notes=tuple(notes))


def _has_equal_steps(values: NDArray) -> bool:
    """Return whether values rise or fall in equal steps."""
    steps = np.diff(values)
    return bool(steps[0] != 0 and np.allclose(steps, steps[0], rtol=1e-6, atol=0))
