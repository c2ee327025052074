"""Least-squares form of a measured map: mean, tilt plane or quadratic surface, undefined points left out.

Symbols: u, v = x1, x2 scaled to (−1, 1) across the map, z ≈ Σ a_ij uⁱ vʲ with i + j <= order.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..base.errors import InputError

ORDERS = "0 (mean), 1 (tilt) or 2 (tilt and curvature)"


@dataclass(frozen=True, eq=False)
class Form:
    """A fitted polynomial surface.

    coefficients : a_ij (3, 3) [m].
    shape, size : of the map it was fitted to, [-] and [m].
    """

    coefficients: NDArray
    shape: tuple[int, int]
    size: tuple[float, float]

    @property
    def heights(self) -> NDArray:
        """Form at the pixel centres (n1, n2) [m]."""
        u, v = (np.vander(scaled_centres(n), 3, increasing=True) for n in self.shape)
        return u @ self.coefficients @ v.T

    @property
    def slopes(self) -> tuple[float, float]:
        """∂z/∂x1, ∂z/∂x2 in the middle of the map [-]."""
        return (
            2 * float(self.coefficients[1, 0]) / self.size[0],
            2 * float(self.coefficients[0, 1]) / self.size[1],
        )

    @property
    def curvatures(self) -> tuple[float, float, float]:
        """∂²z/∂x1², ∂²z/∂x1∂x2, ∂²z/∂x2² [1/m]."""
        a, (l1, l2) = self.coefficients, self.size
        return 8 * float(a[2, 0]) / l1**2, 4 * float(a[1, 1]) / (l1 * l2), 8 * float(a[0, 2]) / l2**2


def scaled_centres(n: int) -> NDArray:
    """Pixel centres scaled to (−1, 1)."""
    return (2 * np.arange(n) + 1 - n) / n


def fit_form(heights: NDArray, size: tuple[float, float], order: int) -> Form:
    """Least-squares form of `heights` (n1, n2) [m] with NaN for undefined points.

    The normal equations need only the moments Σ uⁱ vʲ and Σ z uⁱ vʲ, which are two matrix products per map:
    no design matrix of the size of the map. Where points do not fix a term (a single row), it is zero (least
    norm).

    Raises InputError: order not 0, 1 or 2; no defined point.
    """
    if order not in (0, 1, 2):
        raise InputError("order", repr(order), ORDERS)
    defined = ~np.isnan(heights)
    if not defined.any():
        raise InputError("heights", "100 % undefined points", "at least one defined point")
    mean = float(heights[defined].mean())
    u, v = (np.vander(scaled_centres(n), 2 * order + 1, increasing=True) for n in heights.shape)
    moments = u.T @ defined.astype(float) @ v
    loads = u.T @ np.where(defined, heights - mean, 0.0) @ v
    terms = [(i, j) for i in range(order + 1) for j in range(order + 1 - i)]
    normal = np.array([[moments[i + k, j + l] for k, l in terms] for i, j in terms])
    solution = np.linalg.lstsq(normal, np.array([loads[t] for t in terms]))[0]
    coefficients = np.zeros((3, 3))
    for term, value in zip(terms, solution, strict=True):
        coefficients[term] = value
    coefficients[0, 0] += mean
    return Form(coefficients, (heights.shape[0], heights.shape[1]), size)
