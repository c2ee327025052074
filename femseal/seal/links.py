"""Leakage through the link network of a structured seal, enclosed from both sides if asked.

Symbols: c conductance of a link = permeability × shape factor [m³], q its flow, φ potential of a node for a
unit drop. Source of the bounds: Dirichlet's and Thomson's principles for networks (Doyle & Snell, Random
Walks and Electric Networks, 1984).
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..base.errors import InputError
from ..flow.balance import balanced_flux
from ..flow.darcy import DarcyFlow
from ..flow.network import solve_network

Array = NDArray[np.float64]
_RTOL = 1e-8


def link_permeabilities(permeability: Any, cells: tuple[int, int]) -> tuple[Array, Array]:
    """k1 (n1, n2) and k2 (n1 − 1, n2) [m³] from a number, or a pair of numbers or arrays; or InputError."""
    n1, n2 = cells
    shapes = (n1, n2), (n1 - 1, n2)
    pair = permeability if isinstance(permeability, (tuple, list)) else None
    if pair is None and np.ndim(permeability) == 0:
        pair = (permeability, permeability)
    if pair is None or len(pair) != 2:
        given = f"{len(pair)} items" if pair is not None else f"one array of shape {np.shape(permeability)}"
        raise InputError.of(
            "permeability",
            given,
            f"a number, or the links (k1, k2), numbers or arrays {shapes[0]} and {shapes[1]}",
        )
    k1, k2 = (_checked(n, k, s) for n, k, s in zip(("k1", "k2"), pair, shapes, strict=True))
    return k1, k2


def _checked(name: str, value: ArrayLike, shape: tuple[int, int]) -> Array:
    try:
        k = np.asarray(value, dtype=float)
    except (TypeError, ValueError):
        raise InputError.of(f"permeability {name}", repr(value), "numbers [m³]") from None
    if k.shape not in ((), shape):
        raise InputError.of(f"permeability {name}", f"shape {k.shape}", f"a number or shape {shape}")
    if not np.all(np.isfinite(k)):
        raise InputError.of(
            f"permeability {name}",
            f"{np.count_nonzero(~np.isfinite(k))} values not finite",
            "numbers >= 0 [m³]",
        )
    if k.min(initial=0.0) < 0:
        raise InputError.of(f"permeability {name}", f"{k.min():g}", "numbers >= 0 [m³]")
    return np.broadcast_to(k, shape)


def network_flow(c1: Array, c2: Array, bounds: bool) -> DarcyFlow:
    """Flow through links of conductance c1 (n1, n2) along the leakage and c2 (n1 − 1, n2) across, periodic.

    With `bounds`, the upper bound is the energy of the computed potential and the lower one that of a flux
    that balances at every node; they enclose the flow of the network, and the value, whatever the error of
    the solver.

    Raises
    ------
    NotConverged : see `femseal.flow.solve_network`.
    """
    scale = max(float(c1.max()), float(c2.max(initial=0.0))) or 1.0
    c1, c2 = c1 / scale, c2 / scale
    flow = solve_network(c1, c2, rtol=_RTOL)
    lower = upper = np.nan
    if bounds:
        potential = np.nan_to_num(flow.potential)  # nothing flows in pockets
        dissipation = float(sum(part.sum() for part in link_dissipation(c1, c2, potential)))
        # an upper bound for any potential that is 1 and 0 at the ends
        upper = max(dissipation, flow.rate) if flow.percolates else 0.0
        lower = min(conservative_rate(c1, c2, potential), flow.rate) if flow.percolates else 0.0
    return DarcyFlow(
        conductance=flow.rate * scale,
        lower=lower * scale,
        upper=upper * scale,
        potential=flow.potential,
        percolates=flow.percolates,
        iterations=flow.iterations,
        residual=flow.residual,
        imbalance=flow.imbalance,
    )


def link_dissipation(c1: Array, c2: Array, potential: Array) -> tuple[Array, Array]:
    """c (Δφ)² of the links along both axes; `potential` (n1 + 1, n2) is NaN in pockets, in which nothing flows."""
    φ = np.nan_to_num(potential)
    across = np.roll(φ, -1, axis=1) - φ
    return c1 * np.diff(φ, axis=0) ** 2, c2 * across[1:-1] ** 2


def conservative_rate(c1: Array, c2: Array, potential: Array) -> float:
    """Q²/Σ(q²/c) of a balanced flux near −c Δφ: a lower bound for any `potential` (n1 + 1, n2)."""
    n1, n2 = c1.shape
    node = np.arange((n1 + 1) * n2).reshape(n1 + 1, n2)
    tail = np.concatenate([node[:-1].ravel(), node[1:-1].ravel()])
    head = np.concatenate([node[1:].ravel(), np.roll(node, -1, axis=1)[1:-1].ravel()])
    c = np.concatenate([c1.ravel(), c2.ravel()])
    phi = potential.ravel()
    q = c * (phi[tail] - phi[head])
    # both ends are node 0: what enters and leaves there need not balance
    rooted = np.zeros(node.size, np.int64)
    rooted[n2:-n2] = np.arange(1, (n1 - 1) * n2 + 1)
    q = balanced_flux(rooted[tail], rooted[head], c, q, (n1 - 1) * n2 + 1)
    total = min(abs(q[:n2].sum()), abs(q[(n1 - 1) * n2 : n1 * n2].sum()))
    energy = float(np.divide(q**2, c, out=np.zeros_like(q), where=c > 0).sum())
    return float(total**2 / energy) if energy > 0 else 0.0
