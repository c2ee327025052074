"""Weak forms of thin-film and Darcy flow, ∇·(k ∇p) = 0, for scikit-fem."""

from __future__ import annotations

from typing import Any

from skfem import BilinearForm, LinearForm
from skfem.helpers import div, dot, grad, mul


@BilinearForm
def flow_along_x1(p: Any, q: Any, w: Any) -> Any:
    """∫ c ∂₁p ∂₁q."""
    return w.c * grad(p)[0] * grad(q)[0]


@BilinearForm
def flow_along_x2(p: Any, q: Any, w: Any) -> Any:
    """∫ c ∂₂p ∂₂q."""
    return w.c * grad(p)[1] * grad(q)[1]


@BilinearForm
def isotropic_flow(p: Any, q: Any, w: Any) -> Any:
    """∫ k ∇p·∇q."""
    return w.k * dot(grad(p), grad(q))


@BilinearForm
def darcy_flow(p: Any, q: Any, w: Any) -> Any:
    """∫ (K ∇p)·∇q."""
    return dot(mul(w.k, grad(p)), grad(q))


@BilinearForm
def flux_resistance(u: Any, v: Any, w: Any) -> Any:
    """∫ (K⁻¹ u)·v."""
    return dot(mul(w.resistance, u), v)


@BilinearForm
def flux_divergence(u: Any, q: Any, w: Any) -> Any:
    """∫ q ∇·u."""
    return q * div(u)


@LinearForm
def normal_flux(v: Any, w: Any) -> Any:
    """∫ v·n on a boundary."""
    return dot(v, w.n)
