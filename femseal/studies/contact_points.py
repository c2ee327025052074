"""Solve the contact pressures of points on an elastic half-space that is covered with a compliant rough layer.

In the module `seal_contact`, the points cover a seal with a form deviation. In the module `blocks`, each point
represents a cell of a large surface.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import partial
from typing import NamedTuple

import numpy as np
from scipy.optimize import brentq

from ..base import Array, Flags, Indices, NotConverged
from ..contact import HalfSpace
from ..contact.convolution import Convolution
from ..loads import LoadProgramme
from .rough_layer import RoughLayer

#: Relative change of the pressures at which the iteration has converged, and largest number of iterations.
_RTOL, _MOST_ITERATIONS = 1e-5, 5000
#: Largest relative part of the load that may be missing after pressures were limited to the yield pressure.
_LOAD_TOLERANCE = 1e-9
#: If a step of the iteration is too long, the slope of the energy along the step changes its sign. A step is accepted
#: if the slope at its end is at most this fraction of the slope at its start. Otherwise, a shorter step is computed
#: with the same relative accuracy.
_OVERSHOT = 0.1
#: Error of the uniform part of the pressure, as a fraction of the mean pressure.
_UNIFORM_TOLERANCE = 1e-3
#: Function that returns the separation s [m] and ds/dp [m/Pa] of the rough layer at pressures (n,) [Pa].
LayerLaw = Callable[[Array], tuple[Array, Array]]


class PointSolution(NamedTuple):
    """Pressures and separations of all points under a given mean pressure.

    Attributes
    ----------
    pressure : array (n,), Pa
        Contact pressure at each point.
    separation : array (n,), m
        Distance between the mean planes of the rough surfaces.
    opening : array (n,), m
        Opening: separation minus the separation at which the rough surfaces just touch; 0 at points in contact.
    sunk : array (n,), m
        Permanent displacement of each point by the yielding of the bodies.
    """

    pressure: Array
    separation: Array
    opening: Array
    sunk: Array


class ContactPoints:
    """Solve the contact of points on an elastic body, which yields at a given pressure.

    Parameters
    ----------
    body : HalfSpace
        Elastic half-space of n1 × n2 points.
    inside : array of bool (n1, n2)
        Whether each point of the half-space belongs to the seal. The seal has n points.
    depth : array (n,), m
        Depth of each point below the highest point.
    yield_pressure : float, Pa
        Pressure at which the body yields.
    row : array of int (n,), optional
        Index of the row to which each point belongs. If `row` is given, the deformation of the body by the uniform part
        of the pressure is neglected. The uniform part is the smallest mean pressure of a row. By default, the body is
        deformed by the whole pressure.
    """

    def __init__(
        self,
        body: HalfSpace,
        inside: Array,
        depth: Array,
        yield_pressure: float,
        row: Indices | None = None,
    ) -> None:
        self.depth = depth
        self._inside = inside
        self._yield_pressure = yield_pressure
        self._row = row
        self._product = Convolution(body.shape, body.boundary, body.symbol())
        unit_pressure = np.zeros(body.shape)
        middle = body.shape[0] // 2, body.shape[1] // 2
        unit_pressure[middle] = 1.0
        displacement = body.displacement(unit_pressure)
        # Compliance of a single point: displacement by its own pressure, relative to the displacement of the farthest
        # point. Displacements in plane strain are only known up to a constant.
        self._point_compliance = float(displacement[middle] - displacement.min())
        self._uniform_displacement = self.displacement(np.ones(depth.size))

    def displacement(self, p: Array) -> Array:
        """Compute the displacement of the points (n,) [m] under their pressures (n,) [Pa]."""
        self._product.pressure[self._inside] = p
        self._product.apply()
        return self._product.displacement[self._inside]

    def solve(self, layer: LayerLaw, load: float, start: Array, sunk: Array) -> PointSolution:
        """Solve the contact under a given mean pressure.

        The uniform part of the pressure is the smallest mean pressure of a row. It is found by iteration, because the
        pressures of the rows depend on it.

        Parameters
        ----------
        layer : callable
            Function that returns the separation s [m] and ds/dp [m/Pa] of the rough layer at pressures (n,) [Pa].
        load : float, Pa
            Mean pressure.
        start : array (n,), Pa
            Initial pressures for the iteration, near the solution; zeros if no such pressures are known.
        sunk : array (n,), m
            Permanent displacement of each point by earlier yielding.
        """
        if self._row is None or load == 0:
            return self._solve_with_uniform_part(0.0, layer, load, start, sunk)
        row, points_of_row = self._row, np.bincount(self._row)
        # solution for each assumed uniform part, as a fraction of the load
        solution_by_fraction: dict[float, PointSolution] = {}

        def excess(uniform_fraction: float) -> float:
            """Return (smallest mean pressure of a row − uniform part)/load for an assumed uniform part."""
            guess = start
            if solution_by_fraction:
                nearest = min(solution_by_fraction, key=lambda other: abs(other - uniform_fraction))
                guess = solution_by_fraction[nearest].pressure
            uniform_part = uniform_fraction * load
            solution = self._solve_with_uniform_part(uniform_part, layer, load, guess, sunk)
            solution_by_fraction[uniform_fraction] = solution
            row_pressure = np.bincount(row, solution.pressure) / points_of_row
            return float(row_pressure.min()) / load - uniform_fraction

        # The uniform part is the root of the function `excess`. If all rows have the same pressure, the uniform part is
        # the whole load. If a row is not in contact, the uniform part is 0.
        uniform_fraction = 1.0
        if excess(1.0) < -_UNIFORM_TOLERANCE:
            uniform_fraction = 0.0
            if excess(0.0) > _UNIFORM_TOLERANCE:
                uniform_fraction = brentq(excess, 0.0, 1.0, xtol=_UNIFORM_TOLERANCE)
        return solution_by_fraction[uniform_fraction]

    def _solve_with_uniform_part(
        self, uniform_part: float, layer: LayerLaw, load: float, start: Array, sunk: Array
    ) -> PointSolution:
        """Solve the contact under the mean pressure `load`, without the deformation of the body by `uniform_part` [Pa].

        The solution is found by conjugate gradients under a fixed load (Polonsky & Keer, Wear 231, 1999, 206). The
        unknowns are the pressures of the points that are in contact and do not yield. The diagonal preconditioner is
        1/(compliance of the body + compliance of the rough layer) at each point.
        """
        n = self.depth.size
        # the convolution below includes the displacement by the uniform part, which is subtracted here
        depth = self.depth + sunk - uniform_part * self._uniform_displacement
        touch = layer(np.zeros(n))[0]  # separation at first touch
        yield_pressure = self._yield_pressure
        if load == 0:
            opening = depth - touch - float((depth - touch).min())
            return PointSolution(np.zeros(n), touch + opening, opening, sunk)
        p = np.full(n, load)
        if start.any():
            p = np.minimum(start * (load / start.mean()), yield_pressure)
        direction, previous_norm = np.zeros(n), 0.0
        change = math.inf
        for _ in range(_MOST_ITERATIONS):
            separation, slope = layer(p)  # the slope ds/dp is negative
            weight = 1 / (self._point_compliance - slope)  # preconditioner
            # distance of the smooth bodies minus separation of the rough layer; 0 at free points of the solution
            residual = depth + self.displacement(p) - separation
            free = (p > 0) & (p < yield_pressure)
            # a part of the load is missing if pressures were limited to the yield pressure
            if p.mean() < load * (1 - _LOAD_TOLERANCE):
                if free.any():
                    _scale_to_load(p, free, load, changed=free)
                else:
                    _press_further_points(p, residual + separation - touch, yield_pressure, load)
                p = np.minimum(p, yield_pressure)
                previous_norm = 0.0
                continue
            # The approach of the bodies is unknown. The approach is chosen so that the weighted mean residual vanishes.
            if free.any():
                residual -= weight[free] @ residual[free] / weight[free].sum()
            else:
                # all points in contact yield: the bodies approach until the first of them would unload
                residual -= residual[p > 0].max()
            correction = -weight * residual
            # points where the bodies would overlap come into contact; yielded points whose pressure decreases become
            # free
            overlaps = (p == 0) & (residual + separation < touch)
            unloads = (p == yield_pressure) & (correction < 0)
            freed = overlaps | unloads
            change = float(np.abs(correction[free | freed]).max(initial=0.0)) / load
            if change <= _RTOL:
                opening = np.where(p > 0, 0.0, np.maximum(residual + separation - touch, 0.0))
                # where the bodies yield, they are indented until they no longer overlap
                sinks = np.where(p == yield_pressure, np.maximum(-residual, 0.0), 0.0)
                separation = np.where(p > 0, separation, touch + opening)
                return PointSolution(p, separation, opening, sunk + sinks)
            correction[~free] = 0.0
            # squared norm of the residual, with the preconditioner as weight
            norm = -float(residual @ correction)
            # Fletcher-Reeves; 0 restarts the iteration
            beta = norm / previous_norm if previous_norm else 0.0
            direction = correction + beta * np.where(free, direction, 0.0)
            # If the free points are in equilibrium within the tolerance, only the pressures of the freed points change.
            # A line search would compare rounding errors.
            length = 1.0
            if np.abs(correction[free]).max(initial=0.0) > _RTOL * load:
                length = self._step_length(p, direction, residual, (separation, slope), layer)
            p = np.clip(p + length * direction, 0.0, yield_pressure)
            freed_pressure = p[freed] - length * weight[freed] * residual[freed]
            p[freed] = np.clip(freed_pressure, 0.0, yield_pressure)
            is_free = (p > 0) & (p < yield_pressure)
            _scale_to_load(p, is_free, load, changed=free | freed)
            p = np.minimum(p, yield_pressure)
            # the directions are conjugate only as long as the set of free points does not change
            set_changes = freed.any() or (is_free != free).any()
            previous_norm = 0.0 if set_changes else norm
        text = f"contact of the seal with its form: the pressure of its cells still changes by {change:.1e}"
        raise NotConverged(text, change)

    def _step_length(
        self,
        p: Array,
        direction: Array,
        residual: Array,
        layer_at_p: tuple[Array, Array],
        layer: LayerLaw,
    ) -> float:
        """Compute the length of a step in a search direction, as a multiple of `direction`, that minimises the energy.

        Parameters
        ----------
        p, direction : array (n,), Pa
            Pressures at the start of the step, and search direction.
        residual : array (n,), m
            Distance of the smooth bodies at the pressures p, minus the separation of the rough layer.
        layer_at_p : tuple of two arrays (n,)
            Separation s [m] and ds/dp [m/Pa] of the rough layer at the pressures p.
        layer : callable
            Function that returns s and ds/dp at other pressures.
        """
        separation, slope = layer_at_p
        direction_displacement = self.displacement(direction)
        slope_at = partial(
            _energy_slope, p, direction, residual + separation, direction_displacement, layer
        )
        curvature = float((direction_displacement - slope * direction) @ direction)
        length = -float(residual @ direction) / curvature
        # Where the rough layer becomes stiffer along the step, for example near the yield pressure of the bodies, the
        # curvature at the start of the step makes the step too long.
        if slope_at(length) > -_OVERSHOT * slope_at(0.0):
            length = float(brentq(slope_at, 0.0, length, rtol=_OVERSHOT))
        return length


def _press_further_points(p: Array, distance: Array, yield_pressure: float, load: float) -> None:
    """Bring further points into contact, because all points in contact yield and do not carry the load.

    p : pressures of the points (n,) [Pa]. The array is changed in place, so that its mean becomes `load`.
    distance : distance of each point (n,) from contact [m], apart from a constant.
    """
    missing_load = load * p.size - p.sum()
    separated = np.flatnonzero(p == 0)
    count = math.ceil(missing_load / yield_pressure * (1 - _LOAD_TOLERANCE))
    closest = separated[np.argsort(distance[separated], kind="stable")[:count]]
    p[closest] = missing_load / count


def _scale_to_load(p: Array, is_free: Flags, load: float, changed: Flags) -> None:
    """Scale the pressures of the free points, so that the mean pressure of all points becomes `load`.

    Free points are in contact and do not yield. If there are no free points, or if the points that yield carry more
    than the load, the pressures of all points that the present step has changed are scaled; all others still yield.

    p : pressures of the points (n,) [Pa]. The array is changed in place.
    changed : flags (n,) of the points whose pressures the present step has changed.
    """
    remaining_load = load * p.size - p[~is_free].sum()
    scaled = is_free if is_free.any() and remaining_load > 0 else changed & (p > 0)
    p[scaled] *= (load * p.size - p[~scaled].sum()) / p[scaled].sum()


def _energy_slope(
    p: Array,
    direction: Array,
    distance: Array,
    direction_displacement: Array,
    layer: LayerLaw,
    length: float,
) -> float:
    """Compute the derivative of the elastic energy with respect to the step length, at p + length · direction.

    The gradient of the elastic energy with respect to the pressures is the distance between the smooth bodies minus the
    separation s of the rough layer. The derivative is the scalar product of the gradient and the search direction.

    Parameters
    ----------
    p, direction : array (n,), Pa
        Pressures at the start of the iteration step, and search direction.
    distance, direction_displacement : array (n,), m
        Distance between the smooth bodies at the start of the iteration step, and displacement of the bodies under the
        pressures `direction`.
    layer : callable
        Function that returns the separation s [m] and ds/dp [m/Pa] of the rough layer at pressures (n,) [Pa].
    length : float
        Step length, as a multiple of `direction`.
    """
    separation, _ = layer(p + length * direction)
    return float((distance + length * direction_displacement - separation) @ direction)


def solve_steps(points: ContactPoints, steps: LoadProgramme, layer: RoughLayer) -> Array:
    """Solve the contact of points with a rough layer at all load steps.

    Returns
    -------
    array (3, steps, n)
        Pressure [Pa], separation [m] and opening [m] at each point, see `PointSolution`.
    """
    solutions: dict[tuple[float, float | None], PointSolution] = {}  # by pressure and peak
    loads = {step.pressure for step in steps if step.unloaded_from is None}
    loads |= {step.unloaded_from for step in steps if step.unloaded_from is not None}
    start = np.zeros(points.depth.size)
    not_sunk = np.zeros(points.depth.size)
    for load in sorted(loads):
        solution = points.solve(layer.on_loading, load, start, not_sunk)
        solutions[load, None] = solution
        start = solution.pressure
    for step in steps:
        if step.unloaded_from is not None:
            at_peak = solutions[step.unloaded_from, None]
            start = at_peak.pressure * (step.pressure / step.unloaded_from)
            law = partial(layer.on_unloading, peak=at_peak.pressure)
            solution = points.solve(law, step.pressure, start, at_peak.sunk)
            solutions[step.pressure, step.unloaded_from] = solution
    solution_of_step = [solutions[step.pressure, step.unloaded_from] for step in steps]
    pressure = [solution.pressure for solution in solution_of_step]
    separation = [solution.separation for solution in solution_of_step]
    opening = [solution.opening for solution in solution_of_step]
    return np.array([pressure, separation, opening])  # (field, step, point)
