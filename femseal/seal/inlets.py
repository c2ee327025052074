"""Inlets of a seal that have pressures of their own: which boundaries are held at which pressure."""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from skfem import Mesh

from ..base.errors import InputError

Array = NDArray[np.float64]
Indices = NDArray[np.int64]
#: Names of inlets, one or several at one pressure, or pressures [Pa] of inlets by their names.
Inlet = str | Sequence[str] | Mapping[str, float]


@dataclass(frozen=True, eq=False)
class HeldBoundaries:
    """Named boundaries of a seal, inlets first.

    facets : boundary facets of each, which do not touch those of another.
    pressures : of the inlets [Pa]; the outlets have one in common, that of the outlet.
    """

    names: tuple[str, ...]
    facets: tuple[Indices, ...]
    pressures: tuple[float, ...]

    @classmethod
    def of(cls, mesh: Mesh, inlet: Mapping[str, float], outlet: Sequence[str]) -> HeldBoundaries:
        """Boundaries of a mesh.

        Raises
        ------
        InputError : one is both inlet and outlet, or two of them touch.
        """
        if both := [name for name in outlet if name in inlet]:
            raise InputError("outlet", f"{both[0]!r}, which is an inlet too", "other boundaries than the inlets")
        names = (*inlet, *dict.fromkeys(outlet))
        facets = tuple(np.unique(mesh.boundaries[name]).astype(np.int64) for name in names)
        for (first, one), (second, other) in itertools.combinations(zip(names, facets, strict=True), 2):
            if np.intersect1d(mesh.facets[:, one], mesh.facets[:, other]).size:
                given = f"boundaries {first!r} and {second!r} that touch, with pressures of inlets"
                raise InputError("inlet and outlet", given, "boundaries with no vertex in common")
        return cls(names, facets, tuple(inlet.values()))


def checked_pressures(inlet: Mapping[str, Any]) -> dict[str, float]:
    """Pressures of inlets by their names; InputError where one is not a number, or without any."""
    if not inlet:
        raise InputError("inlet", "no boundaries", "names of boundaries with their pressures")
    found = {}
    for name, value in inlet.items():
        try:
            found[name] = float(value)
        except (TypeError, ValueError):
            found[name] = np.nan
        if not np.isfinite(found[name]):
            raise InputError(f"inlet {name!r}", repr(value), "a finite pressure [Pa]")
    return found
