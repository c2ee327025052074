"""Contact on one grid: projected active sets, and preconditioned conjugate gradients on the free points.

The energy is ½⟨p, Kp⟩ + ⟨p, h₁⟩ + ψ(p), ψ that of the law. Its minimum under a load is where p = y(δ) for any c > 0: y
is the projection of p − c (v − δ) on the law, with v = Kp + h₁ and the δ that keeps Σ y = load; for perfect plasticity
y = clip(p − c (v − δ), 0, H). One iteration computes y. Where y moves points out of contact, to the hardness or back,
the sets change: p becomes y, and a product with K gives the new v. Then conjugate gradients on the free points
(elastic, or yielding on a slope) lower the energy for a few steps, with a product with K each. This is an inexact
semismooth Newton method. There is no proof of convergence: where the energy keeps rising, or after 60 iterations,
`Descent` takes over, and `ActiveSets.residual` is the residual reached.
Sources: Moré & Toraldo, SIAM J. Optim. 1, 1991, 93; Polonsky & Keer, Wear 231, 1999, 206.
"""

from math import inf, sqrt

from ..base import Array
from .descent import Descent
from .law import YieldLine
from .workspace import Workspace

#: Steps of conjugate gradients after a change of the sets, and without one, and the fraction to which the squared
#: energy norm of the residual falls in them at most.
_STEPS = 3, 5, 0.04
#: The same where an axis is long, as patches in contact are wide or far from each other: an unloading of 2048² points
#: takes 37 products, not 48; a strip of 2 × 32768 points takes 200, not 400 to 1,400.
_LONG_STEPS = 64, 64, 0.01
#: Points of the longer axis from which it is long.
_LONG = 1024
#: Iterations, and damping of steps that keep raising the energy, after which no step may raise it (`Descent`), a slower
#: rule that is seldom needed.
_MONOTONE_AFTER, _MONOTONE_BELOW = 60, 0.1
#: w·r that is a rounding error, relative to that of δ at all free points.
_FLAT = 1e-30
#: Sets stay while points that would leave them have at most this fraction of the squared residual, and it halves.
_FRACTION = 0.1


