"""Compute the distance between yielding points and the edge of their contact patch."""

from __future__ import annotations

import numpy as np

from ..base import Flags, Pair
from .contact_fields import Contact
from .convolution import Boundary


def mean_edge_distance(
    in_contact: Flags, is_yielding: Flags, spacing: Pair, boundary: Boundary
) -> float:
    """Compute the mean distance of the points that yield from the edge of their contact patch.

    If all points of the patches yield, it is w/4 for strips of width w, and a/3 for circles of radius a. The ends of a
    free axis are edges. A periodic axis is cut open where it has the fewest points in contact. For patches that extend
    across this cut, the distance is overestimated.

    Parameters
    ----------
    in_contact, is_yielding : arrays of bool, (n1, n2)
        Whether each point is in contact, and whether it yields.
    spacing : pair of float, m
        Spacing of the points.
    boundary : pair of str
        Kind of boundary of each axis, see `HalfSpace`.

    Returns
    -------
    float, m
        Mean distance, 0 if no point yields; inf if all points are in contact and no axis is free.
    """
    if not is_yielding.any():
        return 0.0
    for axis, kind in enumerate(boundary):
        if kind == "periodic":
            # the line of the cut with the fewest points in contact then stands at both ends
            cut = int(in_contact.sum(axis=1 - axis).argmin())
            lines = np.arange(cut, cut + in_contact.shape[axis] + 1)
            in_contact = in_contact.take(lines, axis, mode="wrap")
            is_yielding = is_yielding.take(lines, axis, mode="wrap")
    border = [(1, 1) if kind == "free" else (0, 0) for kind in boundary]
    padded = np.pad(in_contact, border)
    if padded.all():
        return np.inf
    from scipy.ndimage import distance_transform_edt  # takes long to import

    distance = distance_transform_edt(padded, sampling=spacing)
    # the edge lies in the middle between a point in contact and its neighbour that is not
    half_point = min(spacing) / 2
    return float(distance[np.pad(is_yielding, border)].mean()) - half_point


def coating_edge_distance(contact: Contact) -> float:
    """Compute the `mean_edge_distance` of a contact between coated bodies; NaN without a coating.

    contact : solved contact.
    """
    half_space = contact.half_space
    if isinstance(half_space.modulus, float):
        return np.nan
    return mean_edge_distance(
        contact.pressure > 0, contact.plastic, half_space.spacing, half_space.boundary
    )
