"""Weak forms of thin-film and Darcy flow, ∇·(k ∇p) = 0, for scikit-fem."""

from __future__ import annotations

from typing import Any

from skfem import BilinearForm, Functional
from skfem.helpers import dot, grad, mul


@BilinearForm
def flow_along_x1(p: Any, q: Any, w: Any) -> Any:
    """∫ c ∂₁p ∂₁q."""
    return w.c * grad(p)[0] * grad(q)[0]


@BilinearForm
def flow_along_x2(p: Any, q: Any, w: Any) -> Any:
    """∫ c ∂₂p ∂₂q."""
    return w.c * grad(p)[1] * grad(q)[1]


@BilinearForm
def darcy_flow(p: Any, q: Any, w: Any) -> Any:
    """∫ (K ∇p)·∇q."""
    return dot(mul(w.k, grad(p)), grad(q))


@BilinearForm
def flux_resistance(u: Any, v: Any, w: Any) -> Any:
    """∫ (K⁻¹ u)·v."""
    return dot(mul(w.resistance, u), v)


@Functional
def dissipation(w: Any) -> Any:
    """∫ (K ∇p)·∇p."""
    return dot(mul(w.k, w.p.grad), w.p.grad)
