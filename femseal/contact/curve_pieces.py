"""Approximate the curve H(u) of a contact law by cubic pieces, which compiled loops can evaluate.

Curves that consist of cubic pieces between known depths, such as tables and coatings of constant hardness, are
represented exactly. All other curves are divided into pieces that are short enough for a cubic through four of their
points to match the curve to eleven digits.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ..base import Array, Flags

#: Depths [m] between which the curve is divided at first, in addition to the depths at which its formula changes. The
#: largest of these depths exceeds the plastic deformation of any contact.
_FIRST_DEPTHS = np.geomspace(1e-10, 1e-1, 28)
#: Largest relative error of the hardness in a piece.
_TOLERANCE = 1e-11
#: Errors are relative to the hardness, or to this fraction of the hardness at u = 0 if the hardness is smaller.
_LOWEST = 1e-3
#: Pieces are constant if their relative variation is at most this value, which rounding errors can cause.
_ROUNDING = 1e-13
#: Pieces are not divided further below this width [m], or more often than this number.
_NARROWEST, _MOST_DIVISIONS = 1e-16, 60
#: Largest number of pieces. The curves of the contact laws in femseal have at most about a thousand pieces.
_MOST_PIECES = 20_000
#: Positions in a piece whose values define its cubic, and positions at which the cubic is compared with the curve.
_FITTED = np.array([0.0, 1 / 3, 2 / 3, 1.0])
_COMPARED = np.array([0.1, 0.5, 0.9])
#: Matrix that converts values at the positions `_FITTED` to coefficients of the cubic, and matrix that converts
#: coefficients to values at the positions `_COMPARED`.
_TO_COEFFICIENTS = np.linalg.inv(np.vander(_FITTED, increasing=True)).T
_TO_VALUES = np.vander(_COMPARED, 4, increasing=True).T


@dataclass(frozen=True, eq=False)
class CurvePieces:
    """Curve H(u) for u >= 0 in cubic pieces. The last piece extends to infinity.

    Parameters
    ----------
    depth : array (pieces,)
        Depth [m] at which each piece begins, in increasing order. The first piece begins at 0.
    coefficients : array (pieces, 4)
        Coefficients a_k [Pa/m^k] of each piece, with H(u) = Σ a_k (u − depth)^k for k = 0 to 3.
    """

    depth: Array
    coefficients: Array

    @classmethod
    def of(cls, yield_pressure: Callable[[Array], Array], bends: Array) -> CurvePieces | None:
        """Divide a curve into cubic pieces.

        Returns None if the curve needs more than `_MOST_PIECES` pieces, for example because it contains noise.

        Parameters
        ----------
        yield_pressure : callable
            Function that computes H(u) [Pa] for an array of depths u [m].
        bends : array (n,)
            Depths [m] at which the curve or one of its derivatives may be discontinuous.
        """
        bends = bends[np.isfinite(bends) & (bends > 0)]
        edges = np.unique(np.r_[0.0, bends, _FIRST_DEPTHS])
        # beginnings and ends of the pieces that are not yet accurate, (pieces,)
        start, end = edges[:-1], edges[1:]
        lowest = _LOWEST * float(yield_pressure(np.zeros(1))[0])
        # beginnings and coefficients of the accurate pieces, in lists of arrays
        depths = []
        coefficients = []
        for division in range(_MOST_DIVISIONS):
            width = end - start
            cubic, is_accurate, fall_or_rise = _fitted_cubics(yield_pressure, start, width, lowest)
            # a piece around a kink at an unknown depth is divided until it is very narrow, and then becomes a straight
            # line, which does not overshoot
            is_last_division = division == _MOST_DIVISIONS - 1
            is_kink = ~is_accurate & ((width <= _NARROWEST) | is_last_division)
            cubic[is_kink, 1] = fall_or_rise[is_kink]
            cubic[is_kink, 2:] = 0.0
            is_finished = is_accurate | is_kink
            depths.append(start[is_finished])
            # convert the coefficients from positions within the piece to depths
            scale = width[is_finished, None] ** np.arange(4)
            coefficients.append(cubic[is_finished] / scale)
            start, end = start[~is_finished], end[~is_finished]
            if start.size == 0:
                break
            if sum(map(len, depths)) + 2 * start.size > _MOST_PIECES:
                return None
            # divide the other pieces in the middle
            middle = 0.5 * (start + end)
            start, end = np.r_[start, middle], np.r_[middle, end]
        depth = np.concatenate(depths)
        order = np.argsort(depth)  # accurate pieces were found in any order
        return cls(depth[order], np.concatenate(coefficients)[order]).with_one_end()

    def with_one_end(self) -> CurvePieces:
        """Merge the last pieces of the curve into one if they have the same constant hardness."""
        hardness = self.coefficients[:, 0]  # at the beginning of each piece
        # largest contribution of each power of the depth to the hardness in a piece, (pieces − 1, 3)
        variation = np.abs(self.coefficients[:-1, 1:] * self._widths[:, None] ** np.arange(1, 4))
        # whether a piece does not belong to the constant end: its hardness is another one, or not constant
        differs = np.abs(hardness[:-1] - hardness[-1]) > _ROUNDING * hardness[-1]
        differs |= variation.max(axis=1, initial=0.0) > _ROUNDING * hardness[:-1]
        # first piece of the constant end
        first = 1 + int(np.flatnonzero(differs)[-1]) if differs.any() else 0
        if first == hardness.size - 1:  # there is nothing to merge
            return self
        coefficients = self.coefficients[: first + 1].copy()
        coefficients[-1] = hardness[-1], 0.0, 0.0, 0.0
        return CurvePieces(self.depth[: first + 1], coefficients)

    @property
    def _widths(self) -> Array:
        """Width [m] of each piece except the last piece, (pieces − 1,)."""
        return np.diff(self.depth)

    @cached_property
    def has_constant_end(self) -> bool:
        """Whether the hardness is constant in the last piece."""
        return not np.any(self.coefficients[-1, 1:])

    @cached_property
    def steepest_fall(self) -> float:
        """Largest value of −dH/du [Pa/m] at the ends and in the middle of the pieces; 0 if the law does not soften."""
        _, a1, a2, a3 = self.coefficients.T
        slopes = [a1]
        for position in (0.5, 1.0):
            s = position * self._widths
            slopes.append(a1[:-1] + s * (2 * a2[:-1] + 3 * s * a3[:-1]))
        return max(0.0, -float(np.min(np.concatenate(slopes))))

    def times(self, factor: float) -> CurvePieces:
        """Return the curve factor · H(u)."""
        return self if factor == 1 else CurvePieces(self.depth, factor * self.coefficients)

    def hardness(self, deformation: Array) -> Array:
        """Compute H(u) [Pa] at plastic deformations [m] of any shape."""
        piece = np.searchsorted(self.depth, deformation, side="right") - 1
        s = deformation - self.depth[piece]
        a0, a1, a2, a3 = np.moveaxis(self.coefficients[piece], -1, 0)
        return a0 + s * (a1 + s * (a2 + s * a3))


def _fitted_cubics(
    yield_pressure: Callable[[Array], Array], start: Array, width: Array, lowest: float
) -> tuple[Array, Flags, Array]:
    """Fit a cubic to the curve in each piece, and check its error between the fitted points.

    start, width : beginning and width of each piece [m], (pieces,).
    lowest : hardness [Pa] to which the error is relative if the hardness is smaller.

    Returns
    -------
    cubic : coefficients [Pa] of the cubic through four points of each piece, (piece, power). The variable of the cubic
        is the position within the piece, from 0 to 1.
    is_accurate : whether the cubic agrees with the curve, (pieces,).
    fall_or_rise : hardness at the end of each piece minus that at its beginning [Pa], (pieces,).
    """
    fitted = _values(yield_pressure, start, width, _FITTED)
    cubic = fitted @ _TO_COEFFICIENTS
    # difference between cubic and curve at other positions, (piece, position)
    values = _values(yield_pressure, start, width, _COMPARED)
    error = np.abs(cubic @ _TO_VALUES - values)
    # where the hardness has fallen to nearly nothing, it need not be accurate to a fraction of itself
    allowed = _TOLERANCE * np.maximum(np.abs(values), lowest)
    is_accurate = np.all(error <= allowed, axis=1)
    return cubic, is_accurate, fitted[:, -1] - fitted[:, 0]


def _values(
    yield_pressure: Callable[[Array], Array], start: Array, width: Array, positions: Array
) -> Array:
    """Compute the hardness [Pa] at n positions in each piece, as an array (pieces, n).

    start : depth at which each piece begins [m], (pieces,).
    width : width of each piece [m], (pieces,).
    positions : positions within a piece, from 0 at its beginning to 1 at its end, (n,).
    """
    depth = start[:, None] + width[:, None] * positions
    return np.broadcast_to(yield_pressure(depth), depth.shape)
