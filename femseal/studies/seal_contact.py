"""Solve the contact of a whole seal that has a form: the nominal pressure of its tiles at every step.

The roughness is a layer between two half-spaces. Under the pressure p its mean planes stand s(p) apart. The contact of
the measured surface gives s(p), on loading and on unloading from every peak. Points of the seal that lie h below the
highest one satisfy h + K (p − p₀) − δ = s(p) where they touch, and more than s(0) where they do not. This is the
minimum of ½ (p − p₀)·K (p − p₀) + h·p − Σ∫s dp under the load. Where the roughness is nearly flat, the bodies yield at
one pressure and sink permanently. A form that is the same all along the seal is solved in plane strain.

The uniform part p₀ of the pressure is the part that every row of the seal carries. It does not deform the bodies,
because a seal without form is pressed evenly: the edges of a flat punch, with up to three times the mean pressure, are
no effect of a form. A form of no height therefore leaves the pressure even, and a contact band that does not reach the
edges is that on half-spaces.

Source: Greenwood & Tripp, J. Appl. Mech. 34, 1967, 153 (a rough layer on smooth bodies).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from math import inf
from operator import attrgetter
from typing import Any

import numpy as np
from scipy.optimize import brentq

from ..base import Array, Indices, InputError, Mapper, NotConverged, to_text
from ..contact import HalfSpace, LoadState
from ..contact.convolution import Convolution
from ..face.cells import Cut
from ..flow.law import cubic_law
from ..loads import LoadProgramme, LoadStep
from ..scene import Scene
from ..seal.contact_grid import ContactGrid
from ..seal.form import SealForm
from ..seal.tiles import SealTiles
from ..topography.seat import check_form

#: Pressures at which the layer is solved, in fractions of the highest; numbers of those from which it is unloaded; and
#: the fractions of these peaks at which unloading is known, of which the last, 0, is extrapolated.
_PRESSURES = np.geomspace(1e-3, 1.0, 13)
_PEAKS, _RELEASED = np.array([4, 8, 12]), np.array([1.0, 0.7, 0.4, 0.15, 0.03, 0.0])
#: The layer is solved up to this fraction of what the surface can carry, and there the bodies themselves yield.
_HIGHEST = 0.97
#: Relative change of the pressures at which the iteration has converged; most iterations; and the fraction of the slope
#: of the energy that may be left, with the opposite sign, at the end of a step, which is also the accuracy of a shorter
#: step.
_RTOL, _MOST_ITERATIONS, _OVERSHOT = 1e-5, 5000, 0.1
#: Error of the uniform part of the pressure, over the pressure.
_EVEN_TOLERANCE = 1e-3
#: Relative difference of the pressure of a tile from that of the seal that counts as none: ten times the tolerance.
_SAME_PRESSURE = 1e-4
#: A form counts as the same all along if its depth varies by less than this fraction along the seal.
_SAME = 1e-9


@dataclass(frozen=True, eq=False)
class SealContact:
    """Contact of a seal with a form.

    Parameters
    ----------
    grid : points over the seal.
    depth : of the points below the highest one, array (n1, n2), or (n1, 1) where the form is the same all along, m.
    nominal : pressure of the whole seal, array (steps,), Pa.
    pressure : at the points, array (steps, n1, n2), Pa.
    separation : distance of the mean planes, array (steps, n1, n2), m.
    opening : how far this distance exceeds that of first touch, array (steps, n1, n2), m.
    """

    grid: ContactGrid
    depth: Array
    nominal: Array
    pressure: Array
    separation: Array
    opening: Array

    @property
    def row_pressure(self) -> Array:
        """Mean pressure of the rows of points (steps, n1) [Pa]."""
        return self.pressure.mean(axis=2)

    @property
    def pressure_fractions(self) -> Array:
        """Pressure of the tiles over that of the whole seal (steps, tiles); 1 at steps without pressure."""
        means = self.grid.means(self.pressure)
        nominal = self.nominal[:, None]
        # of tiles of one area a cell may cover several
        whole = means.mean(axis=1, keepdims=True) if self.grid.has_rows else nominal
        fractions = np.divide(means, whole, out=np.ones_like(means), where=nominal > 0)
        return np.where(np.abs(fractions - 1) < _SAME_PRESSURE, 1.0, fractions)

    @property
    def added_permeability(self) -> Array:
        """Permeability of the gap beyond first touch (steps, tiles) [m³]."""
        return self.grid.means(opening_permeability(self.separation, self.opening))


@dataclass(frozen=True, eq=False)
class RoughLayer:
    """Distance s of the mean planes of rough surfaces as a function of the pressure, on loading and on unloading.

    Parameters
    ----------
    pressure : rising from 0 to the highest, array (n,), Pa.
    gap : distance of the mean planes, falling, array (surfaces, n), m.
    peaks : from which it is unloaded, array (m,), Pa; empty where the surfaces are elastic.
    recovered : how far the planes come apart again at the fractions `_RELEASED` of the peaks, array (surfaces, m, k),
        m.
    face : number of the surface at every point, or of all points.
    """

    pressure: Array
    gap: Array
    peaks: Array
    recovered: Array
    face: Indices | int = 0

    @classmethod
    def of(
        cls, scene: Scene, mapper: Mapper, boundary: tuple[str, str] = ("periodic", "periodic")
    ) -> RoughLayer:
        """Solve the contact of the surface of a scene alone under uniform pressures."""
        return cls.from_mean_gaps(
            scene, *solve_layer_states(scene, attrgetter("contact.mean_gap"), mapper, boundary)
        )

    @classmethod
    def from_mean_gaps(
        cls, scene: Scene, programme: LoadProgramme, gaps: Sequence[float]
    ) -> RoughLayer:
        """Make the layer from mean gaps (steps,) [m] of the load programme of `solve_layer_states`."""
        loading, peaks = programme.pressures[programme.on_loading], np.array(programme.unload_from)
        gap, after = np.split(np.array(gaps), [loading.size])
        recovered = np.zeros((peaks.size, _RELEASED.size))
        recovered[:, 1:-1] = (
            after.reshape(peaks.size, _RELEASED.size - 2) - gap[_PEAKS[: peaks.size], None]
        )
        # down to no pressure it goes on by its slope in the logarithm
        last = np.diff(recovered[:, -3:-1]) / np.log(_RELEASED[-3] / _RELEASED[-2])
        recovered[:, -1:] = recovered[:, -2:-1] + last
        apart = scene.surface.heights.max() - scene.surface.heights.mean()
        return cls(np.array([0.0, *loading]), np.array([[apart, *gap]]), peaks, recovered[None])

    def on_loading(self, p: Array) -> tuple[Array, Array]:
        """Evaluate s and ds/dp at pressures (n,) on loading, linear between the solved pressures."""
        part = np.searchsorted(self.pressure, p, side="right") - 1
        part = np.clip(part, 0, self.pressure.size - 2)
        slope = (np.diff(self.gap) / np.diff(self.pressure))[self.face, part]
        return self.gap[self.face, part] + slope * (p - self.pressure[part]), slope

    def on_unloading(self, p: Array, peak: Array) -> tuple[Array, Array]:
        """Evaluate s and ds/dp at pressures (n,) after peaks (n,); above the peaks as on loading."""
        if not self.peaks.size:
            return self.on_loading(p)
        safe = np.maximum(peak, 1e-9 * self.peaks[0])
        at = np.interp(np.log(safe), np.log(self.peaks), np.arange(self.peaks.size))
        lower = np.minimum(at.astype(int), self.peaks.size - 2)
        part = np.searchsorted(-_RELEASED, -p / safe, side="left") - 1
        part = np.clip(part, 0, _RELEASED.size - 2)
        ends = np.array([part, part + 1])
        before, after = (self.recovered[self.face, lower + n, ends] for n in (0, 1))
        from_end, to_end = before + (at - lower) * (after - before)
        slope = (to_end - from_end) / np.diff(_RELEASED)[part] / safe
        start, _ = self.on_loading(peak)
        gap = start + from_end + slope * (p - _RELEASED[part] * safe)
        above = p >= peak
        loaded_gap, loaded_slope = self.on_loading(p)
        return np.where(above, loaded_gap, gap), np.where(above, loaded_slope, slope)


def solve_layer_states(
    scene: Scene,
    take: Callable[[LoadState], Any],
    mapper: Mapper,
    boundary: tuple[str, str] = ("periodic", "periodic"),
) -> tuple[LoadProgramme, list[Any]]:
    """Solve the states of a dry surface alone from light loads to nearly all that it can carry, and on unloading.

    Returns the load programme, and what `take` takes of every state.
    """
    law = scene.law
    loading = _HIGHEST * min(law.capacity, 0.1 * scene.surface_modulus) * _PRESSURES
    unloads = not law.is_elastic and any(step.unloaded_from is not None for step in scene.steps)
    peaks = loading[_PEAKS].tolist() if unloads else []
    down = [LoadStep(p * f, p) for p in peaks for f in _RELEASED[1:-1].tolist()]
    programme = LoadProgramme([*map(LoadStep, loading.tolist()), *down])
    alone = scene.dry(boundary=boundary)
    return programme, list(alone.contact_states(take, steps=programme, mapper=mapper))


def solve_seal_contact(
    scene: Scene,
    tiles: SealTiles,
    forms: Sequence[SealForm],
    mapper: Mapper = map,
    layer: RoughLayer | None = None,
) -> SealContact:
    """Solve the contact of a seal under the sum of forms at every step, with the surface of the scene as its rough
    layer.

    Parameters
    ----------
    scene : the surface and its load.
    tiles : of the seal.
    forms : of the seal; their heights add up.
    mapper : computes the items of a stage.
    layer : of the surface, where it is known already.

    Raises
    ------
    InputError : a form that is too steep for a half-space, or does not cover the seal; more pressure than the bodies
        carry.
    NotConverged : a contact failed.
    """
    grid, depth = sample_form(scene, tiles, forms)
    d1, d2 = grid.spacing
    spacing = d1, d2 if depth.shape[1] > 1 else d1
    body = HalfSpace(depth.shape, spacing, scene.modulus, grid.boundary)
    inside = np.isfinite(depth)
    layer = layer or RoughLayer.of(scene, mapper)
    most = float(layer.pressure[-1])
    highest = float(scene.steps.pressures.max())
    if highest >= most:
        expected = f"less than {_HIGHEST:.0%} of what the faces carry, {to_text(most, 'Pa', 3)}: the bodies yield there"
        raise InputError("load", f"{to_text(highest, 'Pa', 3)} on a seal with a form", expected)
    # a mesh has no rows: all of it counts as one
    rows = np.arange(len(depth))[:, None] if grid.has_rows else np.zeros((1, 1), int)
    row = np.broadcast_to(rows, depth.shape)[inside]
    cells = ContactPoints(body, inside, depth[inside], most, row)
    fields = np.zeros((3, len(scene.steps), *depth.shape))
    fields[..., inside] = solve_steps(cells, scene.steps, layer)
    return SealContact(grid, depth, scene.steps.pressures, *fields)


def solve_steps(cells: ContactPoints, steps: LoadProgramme, layer: RoughLayer) -> Array:
    """Solve points with their layer at all steps.

    Returns pressures [Pa], separations and openings [m], an array (3, steps, n).
    """
    solutions: dict[tuple[float, float | None], tuple[Array, Array, Array, Array]] = {}
    pressure = np.zeros(cells.depth.size)
    unsunk = np.zeros(cells.depth.size)
    loads = {step.pressure for step in steps if step.unloaded_from is None}
    loads |= {step.unloaded_from for step in steps if step.unloaded_from is not None}
    for load in sorted(loads):
        solutions[load, None] = cells.solve(layer.on_loading, load, pressure, unsunk)
        pressure = solutions[load, None][0]
    for step in steps:
        if step.unloaded_from is not None:
            at_peak, _, _, sunk = solutions[step.unloaded_from, None]
            start = at_peak * (step.pressure / step.unloaded_from)
            law = partial(layer.on_unloading, peak=at_peak)
            solution = cells.solve(law, step.pressure, start, sunk)
            solutions[step.pressure, step.unloaded_from] = solution
    of_steps = [solutions[step.pressure, step.unloaded_from][:3] for step in steps]
    return np.array(of_steps).swapaxes(0, 1)


def opening_permeability(separation: Array, opening: Array) -> Array:
    """Return the permeability [m³] that an opening e adds to a gap of s between mean planes, (s³ − (s − e)³)/12.

    It is right for a small opening, and for one that is large compared with the roughness.
    """
    return cubic_law(separation) - cubic_law(separation - opening)


def remove_waves_of_forms(scene: Scene, cut: Cut, forms: Sequence[SealForm]) -> Scene:
    """Remove the waves from the surface of a scene that the forms of the seal have too: those longer than two tiles."""
    shortest = max(min((form.shortest_wave for form in forms), default=inf), 2 * max(cut.size))
    if shortest >= 2 * max(scene.surface.shortest_patch.size):
        return scene
    return replace(scene, surface=scene.surface.high_pass(shortest))


def sample_form(
    scene: Scene, tiles: SealTiles, forms: Sequence[SealForm]
) -> tuple[ContactGrid, Array]:
    """Lay points over the seal, and find how deep they lie below the highest one.

    Returns the points, and the depths (n1, n2) [m], (n1, 1) if the form is the same all along; NaN outside of the seal.

    Raises InputError: a form that is too steep for a half-space, or does not cover the seal.
    """
    frame = scene.layout.frame(tiles.seal.size)

    def heights_on(grid: ContactGrid) -> Array:
        heights = np.full(grid.tile.shape, np.nan)
        points = grid.points[grid.inside]
        heights[grid.inside] = sum(form.heights(points, frame) for form in forms)
        return heights

    grid = ContactGrid.over(tiles, frame)
    heights = heights_on(grid)
    if tiles.grid is not None and np.ptp(heights, axis=1).max() <= _SAME * np.ptp(heights):
        grid = ContactGrid.over(tiles, frame, profile=True)
        heights = heights_on(grid)[:, :1]
    breadth = to_text(tiles.seal.size[0], "m", 3)
    check_form(
        "form", f"a seal {breadth} broad", heights, grid.spacing, grid.inside[:, : heights.shape[1]]
    )
    return grid, np.nanmax(heights) - heights


class ContactPoints:
    """Points that may touch, on a body that yields at a given pressure.

    Parameters
    ----------
    body : elastic half-space.
    inside : whether a point of the half-space belongs to the seal.
    depth : of the points below the highest one, array (n,), m.
    most : pressure at which the body yields, Pa.
    row : row number of every point, array (n,). The uniform part of the pressure of all rows does not deform the body.
        None where all of the pressure deforms it.
    """

    def __init__(
        self,
        body: HalfSpace,
        inside: Array,
        depth: Array,
        most: float,
        row: Indices | None = None,
    ) -> None:
        self.depth = depth
        self._inside = inside
        self._most = most
        self._row = row
        self._product = Convolution(body.shape, body.boundary, body.symbol())
        single = np.zeros(body.shape)
        middle = body.shape[0] // 2, body.shape[1] // 2
        single[middle] = 1.0
        around = body.displacement(single)
        # displacement of a point by its own pressure, beyond the farthest point: the level of plane strain is arbitrary
        self._own = float(around[middle] - around.min())
        self._even = self.displacement(np.ones(depth.size))

    def displacement(self, p: Array) -> Array:
        """Compute the displacement of the points (n,) [m] under their pressures (n,) [Pa]."""
        self._product.pressure[self._inside] = p
        self._product.apply()
        return self._product.displacement[self._inside]

    def solve(
        self, layer: Callable[[Array], tuple[Array, Array]], load: float, start: Array, sunk: Array
    ) -> tuple[Array, Array, Array, Array]:
        """Solve the points under a mean pressure.

        The uniform part of the pressure is as large as the least mean pressure of a row.

        Parameters
        ----------
        layer : evaluates s and ds/dp at pressures.
        load : mean pressure, Pa.
        start : pressures near the solution, array (n,), Pa.
        sunk : permanent depths of the points, array (n,), m.

        Returns pressures [Pa], separations, openings and permanent depths [m], arrays (n,).
        """
        if self._row is None or load == 0:
            return self.solve_under_uneven_part(0.0, layer, load, start, sunk)
        row, cells_of_row = self._row, np.bincount(self._row)
        solutions: dict[float, tuple[Array, Array, Array, Array]] = {}

        def least_beyond(part: float) -> float:
            """Return the least mean pressure of a row beyond the uniform part of the load, over the load."""
            nearest = min(solutions, key=lambda other: abs(other - part), default=None)
            near = start if nearest is None else solutions[nearest][0]
            solutions[part] = self.solve_under_uneven_part(part * load, layer, load, near, sunk)
            rows = np.bincount(row, solutions[part][0]) / cells_of_row
            return float(rows.min()) / load - part

        part = 1.0
        if least_beyond(1.0) < -_EVEN_TOLERANCE:
            part = 0.0
            if least_beyond(0.0) > _EVEN_TOLERANCE:
                part = brentq(least_beyond, 0.0, 1.0, xtol=_EVEN_TOLERANCE)
        return solutions[part]

    def solve_under_uneven_part(
        self,
        even: float,
        layer: Callable[[Array], tuple[Array, Array]],
        load: float,
        start: Array,
        sunk: Array,
    ) -> tuple[Array, Array, Array, Array]:
        """Solve the points under a mean pressure of which an even part [Pa] does not deform the body, see `solved`.

        The method is conjugate gradients of the points that touch and do not yield, under a fixed load (Polonsky &
        Keer, Wear 231, 1999, 206). The preconditioner is the compliance of each point and of its layer.
        """
        n = self.depth.size
        depth = self.depth + sunk - even * self._even
        at_touch, most = layer(np.zeros(n))[0], self._most
        if load == 0:
            opening = depth - at_touch - float((depth - at_touch).min())
            return np.zeros(n), at_touch + opening, opening, sunk
        p = np.minimum(start * (load / start.mean()), most) if start.any() else np.full(n, load)
        direction, former = np.zeros(n), 0.0
        for _ in range(_MOST_ITERATIONS):
            gap, slope = layer(p)
            weight = 1 / (self._own - slope)
            residual = depth + self.displacement(p) - gap
            free = (p > 0) & (p < most)
            free = free if free.any() else p > 0
            residual -= weight[free] @ residual[free] / weight[free].sum()
            wanted = -weight * residual
            freed = ((p == 0) & (residual + gap < at_touch)) | ((p == most) & (wanted < 0))
            change = float(np.abs(wanted[free | freed]).max()) / load
            if change <= _RTOL:
                opening = np.where(p > 0, 0.0, np.maximum(residual + gap - at_touch, 0.0))
                deeper = np.where(p == most, np.maximum(-residual, 0.0), 0.0)
                return p, np.where(p > 0, gap, at_touch + opening), opening, sunk + deeper
            wanted[~free] = 0.0
            power = -float(residual @ wanted)
            direction = wanted + (power / former if former else 0.0) * np.where(
                free, direction, 0.0
            )
            image = self.displacement(direction)
            power_at = partial(_power, p, direction, residual + gap, image, layer)
            length = -float(residual @ direction) / float((image - slope * direction) @ direction)
            # where the stiffness of the layer rises, as where the bodies yield, its tangent makes the step too long
            if power_at(length) > -_OVERSHOT * power_at(0.0):
                length = float(brentq(power_at, 0.0, length, rtol=_OVERSHOT))
            p = np.clip(p + length * direction, 0.0, most)
            p[freed] = np.clip(p[freed] - length * weight[freed] * residual[freed], 0.0, most)
            inside = (p > 0) & (p < most)
            scaled = inside if inside.any() else p > 0
            p[scaled] *= max(0.0, load * n - p[~scaled].sum()) / p[scaled].sum()
            p = np.minimum(p, most)
            former = 0.0 if freed.any() or (inside != free).any() else power
        text = f"contact of the seal with its form: the pressure of its cells still changes by {change:.1e}"
        raise NotConverged(text, change)


def _power(
    p: Array, direction: Array, above: Array, image: Array, layer: Any, length: float
) -> float:
    """Compute the slope of the energy at a length along a direction: what lies above the layer times the direction."""
    return float((above + length * image - layer(p + length * direction)[0]) @ direction)
