"""Conjugate gradients with an incomplete Cholesky factorisation, for networks with a short way from inlet to outlet.

M = (D + L) D⁻¹ (D + U) has the links of the network A alone, not those that eliminating a node would add between its
neighbours; what these would carry is moved to the diagonals. If all of it is, A is M and the links left out besides,
and rᵀM⁻¹r bounds the error of the rate from above; with nine tenths of it the iteration is twice as fast. The
diagonals are sums without a subtraction, so that they keep their relative accuracy.

Node (i, j) lies at place (t, i), t = (i + j) modulo the columns: all links of a place with earlier ones come from the
place before, so that the sweeps go along t with all i at once, contiguous in memory. `along` (t, i) links places
(t − 1, i − 1) and (t, i), `across` (t, i) links (t − 1, i) and (t, i). Rows 0 and n + 1 are inlet and outlet. Links
from the last t to the first are left out too; with nine tenths they count as links with an end.
Sources: Gustafsson, BIT 18, 1978, 142 (modified factorisation); Meijerink & van der Vorst, Math. Comp. 31, 1977, 148.
"""

from __future__ import annotations

import numpy as np

from ...base import Array, NotConverged
from ...base.compiled import REORDERED, compiled, inner
from ..stencil import Stencil

#: Part of what the links left out would carry that is moved to no diagonal where M is not for the bound.
_LOST = 0.1
#: The iteration stops where rᵀM⁻¹r, about the error of the rate, is this fraction of what is allowed; if the bound is
#: more than that after all, at less.
_SHARE = 0.1
#: Iterations after which the number still needed is extrapolated.
_FORESEEN = 10


def solve_incomplete(stencil: Stencil, rtol: float, limit: int, start: Array | None = None) -> tuple[Array, int, float]:
    """Potential φ of the inner nodes for a unit drop, iterations, and a bound of its error in the norm of the energy.

    stencil : a network of five points, of more columns than rows; every coupled node must be connected to both ends.
    rtol : relative error of the rate Σ c (Δφ)² allowed; inlet and outlet flow differ by no more than 3 √rtol.
    limit : of iterations.
    start : potential of all nodes (n1 + 1, n2) to start from; unless given, that of the least energy among those that
        are constant along rows.

    Raises NotConverged: as soon as the extrapolated number of iterations exceeds `limit`.
    """
    n2 = stencil.along.shape[1]
    if start is None:
        drop = 1 / stencil.along.sum(axis=1)
        start = np.repeat((1 - np.cumsum(drop)[:-1] / drop.sum())[:, None], n2, axis=1)
    else:
        start = np.nan_to_num(start[1:-1], nan=0.5)
    φ, iterations, error, done = _solve(stencil.along, stencil.across, start, rtol, limit)
    if not done:
        raise NotConverged(
            f"flow: error {error:.1e} of the rate after {iterations} iterations with an incomplete factorisation, "
            f"wanted {rtol:.1e}; try the solver 'elimination'",
            error,
        )
    return φ, iterations, float(np.sqrt(error))


@inner(**REORDERED)
def _places(along, across, start):
    """`along`, `across` and the potential at places, see the module."""
    n1, n2 = along.shape
    a, c, x = np.zeros((n2, n1 + 1)), np.zeros((n2, n1 + 1)), np.zeros((n2, n1 + 1))
    for t in range(n2):
        x[t, 0] = 1.0
        for i in range(1, n1 + 1):
            j = t - i if t >= i else t - i + n2
            a[t, i] = along[i - 1, j]
            if i < n1:
                x[t, i] = start[i - 1, j]
                j = j - 1 if j > 0 else n2 - 1
                if j < across.shape[1]:
                    c[t, i] = across[i - 1, j]
    return a, c, x


@inner(**REORDERED)
def _factorised(a, c, lost):
    """D⁻¹, with a part of what the links left out would carry that is moved to no diagonal; 0 at nodes without links.

    A diagonal is the sum of the links with later nodes and of a rest: its links with the ends, and its share of the
    rests before.
    """
    n2, n = a.shape[0], a.shape[1] - 2
    inverse, rest = np.zeros(a.shape), np.zeros(a.shape)
    for t in range(n2):
        u = (t + 1) % n2
        for i in range(1, n + 1):
            later = c[u, i] + (a[u, i + 1] if i < n else 0.0)
            more = (a[t, 1] if i == 1 else 0.0) + (a[u, n + 1] if i == n else 0.0)
            if t == 0 and lost > 0.0:
                more += c[t, i] + (a[t, i] if i > 1 else 0.0)
            if u == 0 and lost == 0.0:
                later = 0.0
            if t > 0:
                more += c[t, i] * (rest[t - 1, i] + lost * (a[t, i + 1] if i < n else 0.0)) * inverse[t - 1, i]
                more += a[t, i] * (rest[t - 1, i - 1] + lost * c[t, i - 1]) * inverse[t - 1, i - 1]
            rest[t, i] = more
            if a[t, i] + c[t, i] + a[u, i + 1] + c[u, i] > 0.0:
                inverse[t, i] = 1.0 / (later + more)
    return inverse


