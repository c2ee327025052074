"""Networks of links for tests: the flow through given conductances, and the conductances of a cell."""

from dataclasses import replace

import numpy as np
from skfem import MeshQuad

from femseal.flow import Stencil, solve_flow
from femseal.flow.cell import cell_stencil
from femseal.flow.law import cubic_law
from femseal.flow.mesh import darcy_conductance


def network(c1, c2):
    """Stencil of links c1 (n1, n2) and c2 with n2 columns in a ring, n2 − 1 otherwise."""
    return Stencil.network(c1, c2, ring=np.shape(c2)[-1:] == np.shape(c1)[-1:])


def restricted(stencil, keep):
    """The same without the links of nodes (n1 + 1, n2) that are not kept."""
    beside = np.roll(keep, -1, axis=1)[1:-1, : stencil.across.shape[1]]
    across = np.where(keep[1:-1, : stencil.across.shape[1]] & beside, stencil.across, 0.0)
    return replace(stencil, along=np.where(keep[:-1] & keep[1:], stencil.along, 0.0), across=across)


def solve_links(c1, c2, **options):
    """Flow through the network of these links."""
    return solve_flow(network(c1, c2), **options)


def cell_links(gap, spacing, sides):
    """Conductances of the links between the pixels of a cell."""
    stencil = cell_stencil(gap, spacing, sides)
    return stencil.along, stencil.across


def mesh_of_pixels(gap, spacing):
    """Permeability along x1 with its bounds [m³], by scikit-fem's elements on a mesh of the pixels of a cell."""
    (n1, n2), (d1, d2) = gap.shape, spacing
    mesh = MeshQuad.init_tensor(np.arange(n1 + 1) * d1, np.arange(n2 + 1) * d2)
    i, j = (mesh.p[:, mesh.t].mean(axis=1) / np.reshape(spacing, (2, 1))).astype(int)
    middle = mesh.p[0, mesh.facets].mean(axis=0)
    ends = [np.flatnonzero(np.abs(middle - x) < 1e-6 * d1) for x in (0.0, n1 * d1)]
    shape = n1 * d1 / (n2 * d2)
    flow = darcy_conductance(mesh, cubic_law(gap[i, j]), *ends, bounds=True)
    return replace(
        flow,
        conductance=shape * flow.conductance,
        lower=shape * flow.lower,
        upper=shape * flow.upper,
    )


def open_paths(h, periodic):
    """Four-connected growth from the first row, by plain numpy."""
    reached = np.zeros_like(h, bool)
    reached[0] = h[0] > 0
    for _ in range(h.size):
        sides = np.pad(reached, ((0, 0), (1, 1)), mode="wrap" if periodic else "constant")
        ends = np.pad(reached, ((1, 1), (0, 0)))
        reached |= (h > 0) & (sides[:, 2:] | sides[:, :-2] | ends[2:] | ends[:-2])
    return reached[-1].any()
