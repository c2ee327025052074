"""Two-sided bounds of the flow through a cell whose gap is constant on each pixel.

Lower: complementary energy of a conservative flux (lowest-order Raviart-Thomas, from the harmonic link network).
Upper: Dirichlet energy of a conforming pressure (Q1 on pixel corners). Source: Thomson's and Dirichlet's principles.
"""

from __future__ import annotations

from functools import lru_cache
from typing import Any

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray
from skfem import Basis, ElementQuad1, MeshQuad

from ..base.errors import NotConverged
from .balance import balanced_flux
from .connectivity import corners_reached
from .corners import corner_energy, corner_operator
from .forms import flow_along_x1, flow_along_x2
from .multigrid import COARSEST_NODES, coarsest_nodes, solve_multigrid
from .network import solve_network
from .solvers.amg import solve_direct

Array = NDArray[np.float64]
#: Error of the pressure behind the upper bound, which is above by its square; iterations before a factorisation.
_RTOL, _ITERATIONS = 1e-8, 60


def pixel_bounds(gap: Array, spacing: tuple[float, float], sides: str) -> tuple[float, float]:
    """Lower and upper bound of the flow for a unit drop along x1 [unit of h³]; both 0 where all is closed.

    Diagonal neighbours touch in the upper bound and not in the lower one.
    """
    k = gap**3 / 12
    lower, potential = _lower(k, spacing, sides == "periodic")
    return lower, _upper(k, spacing, sides == "periodic", potential)


def _lower(k: Array, spacing: tuple[float, float], periodic: bool) -> tuple[float, Array]:
    """The lower bound, and the potential of the pixels that it comes from."""
    d1, d2 = spacing
    neighbour = np.roll(k, -1, axis=1) if periodic else k[:, 1:]
    here = k if periodic else k[:, :-1]
    c1 = np.concatenate([2 * k[:1], _harmonic(k[:-1], k[1:]), 2 * k[-1:]]) * d2 / d1
    c2 = _harmonic(here, neighbour) * d1 / d2
    flow = solve_network(c1, c2)
    if not flow.percolates:
        return 0.0, flow.potential[1:-1]
    q1, q2 = _balanced_fluxes(c1, c2, np.nan_to_num(flow.potential), np.nan_to_num(flow.complement))
    if periodic:
        west = np.roll(q2, 1, axis=1)
        east = q2
    else:
        closed = np.zeros((k.shape[0], 1))
        west, east = np.hstack([closed, q2]), np.hstack([q2, closed])
    north, south = q1[:-1], q1[1:]
    with np.errstate(divide="ignore", invalid="ignore"):
        # ∫ |q|²/k over a pixel with a flux linear in each coordinate
        along = (north**2 + north * south + south**2) / 3 * d1 / d2
        across = (west**2 + west * east + east**2) / 3 * d2 / d1
        energy = np.where(k > 0, (along + across) / k, 0.0).sum()
    bound = min(abs(q1[0].sum()), abs(q1[-1].sum())) ** 2 / energy if energy > 0 else 0.0
    return float(bound), flow.potential[1:-1]


def _balanced_fluxes(c1: Array, c2: Array, p: Array, complement: Array) -> tuple[Array, Array]:
    """Fluxes near −c Δp that balance at every node, which differences of pressures at high contrast do not."""
    n1, n2 = c1.shape
    m2 = c2.shape[1]
    node = np.zeros(p.shape, np.int64)  # both ends are node 0
    node[1:-1] = 1 + np.arange((n1 - 1) * n2).reshape(n1 - 1, n2)
    q1 = c1 * _drop(p[:-1], p[1:], complement[:-1], complement[1:])
    inner, inner_complement = p[1:-1], complement[1:-1]
    next_p, next_complement = (np.roll(a, -1, axis=1)[:, :m2] for a in (inner, inner_complement))
    q2 = c2 * _drop(inner[:, :m2], next_p, inner_complement[:, :m2], next_complement)
    tail = np.concatenate([node[:-1].ravel(), node[1:-1, :m2].ravel()])
    head = np.concatenate([node[1:].ravel(), np.roll(node[1:-1], -1, axis=1)[:, :m2].ravel()])
    c, q = (np.concatenate([a.ravel(), b.ravel()]) for a, b in ((c1, c2), (q1, q2)))
    q = balanced_flux(tail, head, c, q, 1 + inner.size)
    return q[: n1 * n2].reshape(c1.shape), q[n1 * n2 :].reshape(c2.shape)


def _drop(p: Array, p_next: Array, complement: Array, complement_next: Array) -> Array:
    """p − p_next from whichever of p and 1 − p is smaller and so has the smaller rounding errors."""
    return np.where(p + p_next < 1, p - p_next, complement_next - complement)


