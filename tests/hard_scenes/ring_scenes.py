"""Hard scenes of the flow over rings, on their own coordinates and on meshes."""

from functools import partial
from math import log, pi

import numpy as np
from hard_scene import HardScene
from judges import near
from skfem import MeshTri

from femseal.analytic import (
    eccentric_annulus_rate,
    elliptic_annulus_rate,
    spiral_annulus_rate,
)
from femseal.seal import AnnularSeal, MeshSeal

scene = partial(HardScene, "seal")


def _ring(n, *, shift=0.0, stretch=(1.0, 1.0)):
    """Triangles between circles of 1 and 1.5, the inner one moved along x, all of it stretched along x and y."""
    m = 8 * n
    s, turn = (
        a.ravel()
        for a in np.meshgrid(np.linspace(0, 1, n + 1), 2 * pi * np.arange(m) / m, indexing="ij")
    )
    r = 1 + 0.5 * s
    points = np.array(
        [stretch[0] * (r * np.cos(turn) + shift * (1 - s)), stretch[1] * r * np.sin(turn)]
    )
    node = np.arange((n + 1) * m).reshape(n + 1, m)
    a, b = node[:-1], node[1:]
    corners = np.stack([a, b, np.roll(b, -1, axis=1), np.roll(a, -1, axis=1)]).reshape(4, -1)
    mesh = MeshTri(points, np.hstack([corners[[0, 1, 2]], corners[[0, 2, 3]]]))
    facets = mesh.boundary_facets()
    at = s[mesh.facets[0, facets]]
    return MeshSeal(
        mesh.with_boundaries({"in": facets[at == 0], "out": facets[at == 1]}), "in", "out"
    )


def _spiral():
    seal = _ring(24)
    x, y = seal.mesh.p[:, seal.mesh.t].mean(axis=1)
    angle = np.arctan2(y, x) + 1.1
    t, m = np.array([np.cos(angle), np.sin(angle)]), np.array([-np.sin(angle), np.cos(angle)])
    return seal.flow(
        5 * np.einsum("an,bn->nab", t, t) + 0.4 * np.einsum("an,bn->nab", m, m)
    ).conductance


def _ellipses():
    seal = _ring(24, stretch=(6**0.25, 6**-0.25))
    return seal.flow(np.tile([3.0, 0.5], (seal.mesh.nelements, 1))).conductance


SCENES = (
    scene(
        "ring of hair and mile",
        "radii of 1 µm and 1 km, all in one row of links",
        near(2 * pi / log(1e9), 1e-9, "2πk/ln(r_o/r_i)"),
        lambda: AnnularSeal(1e-6, 1e3, (1, 7)).flow(1.0).conductance,
    ),
    scene(
        "ring off its centre",
        "an inner circle moved by 0.3 of its radius, meshed",
        near(eccentric_annulus_rate(1, 1, 1, 1, 1.5, 0.3), 0.003, "bipolar coordinates"),
        lambda: _ring(24, shift=0.3).flow(1.0).conductance,
    ),
    scene(
        "grooves along on a ring of ellipses",
        "permeabilities of 3 and 0.5 along x and y between similar ellipses, meshed",
        near(elliptic_annulus_rate(3, 0.5, 1, 1, 1, 1.5), 0.003, "stretched coordinates"),
        _ellipses,
    ),
    scene(
        "spiral grooves",
        "grooves at 63° to the radius, 5 along and 0.4 across, meshed",
        near(spiral_annulus_rate(5, 0.4, 1.1, 1, 1, 1, 1.5), 0.003, "k_rr"),
        _spiral,
    ),
)
