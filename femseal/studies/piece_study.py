"""The two-scale study: contact and flow of a whole face, and the pieces into which it is cut."""

from dataclasses import replace

import numpy as np

from ..base import Array, Mapper, Shape
from ..face.pieces import Cut
from .face_study import FaceResult, deterministic
from .piece_states import pieces_of_states
from .scene import Scene


def two_scale(scene: Scene, cells: Shape, *, mapper: Mapper = map) -> FaceResult:
    """Solve contact and flow of the whole face, and the permeability of each of the pieces into which it is cut.

    Parameters
    ----------
    scene : the face, its load and its fluid.
    cells : number of pieces along x1 and x2.
    mapper : computes a stage for many items, such as the builtin `map`; it may use several processes.

    Raises
    ------
    InputError : cells that do not suit the surface, or as `deterministic`.
    NotConverged : a contact failed. Flows that fail are NaN, and listed in `failures`.

    Examples
    --------
    >>> import femseal as fs
    >>> face = fs.self_affine((32, 64), (32e-6, 64e-6), hurst=0.8, rms_slope=0.2, roll_off=20e-6, rng=1)
    >>> scene = fs.Scene(face, 115e9, 3e9, fs.Liquid(1e-3), 1e6, 0.0, loading=(5e7, 2e8))
    >>> two_scale(scene, (2, 4)).pieces.mean_gap.shape  # of two load steps
    (2, 2, 4)
    """
    return cut_into_pieces(scene, Cut.of(scene.surface, cells), mapper)


def cut_into_pieces(scene: Scene, cut: Cut, mapper: Mapper) -> FaceResult:
    """The solution of a face, with the pieces of a cut."""
    face = deterministic(scene, mapper=mapper)
    pieces = pieces_of_states(scene, cut, face.states, face.leakage, _of_places(face), mapper)
    return replace(face, pieces=pieces, failures=(*face.failures, *pieces.failures))


def _of_places(face: FaceResult) -> Array | None:
    """Leakage of each measured place, and from three on of all but each (2 places, steps) [m²/s]; None of one."""
    if (places := face.places) is None:
        return None
    return (
        places.alone if places.without is None else np.concatenate([places.alone, places.without])
    )
