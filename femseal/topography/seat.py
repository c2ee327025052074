"""Describe the shapes of seats by the nominal profile z(x1) across the seal, which is added to the measured roughness.

The highest point has z = 0, and x1 is measured from the middle of the seal's width towards the outlet. Because the
profile is part of the surface, the contact problem also determines the width of the contact and the pressure in each
row of pixels. The slopes of the profile must be small, because the faces are treated as half-spaces.

Sources: Johnson, Contact Mechanics, 1985, ch. 4 (line contact); Greenwood & Tripp, J. Appl. Mech. 34, 1967, 153 (rough
surfaces).
"""

import warnings
from collections.abc import Sequence
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from ..base import Array, InputError, as_text, reals, to_si, to_text
from ..base.text_columns import read_columns
from ..base.validate import check_parameters, described, parameter
from .patches import Surface

#: Largest slope of a seat. The approximation by a half-space requires slopes well below 1.
MOST_SLOPE = 0.3


def _radius(meaning: str, example: str) -> Any:
    """Declare a parameter that is a radius."""
    return parameter("m", "a radius > 0", example, meaning, usual=(1e-6, 1e3))


class Seat:
    """Define the base class for the shapes of seats.

    A shape is a frozen dataclass with a method `depth`.
    """

    kind: ClassVar[str]

    @property
    def load_factor(self) -> float:
        """Ratio of the force normal to the faces to the load given by the user."""
        return 1.0

    def __post_init__(self) -> None:
        check_parameters(self)

    def __str__(self) -> str:
        texts = [self.kind]
        for f in fields(self):  # type: ignore[arg-type]
            value = as_text(getattr(self, f.name), f.metadata["unit"])
            texts.append(f"{f.name.replace('_', ' ')} {value}")
        return ", ".join(texts)

    def depth(self, x: Array, breadth: float) -> Array:
        """Return the depth of the seat at given positions, up to an additive constant.

        Parameters
        ----------
        x : array
            Positions x1, measured from the middle of the seal's width towards the outlet [m].
        breadth : float
            Width of the seal [m].

        Returns
        -------
        array
            Depth [m]; NaN at positions at which the shape of the seat is not defined.
        """
        raise NotImplementedError

    @property
    def shortest_wave(self) -> float:
        """Shortest wavelength [m] of the seat, infinite because all waves of a seat are longer than a patch."""
        return np.inf

    def heights(self, points: Array, frame: Any) -> Array:
        """Return the heights of the seat at points of a seal.

        Parameters
        ----------
        points : array, (points, 2)
            Positions in the plane of the seal [m].
        frame : object
            Coordinate system of the seal, which gives the distance of a point from the inlet.

        Returns
        -------
        array, (points,)
            Heights [m].

        Raises
        ------
        InputError
            The seal is not a strip or a ring.
        """
        if frame.ends is None:
            raise InputError("seat", f"{self} on a mesh", "a strip or a ring")
        inlet, outlet = frame.ends
        breadth = abs(outlet - inlet)
        # distance from the inlet, measured from the middle of the width
        x = np.abs(frame.across(points) - inlet) - breadth / 2
        return -self.depth(x, breadth)

    def add_to(self, face: Surface) -> Surface:
        """Return the surface with the profile of the seat added to its heights.

        Raises
        ------
        InputError
            The form is steeper than an elastic half-space allows.
        """
        return face.with_form(-self.row_depths(face.shape[0], face.spacing[0]))

    def on(self, face: Surface) -> Surface:
        """Offer `add_to` under its former name until the next version."""
        warnings.warn("Seat.on is Seat.add_to now", DeprecationWarning, stacklevel=2)
        return self.add_to(face)

    def row_depths(self, rows: int, spacing: float) -> Array:
        """Return how far each row of pixels of the seat lies below the highest row.

        Parameters
        ----------
        rows : int
            Number of rows of pixels across the seal.
        spacing : float
            Distance between neighbouring rows of pixels [m].

        Returns
        -------
        array, (rows,)
            Depth [m].

        Raises
        ------
        InputError
            The form is steeper than an elastic half-space allows.
        """
        breadth = rows * spacing
        x = reals(np.arange(rows) + 0.5 - rows / 2) * spacing
        depth = self.depth(x, breadth)
        check_form("seat", f"{self} on {to_text(breadth, 'm', 3)}", depth, (spacing,))
        return depth - depth.min()


