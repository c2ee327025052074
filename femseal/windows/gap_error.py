"""Error of a stitched contact: its pressure is given to the half-space of the whole face, and the gaps are compared."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import scipy
from numpy.typing import NDArray

from ..base.arrays import Array
from ..contact import ContactLaw, HalfSpace


def gap_error(
    gap: NDArray[np.floating],
    pressure: NDArray[np.floating],
    peak_pressure: NDArray[np.floating] | None = None,
    **body: Any,
) -> float:
    """Rms difference between a gap and the gap that its pressure leaves on the whole half-space, over the rms gap [-].

    It is 0 for a solution of the contact, and costs one product with the half-space where that costs ten to a hundred.
    The approach of the body is the δ at which the projection of p − c (v − δ) on the law carries the load of p, with
    v = Kp + h₁ and c = πE*/(4Δ). Measured on gaps stitched from windows, it is 1.0 to 2 times their error against
    deterministic gaps.

    Arguments are those of `corrected_gap`. NaN where gap or pressure are not known everywhere.
    """
    corrected = corrected_gap(gap, pressure, peak_pressure, **body)
    return float("nan") if corrected is None else relative_difference(gap, corrected)


def relative_difference(gap: NDArray[np.floating], corrected: Array) -> float:
    """Rms difference of two gaps over the rms of the first; 0 for a gap of zeros."""
    scale = float(np.sqrt(np.mean(np.square(gap, dtype=float))))
    return float(np.sqrt(np.mean((corrected - gap) ** 2))) / scale if scale > 0 else 0.0


def corrected_gap(
    gap: NDArray[np.floating],
    pressure: NDArray[np.floating],
    peak_pressure: NDArray[np.floating] | None = None,
    *,
    undeformed: Array,
    half_space: HalfSpace,
    law: ContactLaw,
) -> Array | None:
    """The gap (n1, n2) [m] that the pressure of a stitched contact leaves on the whole half-space, see `gap_error`.

    Measured on seven faces, the flow through it was within 0.1 % of that through the deterministic gap on six of them,
    where the flow through the stitched gap was off by factors up to 1.9; on the seventh it was off by 1.5 at most.
    None where gap or pressure are not known everywhere, or where no approach carries the load.

    gap, pressure : deformed gap [m] and contact pressure [Pa] of the whole face (n1, n2).
    peak_pressure : contact pressure (n1, n2) [Pa] at the peak from which this state is unloaded; its points at the
    hardness have yielded. None on loading.
    undeformed : gap before any load (n1, n2) [m], up to a constant.
    half_space : elastic body of the whole face. law : what its points can carry.
    """
    if not (np.isfinite(gap).all() and np.isfinite(pressure).all()):
        return None
    virgin = undeformed
    if peak_pressure is not None and np.isfinite(peak_pressure).all():
        raw = _raw_gap(peak_pressure, undeformed, half_space, law)
        if np.isnan(raw).any():
            return None
        left = law.deformation(np.asarray(peak_pressure), raw, half_space.stiffness)
        virgin, law = undeformed + left, law.after(left)
    raw = _raw_gap(pressure, virgin, half_space, law)
    return None if np.isnan(raw).any() else np.maximum(raw, 0.0)


def _raw_gap(pressure: NDArray[np.floating], undeformed: Array, half_space: HalfSpace, law: ContactLaw) -> Array:
    """v − δ (n1, n2) [m] with the δ at which the projection of p − c (v − δ) on the law carries the load of p."""
    p = np.asarray(pressure, dtype=float)
    v = half_space.displacement(p) + undeformed
    load = float(p.sum())
    if load <= 0:
        return v - v.min()
    c = half_space.stiffness

    def excess(delta: float, p: Array, v: Array) -> float:
        return float(law.project(p - c * (v - delta), c).sum()) - load

    if not law.is_uniform:
        return v - _root(excess, p, v, load / (c * p.size))
    touching = p > 0
    # points out of contact can only lower δ
    highest = _root(excess, p[touching], v[touching], load / (c * np.count_nonzero(touching)))
    near = touching | (v < highest)
    return v - _root(excess, p[near], v[near], load / (c * np.count_nonzero(near)))


def _root(excess: Callable[[float, Array, Array], float], p: Array, v: Array, step: float) -> float:
    """The δ at which `excess` is 0, which rises with δ; `step` is about the size of its change.

    NaN where there is none: faces whose law softens may not carry the load at any δ.
    """
    furthest = 1e9 * step
    low = high = float(np.average(v, weights=p))
    while excess(low, p, v) > 0:
        low, step = low - step, 2 * step
    while excess(high, p, v) < 0:
        high, step = high + step, 2 * step
        if step > furthest:
            return float("nan")
    return high if low == high else float(scipy.optimize.brentq(excess, low, high, args=(p, v), xtol=1e-6 * step))
