"""Forms of seats: the nominal profile z(x1) of a face across the seal, which is added to its measured roughness.

z is 0 at the highest place and falls from there; x1 counts from the middle of the breadth, towards the outlet. Contact
then finds its own band, and every row its pressure. The faces are half-spaces, so that slopes have to stay small.
Source: Johnson, Contact Mechanics, 1985, ch. 4 (line contact); Greenwood & Tripp, J. Appl. Mech. 34, 1967, 153 (rough).
"""

from collections.abc import Sequence
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from ..base import Array, InputError, as_text, reals, to_si, to_text
from ..base.validate import check_parameters, described, parameter
from .patches import Surface

#: Largest slope of a form: a half-space is for slopes well below 1.
MOST_SLOPE = 0.3


def _radius(meaning: str, example: str) -> Any:
    return parameter("m", f"a radius > 0, such as '{example}'", meaning, usual=(1e-6, 1e3))


class Seat:
    """Base of the forms: a frozen dataclass with `depth`."""

    kind: ClassVar[str]

    @property
    def load_factor(self) -> float:
        """Force across the faces over the load that is given."""
        return 1.0

    def __post_init__(self) -> None:
        check_parameters(self)

    def __str__(self) -> str:
        texts = [
            f"{f.name.replace('_', ' ')} {as_text(getattr(self, f.name), f.metadata['unit'])}"
            for f in fields(self)  # type: ignore[arg-type]
        ]
        return ", ".join([self.kind, *texts])

    def depth(self, x: Array, breadth: float) -> Array:
        """How deep the form lies at x1 from the middle of a breadth [m], up to a constant."""
        raise NotImplementedError

    @property
    def shortest_wave(self) -> float:
        """Inf: a form that no measured patch has a part of."""
        return np.inf

    def heights(self, points: Array, frame: Any) -> Array:
        """Heights (n,) of the form on a seal at points (n, 2) [m]; `frame` gives distances from the inlet.

        Raises InputError: a seal whose inlet and outlet are no lines of one value.
        """
        if frame.ends is None:
            raise InputError("seat", f"{self} on a mesh", "a strip or a ring")
        first, last = frame.ends
        breadth = abs(last - first)
        return -self.depth(np.abs(frame.across(points) - first) - breadth / 2, breadth)

    def on(self, face: Surface) -> Surface:
        """The face with the form added to its heights.

        Raises InputError: a form that is steeper than an elastic half-space allows.
        """
        return face.with_form(-self.rows_below(face.shape[0], face.spacing[0]))

    def rows_below(self, rows: int, spacing: float) -> Array:
        """How deep rows across the seat (rows,), a spacing apart, lie below the highest one [m].

        Raises InputError: a form that is steeper than an elastic half-space allows.
        """
        breadth = rows * spacing
        depth = self.depth(reals(np.arange(rows) + 0.5 - rows / 2) * spacing, breadth)
        check_form("seat", f"{self} on {to_text(breadth, 'm', 3)}", depth, (spacing,))
        return depth - depth.min()


def check_form(
    key: str, shown: str, heights: Array, spacing: Sequence[float], inside: Array | bool = True
) -> None:
    """Refuse a form that is known nowhere on a face, or steeper than an elastic half-space allows.

    heights : (n1,) or (n1, n2) [m] at points a spacing apart [m], NaN beyond the form. inside : whether points count.

    Raises InputError: such a form, `shown` as given for `key`.
    """
    known = np.where(inside, heights, np.nan)
    steps = (np.abs(np.diff(known, axis=axis)) / d for axis, d in enumerate(spacing))
    slope = max(float(np.nanmax(step, initial=0.0)) for step in steps)
    found = f"slopes up to {slope:.2g}"
    if (np.isnan(heights) & inside).any():
        slope, found = np.inf, "slopes up to vertical"
    if np.isnan(known).all():
        found = "no height that is known"
    if not slope <= MOST_SLOPE:
        expected = f"heights with slopes up to {MOST_SLOPE:g}: the faces are half-spaces"
        raise InputError(key, f"{shown} with {found}", expected)


@dataclass(frozen=True)
class FlatSeat(Seat):
    """A flat seat: roughness alone."""

    kind: ClassVar[str] = "flat"

    def depth(self, x: Array, breadth: float) -> Array:
        """0."""
        return np.zeros_like(x)


@dataclass(frozen=True)
class CrownedSeat(Seat):
    """A crowned seat of radius R, such as a lens ring: x²/2R.

    Parameters
    ----------
    radius : R [m], > 0, of both faces together: 1/R = 1/R₁ + 1/R₂.
    """

    kind: ClassVar[str] = "crowned"
    radius: float = _radius("of the crown or ball", "50 mm")

    def depth(self, x: Array, breadth: float) -> Array:
        """x²/2R."""
        return x**2 / (2 * self.radius)