def check_form(
    key: str, shown: str, heights: Array, spacing: Sequence[float], inside: Array | bool = True
) -> None:
    """Raise InputError if a nominal shape has unknown heights or is too steep for a half-space.

    Parameters
    ----------
    key : str
        Name of the input, for the message.
    shown : str
        Description of the shape, for the message.
    heights : array, (n1,) or (n1, n2)
        Heights of the shape [m]; NaN where the height is unknown.
    spacing : sequence of float
        Distance between neighbouring points along each axis [m].
    inside : array or bool
        Whether each point belongs to the seal. At points outside the seal, the height may be unknown.
    """
    known = np.where(inside, heights, np.nan)
    slope = 0.0
    for axis, distance in enumerate(spacing):
        steps = np.abs(np.diff(known, axis=axis)) / distance
        slope = max(slope, float(np.nanmax(steps, initial=0.0)))
    is_unknown = (np.isnan(heights) & inside).any()
    if is_unknown and np.isnan(known).all():
        fault = "no known height"
    elif is_unknown:
        # a shape with a vertical edge, such as a ball, has unknown heights beyond this edge
        fault = "slopes up to vertical"
    elif not slope <= MOST_SLOPE:
        fault = f"slopes up to {slope:.2g}"
    else:
        return
    expected = f"slopes of at most {MOST_SLOPE:g}, because the faces are treated as half-spaces"
    raise InputError(key, f"{shown} with {fault}", expected)


@dataclass(frozen=True)
class FlatSeat(Seat):
    """Describe a flat seat, which has roughness only."""

    kind: ClassVar[str] = "flat"

    def depth(self, x: Array, breadth: float) -> Array:
        """Return 0."""
        return np.zeros_like(x)


@dataclass(frozen=True)
class CrownedSeat(Seat):
    """Describe a crowned seat, such as a lens ring, with the depth x²/2R.

    Parameters
    ----------
    radius : float
        Combined radius of curvature R of both faces [m], > 0, with 1/R = 1/R₁ + 1/R₂.
    """

    kind: ClassVar[str] = "crowned"
    radius: float = _radius("radius of the crown or of the ball", "50 mm")

    def depth(self, x: Array, breadth: float) -> Array:
        """Return x²/2R."""
        return x**2 / (2 * self.radius)


