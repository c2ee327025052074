"""Solve the contact of a whole seal that has a form: the nominal pressure of its tiles at every step.

The roughness is treated as a layer between two smooth half-spaces. Under the pressure p, the mean planes of the rough
surfaces are at the distance s(p) from each other. The contact of the measured surface gives s(p), on loading and on
unloading from every peak (`rough_layer`). Consider a point of the seal that lies h below the highest point. If this
point is in contact, it satisfies

    h + K (p − p₀) − δ = s(p),

where K p is the displacement of the half-spaces under the pressures p, p₀ the uniform part of the pressure and δ the
approach of the bodies. If the point is not in contact, the left side is larger than s(0). The solution minimises
½ (p − p₀)·K (p − p₀) + h·p − Σ∫s dp under the given load (`contact_points`). Where the roughness is nearly flattened,
the bodies themselves yield at a fixed pressure and are permanently indented. A form that does not vary along the seal
is solved in plane strain.

The uniform part p₀ is the pressure that every row of the seal carries. In this model, it does not deform the bodies.
Otherwise, a seal without form would be a flat punch, whose pressure at the edges is up to three times the mean; but
such a seal is assumed to be pressed evenly. With the uniform part left out of the deformation, the pressure is uniform
if the form has zero height. If the contact band does not reach the edges of the seal, p₀ is 0, and the solution is that
of two half-spaces.

Source: Greenwood & Tripp, J. Appl. Mech. 34, 1967, 153 (a rough layer on smooth bodies).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import inf

import numpy as np

from ..base import Array, InputError, Mapper, to_text
from ..contact import HalfSpace
from ..face.cells import Cut
from ..flow.law import cubic_law
from ..scene import Scene
from ..seal.contact_grid import ContactGrid
from ..seal.form import SealForm
from ..seal.tiles import SealTiles
from ..topography.seat import check_form
from .contact_points import ContactPoints, solve_steps
from .rough_layer import HIGHEST_PRESSURE, RoughLayer

#: A tile counts as having the mean pressure of the seal if its pressure differs by less than this fraction. It is ten
#: times the tolerance of the contact.
_SAME_PRESSURE = 1e-4
#: A form counts as constant along the seal if its depth varies by less than this fraction there.
_SAME_DEPTH = 1e-9


@dataclass(frozen=True, eq=False)
class SealContact:
    """Hold the contact of a seal with a form at every load step.

    Parameters
    ----------
    grid : ContactGrid
        Points over the seal.
    depth : array (n1, n2) or (n1, 1), m
        Depth of each point below the highest point. There is a single column if the form does not vary along the seal.
    nominal : array (steps,), Pa
        Nominal pressure of the whole seal.
    pressure : array (steps, n1, n2), Pa
        Pressure of each point.
    separation : array (steps, n1, n2), m
        Distance between the mean planes of the rough surfaces.
    opening : array (steps, n1, n2), m
        How much larger the separation is than at first touch; 0 for points in contact.
    """

    grid: ContactGrid
    depth: Array
    nominal: Array
    pressure: Array
    separation: Array
    opening: Array

    @property
    def row_pressure(self) -> Array:
        """Mean pressure of each row of points (steps, n1) [Pa]."""
        return self.pressure.mean(axis=2)

    @property
    def pressure_fractions(self) -> Array:
        """Pressure of each tile divided by the pressure of the seal (steps, tiles); 1 at steps without load."""
        tile_pressure = self.grid.means(self.pressure)  # (step, tile)
        nominal = self.nominal[:, None]
        # A point of the grid may cover several tiles, so that the mean over the tiles differs slightly from the nominal
        # pressure. On a strip or ring, all tiles have equal areas, and this mean is taken as the pressure of the seal.
        seal_pressure = nominal
        if self.grid.has_rows:
            seal_pressure = tile_pressure.mean(axis=1, keepdims=True)
        fractions = np.divide(
            tile_pressure, seal_pressure, out=np.ones_like(tile_pressure), where=nominal > 0
        )
        return np.where(np.abs(fractions - 1) < _SAME_PRESSURE, 1.0, fractions)

    @property
    def added_permeability(self) -> Array:
        """Permeability that the opening beyond first touch adds to each tile (steps, tiles) [m³]."""
        return self.grid.means(opening_permeability(self.separation, self.opening))


def solve_seal_contact(
    scene: Scene,
    tiles: SealTiles,
    forms: Sequence[SealForm],
    mapper: Mapper = map,
    layer: RoughLayer | None = None,
) -> SealContact:
    """Solve the contact of a seal with a form at every load step.

    Parameters
    ----------
    scene : Scene
        The surface, which is the rough layer of the seal, and its load.
    tiles : SealTiles
        Tiles of the seal.
    forms : sequence of SealForm
        Forms of the seal, whose heights are added.
    mapper : callable
        Computes the items of a stage.
    layer : RoughLayer, optional
        Rough layer of the surface. By default, it is solved here.

    Raises
    ------
    InputError
        The form is too steep for a half-space, or does not cover the seal; or the pressure is higher than the bodies
        can carry.
    NotConverged
        A contact solver failed.
    """
    grid, depth = sample_form(scene, tiles, forms)
    d1, d2 = grid.spacing
    spacing = d1, d2 if depth.shape[1] > 1 else d1
    body = HalfSpace(depth.shape, spacing, scene.modulus, grid.boundary)
    inside = np.isfinite(depth)
    layer = layer or RoughLayer.of(scene, mapper)
    yield_pressure = float(layer.pressure[-1])
    highest = float(scene.steps.pressures.max())
    if highest >= yield_pressure:
        capacity = to_text(yield_pressure, "Pa", 3)
        expected = f"less than {HIGHEST_PRESSURE:.0%} of what the faces carry, {capacity}: the bodies yield there"
        raise InputError("load", f"{to_text(highest, 'Pa', 3)} on a seal with a form", expected)
    # number of the row of each point; a mesh has no rows, so that all of it counts as one row
    rows = np.arange(len(depth))[:, None] if grid.has_rows else np.zeros((1, 1), int)
    row = np.broadcast_to(rows, depth.shape)[inside]
    points = ContactPoints(body, inside, depth[inside], yield_pressure, row)
    fields = np.zeros((3, len(scene.steps), *depth.shape))  # pressure, separation, opening
    fields[..., inside] = solve_steps(points, scene.steps, layer)
    return SealContact(grid, depth, scene.steps.pressures, *fields)


def opening_permeability(separation: Array, opening: Array) -> Array:
    """Return how much the permeability increases if the surfaces are moved apart beyond first touch [m³].

    With the separation s of the mean planes and the opening e beyond first touch, it increases by (s³ − (s − e)³)/12.
    This is accurate if the opening is either small, or large compared with the roughness.
    """
    return cubic_law(separation) - cubic_law(separation - opening)


def remove_waves_of_forms(scene: Scene, cut: Cut, forms: Sequence[SealForm]) -> Scene:
    """Remove the long waves of the measured surface that the forms of the seal already contain.

    A wave is removed if it is longer than both the shortest wave of the forms and two tiles.
    """
    shortest = max(min((form.shortest_wave for form in forms), default=inf), 2 * max(cut.size))
    if shortest >= 2 * max(scene.surface.shortest_patch.size):
        return scene
    return replace(scene, surface=scene.surface.high_pass(shortest))


def sample_form(
    scene: Scene, tiles: SealTiles, forms: Sequence[SealForm]
) -> tuple[ContactGrid, Array]:
    """Cover a seal with a grid of points, and compute the depth of each point below the highest point.

    Returns
    -------
    grid : ContactGrid
        The points.
    depth : array (n1, n2) or (n1, 1), m
        Depths, NaN outside of the seal. There is a single column if the form does not vary along the seal.

    Raises
    ------
    InputError
        The form is too steep for a half-space, or does not cover the seal.
    """
    frame = scene.layout.frame(tiles.seal.size)

    def heights_on(grid: ContactGrid) -> Array:
        heights = np.full(grid.tile.shape, np.nan)
        points = grid.points[grid.inside]
        heights[grid.inside] = sum(form.heights(points, frame) for form in forms)
        return heights

    grid = ContactGrid.over(tiles, frame)
    heights = heights_on(grid)
    if tiles.grid is not None:  # a strip or a ring
        variation_along_seal = np.ptp(heights, axis=1).max()
        if variation_along_seal <= _SAME_DEPTH * np.ptp(heights):
            grid = ContactGrid.over(tiles, frame, profile=True)
            heights = heights_on(grid)[:, :1]
    breadth = to_text(tiles.seal.size[0], "m", 3)
    inside = grid.inside[:, : heights.shape[1]]
    check_form("form", f"a seal {breadth} broad", heights, grid.spacing, inside)
    return grid, np.nanmax(heights) - heights
