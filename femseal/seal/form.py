"""Form of a whole seal: its heights, such as a flatness tester or a coarser instrument measures them, or waves.

A form is a frozen dataclass with `heights`; forms of both faces add up.
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
from ..base.validate import check_parameters, described, parameter
from ..topography import Topography
from .plane import middles, plane_points
from .pressure_map import Frame
from .seal_files import TEXTS, columns_of, read_columns

#: How far from measured points their heights hold: in their usual distance, and in the larger side of the seal.
_BEYOND, _REACH = 3.0, 0.2
#: Shortest wave of a form in distances of its points: what means of squares and interpolation keep of it. Measured on
#: 20 faces with forms of 4 × 4 and 8 × 8 heights: with 2 drawn seals leak .80 and .84 of the whole, with 3 1.0 and .96,
#: with 4 1.03 and 1.08.
_SHORTEST = 3.0
#: Most points of a form; more are averaged over squares.
_MOST_POINTS = 4096


class SealForm(Protocol):
    """Interface of the forms."""

    @property
    def shortest_wave(self) -> float:
        """Length of the shortest wave that it holds [m]; inf of forms that no measured patch has a part of."""
        ...

    def heights(self, points: Array, frame: Frame) -> Array:
        """Heights (n,) at points (n, 2) of a seal, up to a constant, towards the other face [m].

        Raises InputError: the form does not cover the points.
        """
        ...


@dataclass(frozen=True)
class WavyForm:
    """Waves around a seal, such as the lobes of a flange between its bolts.

    Parameters
    ----------
    height : from crest to trough [m]. lobes : number of waves once around. wavelength : of them [m], where no number is
        given: as many as come nearest to it.

    Raises
    ------
    InputError : both lobes and wavelength, or neither; numbers that are not > 0.
    """

    kind: ClassVar[str] = "waves"
    height: float = parameter(
        "m", "a height > 0, such as '3 um'", "from crest to trough", usual=(1e-9, 1e-3)
    )
    lobes: int | None = described("waves once around", example=2, default=None)
    wavelength: float | None = parameter(
        "m",
        "a length > 0, such as '40 mm'",
        "on a strip or a ring, rounded to whole waves",
        usual=(1e-5, 10.0),
        default=None,
        instead="lobes",
    )

    def __post_init__(self) -> None:
        check_parameters(self)
        if (self.lobes is None) == (self.wavelength is None):
            given = "neither" if self.lobes is None else "both"
            raise InputError("lobes", f"{given} of lobes and wavelength", "one of them")
        if self.lobes is not None:
            object.__setattr__(self, "lobes", validate.count("lobes", self.lobes))

    @property
    def shortest_wave(self) -> float:
        """Inf: waves that are longer than a patch."""
        return inf

    def heights(self, points: Array, frame: Frame) -> Array:
        """Half of the height times the cosine."""
        return 0.5 * self.height * np.cos(self._count(frame) * frame.angle(points))

    def __str__(self) -> str:
        waves = f"{self.lobes} waves"
        if self.wavelength is not None:
            waves = f"waves of {to_text(self.wavelength, 'm')}"
        return f"{waves} {to_text(self.height, 'm')} high"

    def _count(self, frame: Frame) -> int:
        """Number of waves along a seal; InputError where it is none."""
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
    """Heights that were measured over a seal, less the plane through them, as clamped faces align; see `of`.

    points : x and y in the plane of the seal, x1 and x2 of a strip; or radius [m] and angle [rad] if `polar` (n, 2).
    values : heights (n,) [m]. middle : of a map, which lies at the centre of a seal around one; that of a
        strip begins at its corner.
    """

    points: Array = field(repr=False)
    values: Array = field(repr=False)
    polar: bool = False
    middle: Pair | None = None

    @classmethod
    def of(cls, points: ArrayLike, heights: ArrayLike, *, polar: bool = False) -> MeasuredForm:
        """Check and take heights that were measured anywhere, also along one line.

        points : (n, 2) [m], or radius [m] and angle [rad] if `polar`. heights : (n,) towards the other face [m].

        Raises InputError: numbers that are not finite, fewer than three, or not as many points as heights.
        """
        at, z = plane_points("form", points), np.array(heights, float)
        if z.shape != (len(at),) or not np.isfinite(z).all():
            expected = f"as many finite heights as points [m], {len(at)}"
            raise InputError("form", f"heights {shortened(z)}", expected)
        return cls(at, z, polar)

    @classmethod
    def of_map(cls, surface: Topography) -> MeasuredForm:
        """A map of heights (n1, n2), such as that of a coarser instrument, without its undefined points."""
        points = middles(surface.size, surface.shape)
        known = np.isfinite(surface.heights).ravel()
        found = cls.of(points[known], surface.heights.ravel()[known])
        return replace(found, middle=(surface.size[0] / 2, surface.size[1] / 2))

    @property
    def shortest_wave(self) -> float:
        """Three times the usual distance of its points."""
        return _SHORTEST * self._distance

    @cached_property
    def _distance(self) -> float:
        """Usual distance of neighbouring points, on a grid, along a line or scattered [m]."""
        from scipy.spatial import cKDTree

        points, _ = self._averaged
        return float(np.median(cKDTree(points).query(points, k=3)[0][:, 2]))

    @cached_property
    def _averaged(self) -> tuple[Array, Array]:
        """Points (n, 2) [m] in the plane and heights (n,), averaged over squares where there are too many."""
        points, values = self.points, self.values
        if self.polar:
            radius, angle = points.T
            points = np.stack([radius * np.cos(angle), radius * np.sin(angle)], axis=1)
        side = (float(np.prod(np.ptp(points, axis=0))) / _MOST_POINTS) ** 0.5
        every = points
        while len(points) > _MOST_POINTS:
            _, square = np.unique(np.floor(every / side), axis=0, return_inverse=True)
            square, count = square.ravel(), np.bincount(square.ravel())
            x, y, z = (np.bincount(square, of) / count for of in (*every.T, self.values))
            points, values = np.stack([x, y], axis=1), z
            side *= 1.1
        return points, values

    def heights(self, points: Array, frame: Frame) -> Array:
        """Interpolated by cones around all measured points (a radial basis), less the plane through the seal's points.

        Raises InputError: no point was measured near to one of the seal; radii on a strip.
        """
        from scipy.interpolate import RBFInterpolator
        from scipy.spatial import cKDTree

        known, values = self._averaged
        if frame.size and self.polar:
            raise InputError("form", "radii and angles on a strip", "x and y")
        if not frame.size and (self.polar or self.middle is not None):
            known = known - (self.middle or (0.0, 0.0)) + frame.centre
        limit = max(_BEYOND * self._distance, _REACH * float(np.ptp(points, axis=0).max()))
        far = float(cKDTree(known).query(points)[0].max())
        if far > limit:
            given = f"points up to {to_text(far, 'm', 3)} from places on the seal"
            near = to_text(limit, "m", 3)
            expected = f"points that cover it, within {near}: is their unit right?"
            raise InputError("form", given, expected)
        level = _less_plane(known, values)
        return _less_plane(points, RBFInterpolator(known, level, kernel="linear", degree=0)(points))


@dataclass(frozen=True)
class FileForm:
    """Heights over a seal from a file, see `read_form`.

    Parameters
    ----------
    path : of the file. unit : of its heights, such as "um"; that of the file unless given. length_unit : of x and y or
        of r.
    """

    kind: ClassVar[str] = "file"
    path: Path = described(
        "text with columns x, y, z or r, theta, z, or a map of heights", example="flatness.csv"
    )
    unit: str | None = described(
        "of the heights; that of the file unless given", example="um", default=None
    )
    length_unit: str = described("of x and y or of r", default="mm")

    def __post_init__(self) -> None:
        for name in ("unit", "length_unit"):
            if getattr(self, name) is not None:
                to_si(f"1 {getattr(self, name)}", "m", name)

    def __str__(self) -> str:
        return f"the heights in {self.path.name}"

    @cached_property
    def measured(self) -> MeasuredForm:
        """The heights of the file, which is read once."""
        return read_form(self.path, unit=self.unit, length_unit=self.length_unit)

    @property
    def shortest_wave(self) -> float:
        """Three times the usual distance of its points."""
        return self.measured.shortest_wave

    def heights(self, points: Array, frame: Frame) -> Array:
        """Those of `MeasuredForm`."""
        return self.measured.heights(points, frame)


#: Names of the columns of a text with heights: in the plane, and around a centre.
_PLANE, _POLAR = ("x", "y", "z"), ("r", "theta", "z")


def read_form(
    path: str | PathLike[str], *, unit: str | None = None, length_unit: str = "mm"
) -> MeasuredForm:
    """Heights over a seal.

    Parameters
    ----------
    path : a .csv or .txt with columns x, y and z, or r, theta [°] and z, under a line of these names; or a map of
        heights in any format that `read_topography` reads, which begins at the corner of a strip and lies with its
        middle at the centre of other seals.
    unit : of the heights; of a map that of the file unless given.
    length_unit : of x and y or r.

    Raises
    ------
    InputError : no such file, not readable, columns without a unit of their heights.
    """
    from ..topography import read_topography

    file = Path(path)
    names = columns_of(file) if file.suffix.lower() in TEXTS else []
    wanted = next((names_ for names_ in (_PLANE, _POLAR) if {*names_} <= {*names}), None)
    if wanted is None:
        return MeasuredForm.of_map(read_topography(file, height_unit=unit))
    if unit is None:
        raise InputError("unit", "none", "the unit of the heights, such as 'um'")
    first, second, z = read_columns(file, wanted).T
    polar = wanted is _POLAR
    length = to_si(f"1 {length_unit}", "m", "length_unit")
    points = np.stack([length * first, np.radians(second) if polar else length * second], axis=1)
    return MeasuredForm.of(points, to_si(f"1 {unit}", "m", "unit") * z, polar=polar)


#: Forms that a case can choose, by their kind.
FORMS: dict[str, Any] = {form.kind: form for form in (FileForm, WavyForm)}


@dataclass(frozen=True)
class ScaledForm:
    """A form that is so many times as high as another one."""

    form: SealForm
    factor: float

    @property
    def shortest_wave(self) -> float:
        """That of the form."""
        return self.form.shortest_wave

    def heights(self, points: Array, frame: Frame) -> Array:
        """The factor times the heights of the form."""
        return self.factor * self.form.heights(points, frame)


def _less_plane(points: Array, values: Array) -> Array:
    """Values (n,) at points (n, 2) less the plane through them."""
    plane = np.column_stack([np.ones(len(points)), points - points.mean(axis=0)])
    return values - plane @ np.linalg.lstsq(plane, values)[0]