@dataclass(frozen=True)
class BallOnCone(Seat):
    """A ball of radius R on a cone: along the generator of the cone R − √(R² − x²).

    Parameters
    ----------
    radius : R of the ball [m], > 0.
    angle : half the angle of the cone [rad]. Loads are axial: along the generator they press with 1/sin of it.
    """

    kind: ClassVar[str] = "ball-on-cone"
    radius: float = _radius("of the crown or ball", "10 mm")
    angle: float = parameter(
        "rad",
        "half the angle of the cone, such as '45 deg'",
        "half the angle of the cone; loads are then axial",
        usual=(1e-3, 1.6),
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        if not self.angle <= np.pi / 2:
            raise InputError(
                "angle",
                to_text(self.angle, "rad"),
                "half the angle of a cone, above 0° and at most 90°",
            )

    @property
    def load_factor(self) -> float:
        """1/sin of half the angle: loads are axial."""
        return float(1 / np.sin(self.angle))

    def depth(self, x: Array, breadth: float) -> Array:
        """R − √(R² − x²), NaN beyond the ball."""
        with np.errstate(invalid="ignore"):
            return self.radius - np.sqrt(self.radius**2 - x**2)


@dataclass(frozen=True)
class RoundedSeat(Seat):
    """A flat land with rounded edges: (|x| − b/2)²/2r beyond the land.

    Parameters
    ----------
    land : breadth b of the flat [m], > 0. edge_radius : r [m], > 0.
    """

    kind: ClassVar[str] = "rounded"
    land: float = parameter(
        "m", "a breadth > 0, such as '0.5 mm'", "breadth of the flat part", usual=(1e-7, 1.0)
    )
    edge_radius: float = _radius("of both edges", "2 mm")

    def depth(self, x: Array, breadth: float) -> Array:
        """(|x| − b/2)²/2r beyond the land, 0 on it."""
        return np.maximum(np.abs(x) - self.land / 2, 0.0) ** 2 / (2 * self.edge_radius)


@dataclass(frozen=True)
class TiltedSeat(Seat):
    """A flat seat that is tilted: x tan(tilt), highest at the inlet.

    Parameters
    ----------
    tilt : [rad], negative where the outlet is highest.
    """

    kind: ClassVar[str] = "tilted"
    tilt: float = parameter(
        "rad",
        "an angle, such as '0.02 deg'",
        "slope across the seal, highest at the inlet",
        usual=(-0.2, 0.2),
        above=-np.inf,
    )

    def depth(self, x: Array, breadth: float) -> Array:
        """x tan(tilt)."""
        return x * np.tan(self.tilt)


@dataclass(frozen=True)
class ProfileSeat(Seat):
    """A seat with a profile from a file of two columns, x1 and z, linear between its points.

    Parameters
    ----------
    path : of the file, whose first line names x1 and z; separated by commas or blanks. unit : of both, such as "um".
    """

    kind: ClassVar[str] = "profile"
    path: Path = described("file with the columns x1 and z", example="seat.csv")
    unit: str = described("of its lengths", example="um")

    def depth(self, x: Array, breadth: float) -> Array:
        """−z, both ends of the breadth being those of the file."""
        points = _profile(self.path, self.unit)
        along = points[:, 0] - 0.5 * (points[0, 0] + points[-1, 0])
        if not 2 * along[-1] >= breadth * (1 - 1e-6):
            given = f"a profile of {to_text(2 * float(along[-1]), 'm', 3)}"
            raise InputError("path", given, f"one as broad as the face, {to_text(breadth, 'm', 3)}")
        return -np.interp(x, along, points[:, 1])

    def __str__(self) -> str:
        return f"the profile {self.path.name}"


def _profile(path: Path, unit: str) -> Array:
    """Rising x1 and z (n, 2) [m] from a file; InputError of anything else."""
    expected = "a file of numbers in columns x1 and z, the first line with these names, x1 rising"
    try:
        first, *rows = path.read_text(encoding="utf-8-sig").replace(",", " ").splitlines()
        table = np.loadtxt([row for row in rows if row.strip()], usecols=(0, 1), ndmin=2)
    except (OSError, ValueError) as error:
        raise InputError("path", f"'{path.name}' ({error})", expected) from None
    rises = len(table) > 1 and np.isfinite(table).all() and (np.diff(table[:, 0]) > 0).all()
    if first.split()[:2] != ["x1", "z"] or not rises:
        raise InputError("path", f"'{path.name}'", expected)
    return table * to_si(f"1 {unit}", "m")


#: Seats that a case can choose, by their kind.
SEATS: dict[str, type[Seat]] = {
    seat.kind: seat
    for seat in (FlatSeat, CrownedSeat, BallOnCone, RoundedSeat, TiltedSeat, ProfileSeat)
}
