"""Describe the form deviation of a whole seal: heights from a flatness tester or another instrument, or ideal waves.

A form is a frozen dataclass with the properties and methods of the protocol `SealForm`. If both faces have a form
deviation, the heights of both forms are added.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property
from math import inf, pi
from os import PathLike
from pathlib import Path
from typing import Any, ClassVar, Protocol

import numpy as np
from numpy.typing import ArrayLike

from ..base import Array, InputError, Pair, shortened, to_si, to_text, validate
from ..base.text_columns import TEXT_SUFFIXES, columns_of, read_columns
from ..base.validate import check_parameters, described, parameter
from ..topography import Topography
from .frame import Frame
from .plane import middles, plane_points

#: Heights are extrapolated to points whose distance from the nearest measured point is at most the larger of two
#: lengths: this multiple of the typical distance between measured points, and this fraction of the longer side of the
#: seal.
_EXTRAPOLATION_POINTS, _EXTRAPOLATION_SEAL = 3.0, 0.2
#: Shortest wavelength that a measured form resolves, divided by the typical distance between the measured points.
#: Measured on 20 faces with forms of 4 × 4 and 8 × 8 heights: with a limit of 2 distances, stochastic seals leak 0.80
#: and 0.84 times as much as the surface; with 3 distances 1.0 and 0.96 times; with 4 distances 1.03 and 1.08 times as
#: much.
_RESOLVED_DISTANCES = 3.0
#: Largest number of points of a form. If a form has more points, the points are averaged over squares.
_MOST_POINTS = 4096


class SealForm(Protocol):
    """Define the properties and methods that a class needs to describe the form deviation of a whole seal."""

    @property
    def shortest_wave(self) -> float:
        """Shortest wavelength of the form [m]; inf if all wavelengths are longer than a measured patch."""
        ...

    def heights(self, points: Array, frame: Frame) -> Array:
        """Return the heights of the form deviation at points of a seal.

        Parameters
        ----------
        points : array, (n, 2)
            Points in the plane of the seal [m].
        frame : Frame
            Coordinates of the seal.

        Returns
        -------
        array, (n,)
            Heights [m], positive towards the other face, up to an additive constant.

        Raises
        ------
        InputError
            The form does not cover the points.
        """
        ...


@dataclass(frozen=True)
class WavyForm:
    """Describe waves around a seal, such as the lobes of a flange between its bolts.

    Parameters
    ----------
    height : float
        Height of the waves from crest to trough [m].
    lobes : int or None
        Number of waves around the seal.
    wavelength : float or None
        Wavelength [m], as an alternative to `lobes`. The wavelength is adjusted, so that a whole number of waves fits
        around the seal.

    Raises
    ------
    InputError
        Both or neither of `lobes` and `wavelength` are given, or a number is not > 0.
    """

    kind: ClassVar[str] = "waves"
    height: float = parameter(
        "m", "a height > 0", "3 um", "height from crest to trough", usual=(1e-9, 1e-3)
    )
    lobes: int | None = described("number of waves around the seal", example=2, default=None)
    wavelength: float | None = parameter(
        "m",
        "a length > 0",
        "40 mm",
        "wavelength, which is rounded so that a whole number of waves fits on the strip or ring",
        usual=(1e-5, 10.0),
        default=None,
        instead="lobes",
    )

    def __post_init__(self) -> None:
        check_parameters(self)
        if (self.lobes is None) == (self.wavelength is None):
            given = "neither lobes nor wavelength"
            if self.lobes is not None:
                given = "both lobes and wavelength"
            raise InputError("lobes", given, "exactly one of them")
        if self.lobes is not None:
            object.__setattr__(self, "lobes", validate.count("lobes", self.lobes))

    @property
    def shortest_wave(self) -> float:
        """Infinity, because waves around the seal are assumed to be longer than a measured patch."""
        return inf

    def heights(self, points: Array, frame: Frame) -> Array:
        """Return the height (n,) [m] of a cosine wave around the seal at each of the points (n, 2) [m]."""
        return 0.5 * self.height * np.cos(self._wave_count(frame) * frame.angle(points))

    def __str__(self) -> str:
        waves = f"{self.lobes} waves"
        if self.wavelength is not None:
            waves = f"waves of {to_text(self.wavelength, 'm')}"
        return f"{waves} {to_text(self.height, 'm')} high"

    def _wave_count(self, frame: Frame) -> int:
        """Return the number of waves around the seal; raise InputError if the wavelength is longer than the seal."""
        if self.wavelength is None:
            assert self.lobes is not None
            return self.lobes
        if frame.size is None and frame.ends is None:
            raise InputError("wavelength", to_text(self.wavelength, "m"), "lobes, on a mesh")
        length = frame.size[1] if frame.size else pi * sum(frame.ends or ())
        if self.wavelength > length:
            expected = f"at most the length, {to_text(length, 'm')}"
            raise InputError("wavelength", to_text(self.wavelength, "m"), expected)
        return round(length / self.wavelength)


@dataclass(frozen=True, eq=False)
class MeasuredForm:
    """A form deviation: heights that were measured over a whole seal.

    The method `from_points` creates a form from measured points, the method `from_map` from a map of heights. The
    least-squares plane is subtracted from the heights, because faces align with each other when they are clamped.

    Attributes
    ----------
    points : array, (n, 2)
        Measured points [m]: x and y in the plane of the seal, or x1 and x2 on a strip. If `polar`, radius [m] and
        angle [rad].
    values : array, (n,)
        Measured heights [m].
    polar : bool
        Whether the points are given by radius and angle.
    middle : tuple of two float or None
        Centre [m] of the map of heights that contains the points; None if the points are not from a map. On a ring or
        mesh, the map is centred on the seal. On a strip, the corner of the map is placed at the corner of the strip.
    """

    points: Array = field(repr=False)
    values: Array = field(repr=False)
    polar: bool = False
    middle: Pair | None = None

    @classmethod
    def from_points(
        cls, points: ArrayLike, heights: ArrayLike, *, polar: bool = False
    ) -> MeasuredForm:
        """Create a form from heights at measured points, which can be scattered, on a grid or on a line.

        Parameters
        ----------
        points : array, (n, 2)
            Coordinates [m], or radius [m] and angle [rad] if `polar`.
        heights : array, (n,)
            Heights [m], positive towards the other face.
        polar : bool
            Whether the points are given by radius and angle.

        Raises
        ------
        InputError
            There are fewer than three points, the numbers of heights and points differ, or a number is not finite.
        """
        checked_points = plane_points("form", points)
        z = np.array(heights, float)
        if z.shape != (len(checked_points),) or not np.isfinite(z).all():
            expected = f"as many finite heights as points [m], {len(checked_points)}"
            raise InputError("form", f"heights {shortened(z)}", expected)
        return cls(checked_points, z, polar)

    @classmethod
    def from_map(cls, surface: Topography) -> MeasuredForm:
        """Create a form from a map of heights, for example from an instrument with a larger field of view.

        Points whose height is undefined (NaN) are left out.
        """
        points = middles(surface.size, surface.shape)
        is_defined = np.isfinite(surface.heights).ravel()
        form = cls.from_points(points[is_defined], surface.heights.ravel()[is_defined])
        return replace(form, middle=(surface.size[0] / 2, surface.size[1] / 2))

    @property
    def shortest_wave(self) -> float:
        """Shortest wavelength that the measured points resolve [m], three times the typical distance between points."""
        return _RESOLVED_DISTANCES * self._typical_distance

    @cached_property
    def _typical_distance(self) -> float:
        """Median distance [m] of a point from its second nearest neighbour.

        For points on a line or on a grid, the distance from the second nearest neighbour is the spacing of the points.
        For scattered points, the distance from the nearest neighbour would be misleading, because measured points may
        almost coincide.
        """
        from scipy.spatial import cKDTree

        points, _ = self._averaged_points
        distances, _ = cKDTree(points).query(points, k=3)  # the nearest point is the point itself
        return float(np.median(distances[:, 2]))

    @cached_property
    def _averaged_points(self) -> tuple[Array, Array]:
        """Measured points (n, 2) [m] and their heights (n,) [m].

        If there are more than `_MOST_POINTS` points, each returned point is the mean of all points in a square.
        """
        points, values = self.points, self.values
        if self.polar:
            radius, angle = points.T
            points = np.stack([radius * np.cos(angle), radius * np.sin(angle)], axis=1)
        all_points = points
        # side of the squares, which is increased until at most `_MOST_POINTS` squares contain points
        side = (float(np.prod(np.ptp(points, axis=0))) / _MOST_POINTS) ** 0.5
        while len(points) > _MOST_POINTS:
            _, square = np.unique(np.floor(all_points / side), axis=0, return_inverse=True)
            square = square.ravel()
            count = np.bincount(square)
            x, y, values = (
                np.bincount(square, quantity) / count for quantity in (*all_points.T, self.values)
            )
            points = np.stack([x, y], axis=1)
            side *= 1.1
        return points, values

    def heights(self, points: Array, frame: Frame) -> Array:
        """Interpolate the measured heights at points of a seal by linear radial basis functions.

        The least-squares plane of the interpolated heights is subtracted. For parameters and errors, see
        `SealForm.heights`. An InputError is also raised for a strip whose measured points are in polar coordinates.
        """
        from scipy.interpolate import RBFInterpolator
        from scipy.spatial import cKDTree

        known, values = self._averaged_points
        if frame.size and self.polar:
            raise InputError("form", "radii and angles on a strip", "x and y")
        if not frame.size and (self.polar or self.middle is not None):
            known = known - (self.middle or (0.0, 0.0)) + frame.centre
        longer_side = float(np.ptp(points, axis=0).max())
        limit = max(
            _EXTRAPOLATION_POINTS * self._typical_distance, _EXTRAPOLATION_SEAL * longer_side
        )
        distances, _ = cKDTree(known).query(points)
        far = float(distances.max())
        if far > limit:
            given = f"points up to {to_text(far, 'm', 3)} from points of the seal"
            near = to_text(limit, "m", 3)
            expected = (
                f"points that cover the seal, within {near}: is the unit of the points right?"
            )
            raise InputError("form", given, expected)
        levelled = _subtract_plane(known, values)
        interpolate = RBFInterpolator(known, levelled, kernel="linear", degree=0)
        return _subtract_plane(points, interpolate(points))


@dataclass(frozen=True)
class FileForm:
    """Describe a form deviation whose heights over the seal are read from a file, see `read_form`.

    Parameters
    ----------
    path : Path
        File with the heights.
    unit : str or None
        Unit of the heights, such as "um". By default, the unit in the file is used.
    length_unit : str
        Unit of the coordinates x and y, or of the radius.
    """

    kind: ClassVar[str] = "file"
    path: Path = described(
        "text file with the columns x, y, z or r, theta, z, or a map of heights",
        example="flatness.csv",
    )
    unit: str | None = described(
        "unit of the heights; by default the unit in the file", example="um", default=None
    )
    length_unit: str = described("unit of x and y, or of r", default="mm")

    def __post_init__(self) -> None:
        for name in ("unit", "length_unit"):
            if getattr(self, name) is not None:
                to_si(f"1 {getattr(self, name)}", "m", name)

    def __str__(self) -> str:
        return f"the heights in {self.path.name}"

    @cached_property
    def measured(self) -> MeasuredForm:
        """The form deviation in the file, which is read at the first access and then kept in memory."""
        return read_form(self.path, unit=self.unit, length_unit=self.length_unit)

    @property
    def shortest_wave(self) -> float:
        """Shortest wavelength that the measured points in the file resolve [m]."""
        return self.measured.shortest_wave

    def heights(self, points: Array, frame: Frame) -> Array:
        """Interpolate the heights in the file, see `MeasuredForm.heights`."""
        return self.measured.heights(points, frame)


#: Column names of a text file with heights, in Cartesian and in polar coordinates.
_PLANE, _POLAR = ("x", "y", "z"), ("r", "theta", "z")


def read_form(
    path: str | PathLike[str], *, unit: str | None = None, length_unit: str = "mm"
) -> MeasuredForm:
    """Read heights over a whole seal from a file.

    Parameters
    ----------
    path : str or PathLike
        Either a .csv or .txt file with columns x, y and z, or r, theta [°] and z, whose first line contains these
        names; or a map of heights in any format that `read_topography` reads. On a strip, the map is placed with its
        corner at the corner of the strip; on a ring or mesh, it is centred on the seal.
    unit : str or None
        Unit of the heights; None for a map whose file contains the unit.
    length_unit : str
        Unit of the coordinates x and y, or of the radius.

    Raises
    ------
    InputError
        The file does not exist or cannot be read, or `unit` is missing for a text file with columns.
    """
    from ..topography import read_topography

    file = Path(path)
    names = columns_of(file) if file.suffix.lower() in TEXT_SUFFIXES else []
    if {*_PLANE} <= {*names}:
        wanted = _PLANE
    elif {*_POLAR} <= {*names}:
        wanted = _POLAR
    else:
        return MeasuredForm.from_map(read_topography(file, height_unit=unit))
    if unit is None:
        raise InputError("unit", "none", "the unit of the heights, such as 'um'")
    first, second, z = read_columns(file, wanted).T
    polar = wanted is _POLAR
    length = to_si(f"1 {length_unit}", "m", "length_unit")
    points = np.stack([length * first, np.radians(second) if polar else length * second], axis=1)
    return MeasuredForm.from_points(points, to_si(f"1 {unit}", "m", "unit") * z, polar=polar)


#: Forms that a case can choose, by their kind.
FORMS: dict[str, Any] = {form.kind: form for form in (FileForm, WavyForm)}


@dataclass(frozen=True)
class ScaledForm:
    """Describe a form deviation whose heights are a multiple of the heights of another form."""

    form: SealForm
    factor: float

    @property
    def shortest_wave(self) -> float:
        """Shortest wavelength of the form [m]."""
        return self.form.shortest_wave

    def heights(self, points: Array, frame: Frame) -> Array:
        """Return `factor` times the heights (n,) [m] of the form `form` at points (n, 2) [m] of a seal."""
        return self.factor * self.form.heights(points, frame)


def _subtract_plane(points: Array, values: Array) -> Array:
    """Subtract the least-squares plane from values (n,) at points (n, 2)."""
    plane = np.column_stack([np.ones(len(points)), points - points.mean(axis=0)])
    return values - plane @ np.linalg.lstsq(plane, values)[0]