class ActiveSets:
    """The contact problem on one grid, and the state of its iteration.

    Parameters
    ----------
    grid : holds the initial pressure, and after `solve` the pressure and v of the solution.
    gap0 : undeformed gap h₁ [m].
    offset : height [m] that is subtracted from h₁ and δ, because large heights cost digits.
    line : pressures at which the points yield.
    load : mean pressure [Pa]; None where the approach is given.
    approach : δ [m]; None where the load is given.

    Attributes
    ----------
    delta : δ less the offset [m].
    residual : ‖p − y‖/‖p‖ · c₀/c.
    iterations : number of evaluations of y, less one.
    pairs : number of products with K, each a pair of transforms.
    """

    def __init__(
        self,
        grid: Workspace,
        gap0: Array,
        offset: float,
        line: YieldLine,
        load: float | None,
        approach: float | None,
    ) -> None:
        self.grid = grid
        self._gap0, self._offset, self._line = gap0.ravel(), offset, line
        self._law = line.hardness.ravel(), line.slope.ravel()
        self._points, self._stencil = tuple(grid.points), tuple(grid.stencil)
        self._loaded = load is not None
        self._load = 0.0 if load is None else load * gap0.size
        self.delta = 0.0 if approach is None else approach - offset
        self.residual, self.iterations, self.pairs = inf, 0, 0
        self._steps = _LONG_STEPS if max(grid.half_space.shape) >= _LONG else _STEPS
        self._c = self._c0 = grid.stiffness
        self._least_c = grid.stiffness / (4 * max(grid.half_space.shape))
        self._damping, self._energy = 1.0, inf
        self._new_sets = True
        # numbers of points near contact (in contact, or with v < reach) and of free points
        self._n_near, self._n_free, self._reach, self._margin = 0, 0, -inf, 0.0
        self._changed, self._fresh = True, False
        # of conjugate gradients: Σ M1, w·r of the next and of the former direction, and whether there is a next one
        self._ones, self._wr, self._former, self._turned = 0.0, 0.0, inf, False

    def solve(self, rtol: float, limit: int) -> None:
        """Iterate until the residual is `rtol`, for at most `limit` iterations."""
        self.grid.points.dense[:] = 0
        self._begin()
        self._look()
        while not self._solved(rtol):
            converged = self.residual <= rtol
            if self.iterations >= limit and not converged:
                return
            circles = self.iterations >= _MONOTONE_AFTER or self._damping < _MONOTONE_BELOW
            if circles and not converged:
                self._descend(rtol, limit)
                return
            self.iterations += 1
            if self._changed or converged or self._n_free < 2:
                self._change_sets()
            if converged:
                self._c = self._c0  # the returned residual follows its definition
            elif self._n_free >= 2:
                self._conjugate_gradients()
            self._look()

    def _solved(self, rtol: float) -> bool:
        """Whether the residual is reached by a pressure whose v is known and that carries the load."""
        if not (self.residual <= rtol and self._fresh):
            return False
        # a projected pressure carries the load; the initial one may miss it by as much as the residual
        start = self.iterations == 0 and self._loaded
        return not start or abs(float(self.grid.p.sum()) - self._load) <= 1e-10 * self._load

    def _begin(self) -> None:
        """List the points near contact of the initial pressure, with a first guess of the approach."""
        _, load, total = self._product()
        if self._loaded:
            self.delta = total / max(
                self._n_near, 1
            )  # none where coarser grids lose so light a load
        self._margin = 0.5 * load / (max(self._n_near, 1) * self._c0)
        self._reach = self.delta + self._margin
        self._list_near()

    def _product(self) -> tuple[float, float, float]:
        """Find v = Kp + h₁ and list the points near contact; returns energy and load of p, and Σ v on the list."""
        grid = self.grid
        grid.respond.apply()
        self.pairs += 1
        self._fresh = True
        energy, load, total = self._list_near(add=True)
        return energy - (0.0 if self._loaded else self.delta * load), load, total

    def _list_near(self, add: bool = False) -> tuple[float, float, float]:
        """List the points near contact, after h₁ is added to v where `add`; returns energy, Σ p and Σ v."""
        grid = self.grid
        self._n_near, self._n_free, *sums = grid.loops.add_gap(
            0,
            len(grid.v),
            add,
            self._gap0,
            self._offset,
            self._reach,
            self._law,
            self._points,
        )
        return tuple(sums)

    def _look(self) -> None:
        """Find δ and the residual, and decide whether the sets are to be changed.

        Points that are not on the list had v above `reach` when the list was made. If δ exceeds `reach`, a new list is
        made. It needs v of all points; after a step of conjugate gradients it waits for the next product with p.
        """
        grid, former = self.grid, self.residual
        while True:
            self.delta, carried, r2, y2, changed, changed2 = grid.loops.look(
                self._n_near,
                self._c,
                self._load,
                self._loaded,
                self.delta,
                self._law,
                self._points,
            )
            if (carried and self.delta <= self._reach) or not self._fresh or self._reach == inf:
                break
            self._margin = max(4.0 * self._margin, self.delta - self._reach)
            reach = self.delta + self._margin
            self._reach = reach if carried and reach < inf else inf  # inf if NaN
            self._list_near()
        relative = inf if r2 > 0.0 else 0.0
        if y2 > 0.0:
            relative = sqrt(r2 / y2)
        self.residual = relative * (self._c0 / self._c)  # about the residual for the step c₀
        leaving = changed2 > _FRACTION * r2
        # keep the sets as long as the residual falls and the points that would leave them have a small fraction of it
        self._changed = (
            changed > 0 and (leaving or self.residual > 0.5 * former)
        ) or self.iterations == 0

    def _change_sets(self) -> None:
        """Project p on the bounds and the load, which decides which points are free, and find v."""
        grid = self.grid
        keep = self.iterations > 1
        self._n_free = grid.loops.project(
            self._n_near,
            self._n_free,
            self._c,
            self.delta,
            self._load,
            keep,
            self._law,
            self._points,
        )
        self._reach = self.delta + self._margin
        energy, _, _ = self._product()
        rose = energy > self._energy + 1e-13 * abs(self._energy)
        self._damping = max(self._damping / 2, 1e-3) if rose else min(1.0, 1.25 * self._damping)
        self._energy = energy
        self._new_sets = True

    def _conjugate_gradients(self) -> None:
        """Make a few steps on the free points; their Rayleigh quotients d·Kd/d·d give the step c of the next look."""
        grid, longest, first = self.grid, self._c0, inf
        after_change, without, drop = self._steps
        if self._new_sets:
            self._ones = grid.loops.restart(
                self._n_free,
                self.delta,
                self._loaded,
                self._law,
                self._points,
                self._stencil,
            )
            self._former, self._turned, self._new_sets = inf, False, False
        for steps in range(after_change if self._changed else without):
            if not self._turned:
                self._wr = grid.loops.turn(
                    self._n_free,
                    self._former,
                    self._ones,
                    self._loaded,
                    self._points,
                    self._stencil,
                )
                self._turned = True
            if steps == 0:
                first = self._wr
                # flat to rounding on the free points: the sets have to change
                if not first > _FLAT * self.delta**2 * self._ones:
                    self._c = max(self._least_c, self._damping * self._c0)
                    return
            if not (self._wr > 0.0 and self._wr >= drop * first):
                break
            grid.search.apply()
            self.pairs += 1
            curvature, length, made = grid.loops.step(
                self._n_near,
                self._n_free,
                self._wr,
                self._loaded,
                grid.kd,
                self._points,
            )
            self._turned = False
            if not made:
                self._former = inf
                break
            self._former, self._fresh = self._wr, False
            longest = min(longest, length / curvature) if curvature > 0.0 else longest
        self._c = max(self._least_c, min(self._c0, 2.0 * self._damping * longest))

    def _descend(self, rtol: float, limit: int) -> None:
        """Go on by steps that never raise the energy."""
        grid = self.grid
        self._change_sets()
        descent = Descent(
            grid,
            self._gap0 - self._offset,
            self._line,
            self._load if self._loaded else None,
            self.delta,
        )
        descent.solve(rtol, limit - self.iterations)
        self.delta, self.residual = descent.delta, descent.residual
        self.iterations += descent.iterations
        self.pairs += descent.pairs
