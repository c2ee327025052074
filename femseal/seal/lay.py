"""Describe the direction of the lay on a seal.

On the measured surface, the machining marks are parallel to the axis x2. The lay of a seal is the direction of the
machining marks on the seal.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ..base import Array, InputError, Pair, counted, to_text

#: Largest distance of a point of the seal from the nearest node of a vector field, divided by the spacing of the nodes.
_LARGEST_DISTANCE = 2.0


@dataclass(frozen=True)
class Lay:
    """Describe the lay of a seal: the direction of the machining marks on the seal.

    The lay is given in one of four ways: by a name, by an angle, as a spiral, or as a vector field. Opposite directions
    are the same lay.

    Attributes
    ----------
    name : str
        "x1", "x2", "radial", "circumferential" or "spiral".
    angle : float or None
        Angle from x1 towards x2 [rad].
    lead : float
        Lead of a spiral [m]: the distance by which a groove advances across the seal in one turn. The lead is the
        distance between neighbouring grooves times the number of starts.
    circumference : float or None
        Circumference of the ring [m], for a strip that stands for a part of a ring with spiral grooves. By default, the
        length of the strip is used as the circumference.
    file : Path or None
        File with a vector field along the lay.
    array : str
        Name of the vector field in the file.
    """

    name: str = ""
    angle: float | None = None
    lead: float = 0.0
    circumference: float | None = None
    file: Path | None = None
    array: str = ""

    def directions(self, points: Array, centre: Pair = (0.0, 0.0), unit: float = 1.0) -> Array:
        """Return unit vectors along the lay at points of the seal.

        Parameters
        ----------
        points : array, (n, 2)
            Points in the plane of the seal [m].
        centre : tuple of two float
            Centre of a radial, circumferential or spiral lay [m].
        unit : float
            Unit of the coordinates in the file of a vector field, as a length [m].

        Returns
        -------
        array, (n, 2)
            Unit vectors along the lay.

        Raises
        ------
        InputError
            A point lies at the centre of a radial, circumferential or spiral lay. The error is also raised if the
            vector field cannot be read from its file, or does not cover the points.
        """
        if self.file is not None:
            return _directions_from_field(self.file, self.array, points, unit)
        if self.name in ("radial", "circumferential", "spiral"):
            from_centre = points - np.asarray(centre)
            distance = np.hypot(from_centre[:, 0], from_centre[:, 1])
            if not distance.min(initial=1.0) > 0:
                raise InputError(
                    "lay", f"'{self.name}' at its centre", "a centre outside of all elements"
                )
            radial = from_centre / distance[:, None]
            if self.name == "radial":
                return radial
            circumferential = np.stack([-radial[:, 1], radial[:, 0]], axis=1)
            # tan α of a spiral groove; 0 for a circumferential lay, whose lead is 0
            tangent = (self.lead / (2 * np.pi * distance))[:, None]
            return (circumferential + tangent * radial) / np.sqrt(1 + tangent**2)
        if self.name == "x1":
            angle = 0.0
        elif self.name == "x2":
            angle = np.pi / 2
        else:
            angle = self.angle or 0.0
        return np.tile([np.cos(angle), np.sin(angle)], (len(points), 1))

    def check_lead(self, breadth: float) -> None:
        """Raise InputError if a spiral groove crosses a seal of the width `breadth` [m] in one turn or less."""
        if self.lead >= breadth * (1 - 1e-9):
            given = f"{to_text(self.lead, 'm')} on a seal {to_text(breadth, 'm', 3)} wide"
            expected = "less than the width: a groove would cross the seal within a turn"
            raise InputError("lay.lead", given, expected)

    def __str__(self) -> str:
        if self.file is not None:
            return f"along the field {self.array} of {self.file.name}"
        if self.name == "spiral":
            return f"in a spiral of lead {to_text(self.lead, 'm')}"
        return f"at {np.degrees(self.angle):.3g}° from x1" if self.angle is not None else self.name


def _directions_from_field(file: Path, array: str, points: Array, unit: float) -> Array:
    """Return the unit vectors (n, 2) of a vector field at the nodes that are nearest to points (n, 2) [m].

    Raises InputError if the array contains no vectors, or if a point is too far from all nodes.
    """
    from scipy.spatial import cKDTree

    from .mesh_files import read_field

    nodes, vectors = read_field(file, array)
    nodes = nodes * unit
    are_vectors = vectors.ndim == 2 and vectors.shape[1] in (2, 3)
    lengths = np.linalg.norm(vectors[:, :2], axis=1) if are_vectors else np.zeros(1)
    if not (np.isfinite(vectors).all() and lengths.min() > 0):
        expected = "vectors along the lay, finite and not 0"
        raise InputError("lay.field", f"'{array}' of '{file}'", expected)
    tree = cKDTree(nodes)
    spacing = np.inf
    if len(nodes) > 1:
        # the nearest node of a node is the node itself, so that the second nearest is its neighbour
        distances, _ = tree.query(nodes, k=2)
        spacing = distances[:, 1].max()
    distance, nearest = tree.query(points)
    uncovered = int(np.count_nonzero(distance > _LARGEST_DISTANCE * spacing))
    if uncovered > 0:
        raise InputError(
            "lay.field",
            f"'{file}', which does not cover {counted(uncovered, 'element')}",
            "a field that covers the seal",
        )
    return vectors[nearest, :2] / lengths[nearest, None]
