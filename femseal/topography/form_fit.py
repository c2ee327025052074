"""Fit the form of a map: its mean, a tilted plane or a quadratic surface, by least squares.

The form is z ≈ Σ a_ij uⁱ vʲ with i + j <= order, where u and v are x1 and x2 scaled to the range (−1, 1) over the map.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..base import Array, Flags, InputError, Pair, Periodic, Shape

#: Number of points of a block of rows. The windows of 5 × 5 points of a whole map would need as much memory as 25 maps.
_BLOCK = 2**16
ORDERS = "0 (mean), 1 (tilt) or 2 (tilt and curvature)"


@dataclass(frozen=True, eq=False)
class Form:
    """Form of a map: a polynomial surface that was fitted to the heights.

    Parameters
    ----------
    coefficients : array, (3, 3)
        Coefficients a_ij of the polynomial [m].
    shape : tuple of two int
        Shape of the map.
    size : tuple of two float
        Sides of the map [m].
    """

    coefficients: NDArray
    shape: Shape
    size: Pair

    @property
    def heights(self) -> NDArray:
        """Heights of the polynomial surface at all pixel centres, (n1, n2) [m]."""
        u, v = (_powers(n, 3) for n in self.shape)
        return u @ self.coefficients @ v.T

    def at(self, selected: Flags) -> Array:
        """Return the heights of the form, (points,) [m], at the points where `selected`, (n1, n2), is True."""
        row, column = np.nonzero(selected)
        u, v = (_powers(n, 3) for n in self.shape)
        return np.einsum("pi,ij,pj->p", u[row], self.coefficients, v[column])

    @property
    def slopes(self) -> Pair:
        """Slopes ∂z/∂x1 and ∂z/∂x2 in the middle of the map [-]."""
        return (
            2 * float(self.coefficients[1, 0]) / self.size[0],
            2 * float(self.coefficients[0, 1]) / self.size[1],
        )

    @property
    def curvatures(self) -> tuple[float, float, float]:
        """Second derivatives ∂²z/∂x1², ∂²z/∂x1∂x2 and ∂²z/∂x2² [1/m]."""
        a, (l1, l2) = self.coefficients, self.size
        return (
            8 * float(a[2, 0]) / l1**2,
            4 * float(a[1, 1]) / (l1 * l2),
            8 * float(a[0, 2]) / l2**2,
        )


def scaled_centres(n: int) -> NDArray:
    """Return the positions of the pixel centres along an axis, (n,), scaled to the range (−1, 1)."""
    return (2 * np.arange(n) + 1 - n) / n


def _powers(n: int, count: int) -> NDArray:
    """Return the powers 0 to `count` − 1 of the scaled positions of the pixel centres along an axis, (n, count)."""
    return np.vander(scaled_centres(n), count, increasing=True)


def fit_form(heights: NDArray, size: Pair, order: int, tilted: Periodic = (True, True)) -> Form:
    """Fit a polynomial surface to the defined points of a map by least squares.

    The normal equations contain only the moments Σ uⁱ vʲ and Σ z uⁱ vʲ, which are computed as matrix products. A design
    matrix with a row for each point would take several times the memory of the map. A term that the points do not
    determine, such as the tilt along x1 of a map with a single row, is 0 (minimum-norm solution).

    Parameters
    ----------
    heights : array, (n1, n2)
        Heights [m], NaN where undefined.
    size : tuple of two float
        Sides of the map [m].
    order : int
        0 for the mean, 1 for mean and tilt, 2 for mean, tilt and curvature.
    tilted : tuple of two bool
        Whether the fitted polynomial may vary along x1 and along x2.

    Raises
    ------
    InputError
        The order is invalid, or no point is defined.
    """
    if order not in (0, 1, 2):
        raise InputError("order", repr(order), ORDERS)
    defined = ~np.isnan(heights)
    if not defined.any():
        raise InputError("heights", "100 % undefined points", "at least one defined point")
    mean = float(np.mean(heights, where=defined))
    u, v = (_powers(n, 2 * order + 1) for n in heights.shape)
    moments = np.zeros((u.shape[1], v.shape[1]))  # Σ uⁱ vʲ at [i, j]
    height_moments = np.zeros_like(moments)  # Σ (z − mean) uⁱ vʲ
    for block in row_blocks(heights.shape):
        is_known = defined[block]
        moments += u[block].T @ is_known.astype(float) @ v
        height_moments += u[block].T @ np.where(is_known, heights[block] - mean, 0.0) @ v
    terms = [
        (i, j)
        for i in range(order + 1)
        for j in range(order + 1 - i)
        if (tilted[0] or i == 0) and (tilted[1] or j == 0)
    ]
    # normal equations: the term uᵏ vˡ in the row of the term uⁱ vʲ has the coefficient Σ uⁱ⁺ᵏ vʲ⁺ˡ
    matrix = np.array([[moments[i + k, j + l] for k, l in terms] for i, j in terms])
    right_side = np.array([height_moments[term] for term in terms])
    solution = np.linalg.lstsq(matrix, right_side)[0]
    coefficients = np.zeros((3, 3))
    for term, value in zip(terms, solution, strict=True):
        coefficients[term] = value
    coefficients[0, 0] += mean
    return Form(coefficients, (heights.shape[0], heights.shape[1]), size)


def row_blocks(shape: tuple[int, ...]) -> Iterator[slice]:
    """Yield slices of rows that divide a map into blocks of about `_BLOCK` points."""
    rows = max(1, _BLOCK // shape[1])
    for start in range(0, shape[0], rows):
        yield slice(start, min(start + rows, shape[0]))
