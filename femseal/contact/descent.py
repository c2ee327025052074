"""Contact by steps that never raise the energy, for problems in which active sets go round in circles.

Each iteration makes one step along the projected gradient, of the length of Barzilai and Borwein, which decides which
points are free, and then conjugate gradients on the free points; a point that reaches a bound stays there, and the
directions begin anew. The energy ½⟨p, Kp⟩ + ⟨p, h₁⟩ + ψ(p), ψ = ½ Σ (p − H)₊²/h where points harden, falls with every
step and the load is kept.
Sources: Moré & Toraldo, SIAM J. Optim. 1, 1991, 93; Birgin, Martínez & Raydan, SIAM J. Optim. 10, 2000, 1196.
"""

import numpy as np
from numpy.typing import NDArray

from ..base import Array
from . import gradient_kernels, kernels
from .kernels import Line
from .law import YieldLine
from .workspace import Workspace

#: Steps of conjugate gradients in an iteration, and the fraction of the first w·r at which they stop.
_STEPS, _DROP = 25, 1e-3


class Descent:
    """A contact problem on one grid whose pressure lies within the bounds and carries the load.

    Parameters
    ----------
    grid : holds the pressure that it starts from, and after `solve` the pressure and v of the solution.
    gap : undeformed gap h₁ less its offset [m], flat.
    line : pressures at which the points yield.
    load : Σ p [Pa]; None where the approach is given.
    delta : approach δ less the offset [m].

    Attributes
    ----------
    delta, residual, iterations, pairs : as in `ActiveSets`.
    """

    def __init__(
        self, grid: Workspace, gap: Array, line: YieldLine, load: float | None, delta: float
    ) -> None:
        self._grid, self._gap, self._load = grid, gap, load
        self._line = Line(line.hardness.ravel(), line.slope.ravel())
        self._hardness, self._slope, self._limit = (
            np.broadcast_to(values, gap.shape) for values in (*self._line, line.limit.ravel())
        )
        # of points that yield on a slope
        self._compliance = np.divide(1, self._slope, out=np.zeros(gap.shape), where=self._slope > 0)
        self._every = np.arange(gap.size, dtype=np.int32)
        self.delta, self.residual, self.iterations, self.pairs = delta, np.inf, 0, 0

    def solve(self, rtol: float, limit: int) -> None:
        """Iterate until the residual is `rtol`, for at most `limit` iterations."""
        grid, p = self._grid, self._grid.p
        c0 = c = grid.stiffness
        while True:
            grid.respond.apply()
            self.pairs += 1
            v = (
                grid.respond.displacement.ravel() + self._gap
            )  # the products of directions take its memory
            self.delta, y = self._projected(p, v, c0)
            self.residual = (
                float(np.linalg.norm(y - p) / np.linalg.norm(y)) if y.any() else np.inf * p.any()
            )
            if self.residual <= rtol or self.iterations == limit:
                grid.respond.displacement[:] = v.reshape(grid.pressure.shape)
                return
            self.iterations += 1
            c = self._gradient_step(p, v, c)
            self._face_steps(p, v)

    def _projected(self, p: Array, v: Array, c: float) -> tuple[float, Array]:
        """δ and y, the projection of p − c (v − δ) on the law."""
        x, delta, line = p - c * v, self.delta, self._line
        if self._load is not None:
            delta = kernels.root(x, x.size, line, c, self._every, c, self._load, delta)[0]
        z = x + c * delta
        over = np.maximum(z - self._hardness, 0.0)
        return delta, np.clip(z, 0.0, self._hardness) + self._slope / (self._slope + c) * over

    def _energy(self, p: Array) -> float:
        """ψ(p), what the law adds to the energy."""
        return float(0.5 * self._compliance @ np.maximum(p - self._hardness, 0.0) ** 2)

    def _product(self, d: Array) -> Array:
        self._grid.points.dense[:] = d
        self._grid.search.apply()
        self.pairs += 1
        return self._grid.search.displacement.ravel().astype(float)

    def _gradient_step(self, p: Array, v: Array, c: float) -> float:
        """Step to y or to the lowest energy on the way; returns the length of the next such step."""
        delta, y = self._projected(p, v, c)
        d = y - p
        response = self._product(d)
        slope = float(d @ (v - delta))
        curvature = float(d @ response)
        length = float(d @ d)
        slope += self._energy(y) - self._energy(p)
        if not (slope < 0 and curvature > 0):
            return self._grid.stiffness
        fraction = min(1.0, -slope / curvature)
        p += fraction * d
        np.clip(p, 0.0, self._limit, out=p)
        v += fraction * response
        return length / curvature

    def _face_steps(self, p: Array, v: Array) -> None:
        """Conjugate gradients on the free points, up to the first bound that is met, and on from there.

        The bounds of an elastic point are 0 and H, those of one that yields on a slope are H and inf.
        """
        hardness, first = self._hardness, 0.0
        free = self._every[:0]
        d = soft = np.zeros(0)
        former = np.inf
        for step in range(_STEPS):
            if former == np.inf:
                yields = (p > hardness) & (self._slope > 0)
                free = self._every[((p > 0) & (p < hardness)) | yields]
                if free.size < 2:
                    return
                low = np.where(yields, hardness, 0.0)[free]
                high = np.where(yields, np.inf, hardness)[free]
                soft = np.where(yields, self._compliance, 0.0)[free]
                scale = 1.0 / np.sqrt(1.0 + soft * self._grid.stencil.weights.max())
                ones = self._preconditioned(free, np.ones(free.size), scale)
                d = np.zeros(free.size)
            r = self.delta - v[free] - soft * np.maximum(p[free] - hardness[free], 0.0)
            if self._load is not None:
                r -= r.mean()
            w = self._preconditioned(free, r, scale)
            if self._load is not None:
                w -= w.sum() / ones.sum() * ones
            wr = float(w @ r)
            first = first or wr
            if not wr > _DROP * first * (step > 0):
                return
            d = w + wr / former * d
            dense = np.zeros_like(p)
            dense[free] = d
            response = self._product(dense)
            curvature = float(d @ response[free] + d @ (soft * d))
            if not curvature > 0:
                return
            with np.errstate(divide="ignore", invalid="ignore"):
                room = np.where(
                    d > 0, (high - p[free]) / d, np.where(d < 0, (low - p[free]) / d, np.inf)
                )
            nearest = int(room.argmin())
            fraction = min(wr / curvature, float(room[nearest]))
            former = wr
            p[free] = np.clip(p[free] + fraction * d, low, high)
            v += fraction * response
            if fraction == room[nearest]:
                p[free[nearest]] = high[nearest] if d[nearest] > 0 else low[nearest]
                former = np.inf

    def _preconditioned(self, free: NDArray[np.int32], values: Array, scale: Array) -> Array:
        """s M s of values on the free points, s = 1 where the law does not harden."""
        out = np.empty(free.size)
        dense = self._grid.points.dense
        dense[:] = 0
        dense[free] = values * scale
        gradient_kernels.apply_stencil(free, dense, out, self._grid.stencil)
        return out * scale