@inner(**REORDERED)
def _residual(a, c, x, r):
    """Write the residual of x; its energy, and by how much inlet and outlet flow and the energy differ."""
    n2, n = a.shape[0], a.shape[1] - 2
    energy = inlet = outlet = 0.0
    for t in range(n2):
        u = (t + 1) % n2
        for i in range(1, n + 1):
            here = x[t, i]
            before, beside = x[t - 1, i - 1] - here, x[t - 1, i] - here
            r[t, i] = a[t, i] * before + c[t, i] * beside
            r[t, i] += a[u, i + 1] * (x[u, i + 1] - here) + c[u, i] * (x[u, i] - here)
            energy += a[t, i] * before**2 + c[t, i] * beside**2
        energy += a[t, n + 1] * x[t - 1, n] ** 2
        inlet += a[t, 1] * (1.0 - x[t, 1])
        outlet += a[t, n + 1] * x[t - 1, n]
    return energy, max(abs(inlet - outlet), abs(inlet - energy))


@inner(**REORDERED)
def _forward(a, c, inverse, r, z):
    """z = (D + L)⁻¹ r, and rᵀM⁻¹r."""
    n2, n = a.shape[0], a.shape[1] - 2
    product = 0.0
    for t in range(n2):
        for i in range(1, n + 1):
            flow = r[t, i]
            if t > 0:
                flow += a[t, i] * z[t - 1, i - 1] + c[t, i] * z[t - 1, i]
            z[t, i] = flow * inverse[t, i]
            product += flow * z[t, i]
    return product


@inner(**REORDERED)
def _backward(a, c, inverse, z):
    """z = (D + U)⁻¹ D z."""
    for t in range(a.shape[0] - 2, -1, -1):
        for i in range(1, a.shape[1] - 1):
            z[t, i] += inverse[t, i] * (a[t + 1, i + 1] * z[t + 1, i + 1] + c[t + 1, i] * z[t + 1, i])


@inner(**REORDERED)
def _turned(a, c, beta, z, p, flow):
    """p = z + β p and its flow A p; p·A p."""
    n2, n = a.shape[0], a.shape[1] - 2
    curvature = 0.0
    for t in range(n2):
        for i in range(1, n + 1):
            p[t, i] = z[t, i] + beta * p[t, i]
    for t in range(n2):
        u = (t + 1) % n2
        for i in range(1, n + 1):
            here = p[t, i]
            flow[t, i] = a[t, i] * (here - p[t - 1, i - 1]) + c[t, i] * (here - p[t - 1, i])
            flow[t, i] += a[u, i + 1] * (here - p[u, i + 1]) + c[u, i] * (here - p[u, i])
            curvature += flow[t, i] * here
    return curvature


@inner(**REORDERED)
def _advance(step, p, flow, x, r):
    """x += step p and r −= step A p."""
    for t in range(x.shape[0]):
        for i in range(1, x.shape[1] - 1):
            x[t, i] += step * p[t, i]
            r[t, i] -= step * flow[t, i]


@compiled(**REORDERED)
def _solve(along, across, start, rtol, limit):
    """Potential, iterations, bound of the error of the rate, and whether it is what was asked."""
    n1, n2 = along.shape
    a, c, x = _places(along, across, start)
    inverse, bounding, exact = _factorised(a, c, _LOST).astype(np.float32), _factorised(a, c, 0.0), np.zeros(a.shape)
    φ = np.empty(start.shape)
    if not bounding.sum() < np.inf:  # closed links leave nodes of M without a way to the ends
        return φ, 0, np.inf, False
    rate, _ = _residual(a, c, x, exact)
    # the iteration is in single precision but for the potential, of which the residual is found anew where it ends
    r = exact.astype(np.float32)
    z, p, flow = np.zeros_like(r), np.zeros_like(r), np.zeros_like(r)
    a_single, c_single = a.astype(np.float32), c.astype(np.float32)
    allowed, first, before, error, iteration, done = _SHARE * rtol, 0.0, 1.0, np.inf, 0, False
    while True:
        product = _forward(a_single, c_single, inverse, r, z)
        if product <= allowed * rate:
            rate, imbalance = _residual(a, c, x, exact)
            for t in range(n2):
                for i in range(1, n1):
                    r[t, i] = exact[t, i]
            error = _forward(a, c, bounding, exact, exact) / rate
            over = max(error / rtol, (imbalance / rate) ** 2 / (9.0 * rtol))
            done = over <= 1.0
            allowed *= min(0.5, 0.7 / over)
            if done or not allowed > 1e-15:
                break
            continue
        if iteration == 0:
            first = product
        hopeless = iteration == limit or not product < np.inf
        if not hopeless and iteration >= _FORESEEN:
            needed = np.log(first / (allowed * rate)) / np.log(first / product) * iteration
            hopeless = product >= first or needed > limit
        if hopeless:
            error = product / rate
            break
        _backward(a_single, c_single, inverse, z)
        curvature = _turned(a_single, c_single, np.float32(product / before), z, p, flow)
        _advance(np.float32(product / curvature), p, flow, x, r)
        rate -= product**2 / curvature
        before = product
        iteration += 1
    for t in range(n2):
        for i in range(1, n1):
            φ[i - 1, t - i if t >= i else t - i + n2] = x[t, i]
    return φ, iteration, error, done
