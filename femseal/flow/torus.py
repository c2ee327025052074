"""Dissipation of a mean gradient in a network on a torus, by star-mesh elimination at any contrast.

A link from node a to node b has a conductance c and a drop e, that of the mean pressure across it, so that it
dissipates c (e + χ_b − χ_a)². Without a node i its neighbours j, k are linked by c_j c_k/Σc with the drop e_k − e_j.
Two links between the same nodes are one of the conductance c + c′ and the mean drop, beside which they dissipate
c c′/(c + c′) (e − e′)². The sum of these parts is all that is left at the end: no conductance is ever subtracted, and
the drops are whole numbers where no two ways around the torus meet.
Source of the elimination: Doyle & Snell, Random Walks and Electric Networks, 1984.
"""

from __future__ import annotations

import numpy as np

from ..base.arrays import Array
from ..base.compiled import compiled, inner
from .stencil import Stencil

#: Pairs of links at eliminated nodes, about a second's work for 1e8 of them.
_MOST_WORK = 4e8
_ROUNDING = 8 * float(np.finfo(float).eps)


def can_be_eliminated(shape: tuple[int, int]) -> bool:
    """Whether a torus of so many nodes is eliminated within some seconds."""
    return shape[0] * shape[1] * float(min(shape)) ** 2 <= _MOST_WORK


def torus_dissipation(stencil: Stencil) -> tuple[Array, Array]:
    """Dissipation (2, 2) of mean drops of 1 around each axis, and the rounding errors of its diagonal (2,).

    stencil : five points, a ring along both axes.
    """
    along, across = stencil.along, stencil.across
    turned = along.shape[1] > along.shape[0]
    if turned:
        along, across = np.ascontiguousarray(across.T), np.ascontiguousarray(along.T)
    energy, noise = _eliminated(along, across)
    return (energy[::-1, ::-1], noise[::-1]) if turned else (energy, noise)


@inner()
def _join(c, e, a, b, conductance, e1, e2, energy, noise):
    """Add a link from node a to node b of the front, and what it dissipates beside the one there is."""
    if a == b:
        _dissipate(energy, noise, conductance, e1, e2, 0.0)
        return
    there = c[a, b]
    total = there + conductance
    if there == 0.0:
        m1, m2 = e1, e2
    else:
        d1, d2 = e1 - e[a, b, 0], e2 - e[a, b, 1]
        whole = e1 == np.rint(e1) and e2 == np.rint(e2) and d1 == np.rint(d1) and d2 == np.rint(d2)
        size = 0.0 if whole else max(abs(e1), abs(e2), abs(e[a, b, 0]), abs(e[a, b, 1]))
        _dissipate(energy, noise, there * (conductance / total), d1, d2, size)
        # from the wider of the two, whose drop is then hardly changed
        if there > conductance:
            m1, m2 = e[a, b, 0] + conductance / total * d1, e[a, b, 1] + conductance / total * d2
        else:
            m1, m2 = e1 - there / total * d1, e2 - there / total * d2
    c[a, b] = c[b, a] = total
    e[a, b, 0], e[a, b, 1] = m1, m2
    e[b, a, 0], e[b, a, 1] = -m1, -m2


@inner()
def _dissipate(energy, noise, conductance, d1, d2, size):
    energy[0, 0] += conductance * d1 * d1
    energy[0, 1] += conductance * d1 * d2
    energy[1, 0] += conductance * d1 * d2
    energy[1, 1] += conductance * d2 * d2
    error = _ROUNDING * size
    noise[0] += conductance * error * (error + 2 * abs(d1))
    noise[1] += conductance * error * (error + 2 * abs(d2))


@inner()
def _eliminate(c, e, i, near, energy, noise):
    """Eliminate node i of the front."""
    k = 0
    total = 0.0
    for j in range(c.shape[0]):
        if c[i, j] > 0.0:
            near[k] = j
            k += 1
            total += c[i, j]
    for m in range(k):
        a = near[m]
        fraction = c[i, a] / total
        for n in range(m + 1, k):
            b = near[n]
            conductance = fraction * c[i, b]
            if conductance > 0.0:
                _join(c, e, a, b, conductance, e[i, b, 0] - e[i, a, 0], e[i, b, 1] - e[i, a, 1], energy, noise)
    for m in range(k):
        a = near[m]
        c[i, a] = c[a, i] = 0.0


@compiled()
def _eliminated(along, across):
    """Eliminate row after row; the front holds the first row, to which the last one is linked, and two more."""
    n1, n2 = along.shape
    c, e = np.zeros((3 * n2, 3 * n2)), np.zeros((3 * n2, 3 * n2, 2))
    energy, noise = np.zeros((2, 2)), np.zeros(2)
    near = np.empty(3 * n2, np.int64)
    for i in range(n1):
        here = 0 if i == 0 else n2
        for j in range(n2):
            if across[i, j] > 0.0:
                seam = 1.0 if j == n2 - 1 else 0.0
                _join(c, e, here + j, here + (j + 1) % n2, across[i, j], 0.0, seam, energy, noise)
        last = i == n1 - 1
        following = 0 if last else (n2 if i == 0 else 2 * n2)
        for j in range(n2):
            if along[i, j] > 0.0:
                seam = 1.0 if last else 0.0
                _join(c, e, here + j, following + j, along[i, j], seam, 0.0, energy, noise)
        if i == 0:
            continue
        for j in range(n2, 2 * n2):
            _eliminate(c, e, j, near, energy, noise)
        # the following row takes the place of this one
        for a in range(n2):
            for b in range(n2):
                c[n2 + a, n2 + b] = c[2 * n2 + a, 2 * n2 + b]
                e[n2 + a, n2 + b] = e[2 * n2 + a, 2 * n2 + b]
                c[n2 + a, b] = c[b, n2 + a] = c[2 * n2 + a, b]
                e[n2 + a, b], e[b, n2 + a] = e[2 * n2 + a, b], e[b, 2 * n2 + a]
        c[2 * n2 :] = 0.0
        c[:, 2 * n2 :] = 0.0
    for j in range(n2):
        _eliminate(c, e, j, near, energy, noise)
    return energy, noise