@dataclass(frozen=True)
class BallOnCone(Seat):
    """Describe a ball on a cone, with the depth R − √(R² − x²) along the generator of the cone.

    Parameters
    ----------
    radius : float
        Radius R of the ball [m], > 0.
    angle : float
        Half the angle of the cone [rad]. Loads are axial; the force normal to the cone is the load divided by
        sin(angle).
    """

    kind: ClassVar[str] = "ball-on-cone"
    radius: float = _radius("radius of the crown or of the ball", "10 mm")
    angle: float = parameter(
        "rad",
        "half the angle of the cone",
        "45 deg",
        "half the angle of the cone; loads are then axial forces or pressures",
        usual=(1e-3, 1.6),
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        if not self.angle <= np.pi / 2:
            expected = "half the angle of a cone, above 0° and at most 90°"
            raise InputError("angle", to_text(self.angle, "rad"), expected)

    @property
    def load_factor(self) -> float:
        """Ratio of the force normal to the cone to the axial load, 1/sin(angle)."""
        return float(1 / np.sin(self.angle))

    def depth(self, x: Array, breadth: float) -> Array:
        """Return R − √(R² − x²), and NaN for |x| > R."""
        with np.errstate(invalid="ignore"):
            return self.radius - np.sqrt(self.radius**2 - x**2)


@dataclass(frozen=True)
class RoundedSeat(Seat):
    """Describe a flat land with rounded edges.

    Beyond the edges of the land, |x| > b/2, the depth is (|x| − b/2)²/2r.

    Parameters
    ----------
    land : float
        Width b of the flat part [m], > 0.
    edge_radius : float
        Radius r of both edges [m], > 0.
    """

    kind: ClassVar[str] = "rounded"
    land: float = parameter(
        "m", "a breadth > 0", "0.5 mm", "breadth of the flat part", usual=(1e-7, 1.0)
    )
    edge_radius: float = _radius("radius of both edges", "2 mm")

    def depth(self, x: Array, breadth: float) -> Array:
        """Return (|x| − b/2)²/2r for |x| > b/2, and 0 for |x| <= b/2."""
        return np.maximum(np.abs(x) - self.land / 2, 0.0) ** 2 / (2 * self.edge_radius)


@dataclass(frozen=True)
class TiltedSeat(Seat):
    """Describe a tilted flat seat, with the depth x tan(tilt).

    Parameters
    ----------
    tilt : float
        Angle [rad]. A seat with a positive angle is highest at the inlet; a seat with a negative angle is highest at
        the outlet.
    """

    kind: ClassVar[str] = "tilted"
    tilt: float = parameter(
        "rad",
        "an angle",
        "0.02 deg",
        "slope across the seal; the seat is highest at the inlet",
        usual=(-0.2, 0.2),
        above=-np.inf,
    )

    def depth(self, x: Array, breadth: float) -> Array:
        """Return x tan(tilt)."""
        return x * np.tan(self.tilt)


@dataclass(frozen=True)
class ProfileSeat(Seat):
    """Describe a seat whose profile is read from a file and interpolated linearly.

    Parameters
    ----------
    path : Path
        File with columns that are separated by commas, semicolons, tabs or blanks, and numbers with decimal points.
        The first line of the file contains the names of the columns, two of which are x1 and z.
    unit : str
        Unit of the lengths x1 and z in the file, such as "um".
    """

    kind: ClassVar[str] = "profile"
    path: Path = described("file with the columns x1 and z", example="seat.csv")
    unit: str = described("unit of the lengths in the file", example="um")

    def depth(self, x: Array, breadth: float) -> Array:
        """Return −z of the profile, centred on the middle of the seal's width."""
        points = _read_profile(self.path, self.unit)
        position, z = points.T
        length = float(position[-1] - position[0])
        if not length >= breadth * (1 - 1e-6):
            given = f"a profile of {to_text(length, 'm', 3)}"
            expected = f"a profile at least as long as the face is wide, {to_text(breadth, 'm', 3)}"
            raise InputError("path", given, expected)
        middle = 0.5 * (position[0] + position[-1])
        return -np.interp(x, position - middle, z)

    def __str__(self) -> str:
        return f"the profile {self.path.name}"


def _read_profile(path: Path, unit: str) -> Array:
    """Read a profile from a file.

    Returns
    -------
    array, (points, 2)
        Columns x1, in rising order, and z [m].

    Raises
    ------
    InputError
        The file cannot be read, a column is missing, an entry is not a number with a decimal point, or x1 does not
        increase from line to line.
    """
    table = read_columns(path, ("x1", "z"))
    is_finite = len(table) > 1 and np.isfinite(table).all()
    if not is_finite or not (np.diff(table[:, 0]) > 0).all():
        expected = "at least two lines of finite numbers x1 and z, x1 rising"
        raise InputError("path", f"'{path.name}'", expected)
    return table * to_si(f"1 {unit}", "m")


#: Seats that a case file can choose, by their kind.
SEATS: dict[str, type[Seat]] = {
    seat.kind: seat
    for seat in (FlatSeat, CrownedSeat, BallOnCone, RoundedSeat, TiltedSeat, ProfileSeat)
}
