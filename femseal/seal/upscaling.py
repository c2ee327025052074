"""Several windows taken together as one: real-space renormalisation of a square network of links.

Four windows become one by a bridge of five links, two in series beside two in series and one between them. The bridge
is its own dual, so that the median of many windows is kept for every distribution of ln k that is symmetric, and a
network of windows that are open at random conducts from a fraction of one half on, as links on a square lattice do.
Source: Reynolds, Stanley & Klein, J. Phys. C 10, 1977, L167 (percolation); King, Transp. Porous Media 4, 1989, 37.
"""

from __future__ import annotations

import numpy as np

from ..base.arrays import Array


def combined(k1: Array, k2: Array, window: tuple[float, float]) -> tuple[Array, Array]:
    """Permeability of blocks of windows along both of their axes.

    k1, k2 : permeability of the windows of each block (blocks, n1, n2) [m³], n1 and n2 powers of 2.
    window : sides of a window along both axes [m].

    Returns (blocks,) each, exactly 0 where no path is open.

    >>> k = np.full((1, 4, 2), 3.0)
    >>> [float(x[0]) for x in combined(k, k, (1.0, 1.0))]
    [3.0, 3.0]
    """
    ratio = window[1] / window[0]
    # conductances of windows; a block of 2 × 2 is as long for its width as one of them
    c1, c2 = k1 * ratio, k2 / ratio
    while c1.shape[1] > 1 and c1.shape[2] > 1:
        c1, c2 = _bridges(c1, c2[:, 0::2, 0::2]), _bridges(c2.swapaxes(1, 2), c1[:, 1::2, 1::2].swapaxes(1, 2))
        c2 = c2.swapaxes(1, 2)
    while c1.shape[1] > 1:  # twice as long: k of two in series along axis 1, and beside each other along axis 2
        c1, c2 = _in_series(c1[:, 0::2], c1[:, 1::2]), (c2[:, 0::2] + c2[:, 1::2]) / 2
    while c1.shape[2] > 1:
        c1, c2 = (c1[..., 0::2] + c1[..., 1::2]) / 2, _in_series(c2[..., 0::2], c2[..., 1::2])
    return c1[:, 0, 0] / ratio, c2[:, 0, 0] * ratio


def _bridges(along: Array, between: Array) -> Array:
    """Conductance along axis 1 of every 2 × 2 windows with a link between their columns."""
    a, b, c, d = along[:, 0::2, 0::2], along[:, 1::2, 0::2], along[:, 0::2, 1::2], along[:, 1::2, 1::2]
    e = between
    flow = a * b * (c + d) + c * d * (a + b) + e * (a + c) * (b + d)
    both = _quotient(flow, (a + b) * (c + d) + e * (a + b + c + d))
    # a column without any open link leaves the other one alone
    both = np.where(c + d + e == 0, _quotient(a * b, a + b), both)
    return np.where(a + b + e == 0, _quotient(c * d, c + d), both)


def _in_series(a: Array, b: Array) -> Array:
    """Harmonic mean, 0 where either is 0."""
    return _quotient(2 * a * b, a + b)


def _quotient(above: Array, below: Array) -> Array:
    return np.divide(above, below, out=np.zeros_like(above), where=below > 0)