def _harmonic(a: Array, b: Array) -> Array:
    total = a + b
    return np.divide(2 * a * b, total, out=np.zeros_like(total), where=total > 0)


def _upper(k: Array, spacing: tuple[float, float], periodic: bool, potential: Array) -> float:
    """Any pressure gives an upper bound: the better the pressure, the closer."""
    links = [w * k for w in _corner_links(spacing)]
    keep = corners_reached(k, periodic) == 3
    if not keep.any():
        return 0.0
    n1, columns = keep.shape[0] - 1, keep.shape[1]

    def energy(inner: Array) -> float:
        p = np.zeros(keep.shape)
        p[0] = keep[0]
        p[1:-1] = np.where(keep[1:-1], inner, 0.0)  # other corners are at rest
        return float(corner_energy(*links, p))

    if n1 == 1:
        return energy(np.zeros((0, columns)))
    if coarsest_nodes(n1 - 1, columns) <= COARSEST_NODES:
        operator, inlet, outlet = corner_operator(*links, keep, periodic)
        try:
            return energy(solve_multigrid(operator, periodic, inlet, outlet, _RTOL, _ITERATIONS)[0])
        except NotConverged:
            pass
    candidates = [_mean_at_corners(k, potential, periodic)[1:-1]]
    try:
        p = _corner_potential(k, spacing, periodic, keep)
        candidates += [p, np.clip(p, 0.0, 1.0)]
    except NotConverged:
        pass
    return min(energy(p) for p in candidates)


def _mean_at_corners(k: Array, potential: Array, periodic: bool) -> Array:
    """Mean of the potential of the pixels about each corner, weighted with their permeability."""
    sides: Any = "wrap" if periodic else "constant"
    weight, value = (np.pad(np.pad(a, ((1, 1), (0, 0))), ((0, 0), (1, 1)), mode=sides)
                     for a in (k, k * np.nan_to_num(potential)))  # fmt: skip
    weight, value = (a[:-1, :-1] + a[:-1, 1:] + a[1:, :-1] + a[1:, 1:] for a in (weight, value))
    mean = np.divide(value, weight, out=np.zeros_like(value), where=weight > 0)
    return mean[:, :-1] if periodic else mean


def _corner_potential(k: Array, spacing: tuple[float, float], periodic: bool, keep: NDArray[np.bool_]) -> Array:
    """Pressure at the inner corners by a sparse factorisation, whatever its residual; 0 where it is no number."""
    d1, d2 = spacing
    n1, n2 = k.shape
    local1, local2 = _pixel_matrices()
    columns = keep.shape[1]
    i, j = np.divmod(np.arange(n1 * n2), n2)
    corner = np.array([(i + a) * columns + (j + b) % columns for a in (0, 1) for b in (0, 1)])
    values = (local1 * d2 / d1 + local2 * d1 / d2)[:, :, None] * k.ravel()
    rows, cols = np.broadcast_arrays(corner[:, None], corner[None, :])
    full = sp.coo_array((values.ravel(), (rows.ravel(), cols.ravel())), shape=(keep.size, keep.size)).tocsr()
    unknown = keep.ravel().copy()
    unknown[:columns] = unknown[-columns:] = False
    p = np.zeros(keep.size)
    p[:columns] = keep[0]
    if unknown.any():
        i = np.flatnonzero(unknown)
        p[i] = solve_direct(full[i][:, i], -(full[i] @ p), direct_residual=np.inf).x
    return np.nan_to_num(p).reshape(keep.shape)[1:-1]


def _corner_links(spacing: tuple[float, float]) -> tuple[float, float, float]:
    """Q1 of a pixel as links between its corners, for k = 1: along x1, along x2, along each diagonal."""
    d1, d2 = spacing
    local1, local2 = _pixel_matrices()
    local = local1 * d2 / d1 + local2 * d1 / d2
    # corners (0, 0), (0, 1), (1, 0), (1, 1)
    return -local[0, 2], -local[0, 1], -local[0, 3]


@lru_cache(maxsize=1)
def _pixel_matrices() -> tuple[Array, Array]:
    """The two parts (4, 4) of the Q1 matrix of a unit square."""
    square = Basis(MeshQuad.init_tensor(np.arange(2.0), np.arange(2.0)), ElementQuad1(), intorder=3)
    ones = np.ones((1, square.X.shape[1]))
    # corners of the one element in the order of their coordinates
    order = np.lexsort(square.doflocs[::-1])
    local1, local2 = (form.assemble(square, c=ones).toarray()[np.ix_(order, order)]
                      for form in (flow_along_x1, flow_along_x2))  # fmt: skip
    return local1, local2
