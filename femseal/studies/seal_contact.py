"""Compute the nominal pressure of all tiles of a seal with a form deviation, from the contact of the whole seal.

The roughness is treated as a layer between two smooth half-spaces. Under the pressure p, the distance between the mean
planes of the rough surfaces is s(p). The function s(p) is computed from the contact of the measured surface, on loading
and on unloading (see `rough_layer`). For a contact point of the seal at the depth h below the highest point of the
form, the equilibrium condition is

    h + K (p − p₀) − δ = s(p),

where K p is the displacement of the half-spaces under the pressures p, p₀ the uniform part of the pressure and δ the
approach of the bodies. For a point without contact, h + K (p − p₀) − δ is larger than s(0). The solution minimises the
energy ½ (p − p₀)·K (p − p₀) + h·p − Σ∫s dp under the given load (see `contact_points`). Where the roughness is nearly
flattened, the solids under the roughness yield at a fixed pressure and are permanently indented. If a form deviation
does not vary along the seal, its contact is solved in plane strain.

The uniform part p₀ of the pressure is the smallest mean pressure of a row of points along the seal. The model neglects
the deformation of the bodies by the uniform part p₀. In this model, a seal without form deviation has a uniform
pressure, as in all other studies. If the deformation by p₀ were included, the same seal would act as a flat punch, with
up to three times the mean pressure at its edges. If the contact band does not reach the edges of the seal, p₀ is 0, and
the contact is computed exactly as for two half-spaces.

The model of a rough layer on smooth bodies follows Greenwood & Tripp, J. Appl. Mech. 34, 1967, 153.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import inf

import numpy as np

from ..base import Array, InputError, Mapper, to_text
from ..contact import HalfSpace
from ..face.cut import Cut
from ..flow.law import cubic_law
from ..scene import Scene
from ..seal.contact_grid import ContactGrid
from ..seal.form import SealForm
from ..seal.tiles import SealTiles
from ..topography.seat import check_form
from .contact_points import ContactPoints, solve_steps
from .rough_layer import HIGHEST_PRESSURE, RoughLayer

#: A tile counts as having the mean pressure of the seal if the pressure of the tile differs by less than this fraction.
#: The fraction is ten times the tolerance of the contact solver.
_SAME_PRESSURE = 1e-4
#: A form counts as constant along the seal if the variation of its height along the seal is less than this fraction of
#: its total height.
_SAME_DEPTH = 1e-9


@dataclass(frozen=True, eq=False)
class SealContact:
    """Pressure and separation over a seal with a form deviation, at every load step.

    Parameters
    ----------
    grid : ContactGrid
        Grid of points over the seal.
    depth : array (n1, n2) or (n1, 1), m
        Depth of each grid point below the highest point of the form. The array has a single column if the form does not
        vary along the seal.
    nominal_pressure : array (steps,), Pa
        Nominal pressure of the whole seal.
    pressure : array (steps, n1, n2), Pa
        Contact pressure at each grid point.
    separation : array (steps, n1, n2), m
        Distance between the mean planes of the rough surfaces at each grid point.
    opening : array (steps, n1, n2), m
        Opening: separation minus the separation at which the rough surfaces just touch; 0 at points in contact.
    """

    grid: ContactGrid
    depth: Array
    nominal_pressure: Array
    pressure: Array
    separation: Array
    opening: Array

    @property
    def row_pressure(self) -> Array:
        """Mean contact pressure of each row of grid points along the seal (steps, n1) [Pa]."""
        return self.pressure.mean(axis=2)

    @property
    def pressure_fractions(self) -> Array:
        """Pressure of each tile divided by the mean pressure of the seal (steps, tiles); 1 at steps without load."""
        tile_pressure = self.grid.means(self.pressure)  # (step, tile)
        nominal = self.nominal_pressure[:, None]
        # A point of the grid may cover several tiles, so that the mean over the tiles differs slightly from the nominal
        # pressure. On a strip or ring, all tiles have equal areas, and the mean over the tiles is taken as the pressure
        # of the seal.
        seal_pressure = nominal
        if self.grid.has_rows:
            seal_pressure = tile_pressure.mean(axis=1, keepdims=True)
        fractions = np.divide(
            tile_pressure, seal_pressure, out=np.ones_like(tile_pressure), where=nominal > 0
        )
        return np.where(np.abs(fractions - 1) < _SAME_PRESSURE, 1.0, fractions)

    @property
    def added_permeability(self) -> Array:
        """Increase of the permeability of each tile due to the opening of the surfaces (steps, tiles) [m³]."""
        return self.grid.means(opening_permeability(self.separation, self.opening))


def solve_seal_contact(
    scene: Scene,
    tiles: SealTiles,
    forms: Sequence[SealForm],
    mapper: Mapper = map,
    layer: RoughLayer | None = None,
) -> SealContact:
    """Solve the contact of a seal with a form deviation at every load step.

    Parameters
    ----------
    scene : Scene
        The rough surface of the seal, and the load.
    tiles : SealTiles
        Tiles of the seal.
    forms : sequence of SealForm
        Form deviations of the seal, whose heights are added.
    mapper : callable
        Function such as the builtin `map`, which computes a stage for many items.
    layer : RoughLayer, optional
        Rough layer of the surface. By default, this function computes it.

    Raises
    ------
    InputError
        The form is too steep for a half-space, or does not cover the seal; or the pressure is higher than the bodies
        can support.
    NotConverged
        A contact solver failed.
    """
    grid, depth = sample_form(scene, tiles, forms)
    d1, d2 = grid.spacing
    # a single column is solved in plane strain, which does not depend on the spacing along the seal
    spacing = d1, d2 if depth.shape[1] > 1 else d1
    body = HalfSpace(depth.shape, spacing, scene.modulus, grid.boundary)
    inside = np.isfinite(depth)
    layer = layer or RoughLayer.of(scene, mapper)
    yield_pressure = float(layer.pressure[-1])
    highest = float(scene.steps.pressures.max())
    if highest >= yield_pressure:
        capacity = to_text(yield_pressure, "Pa", 3)
        expected = f"less than {HIGHEST_PRESSURE:.0%} of what the faces carry, {capacity}: the bodies yield there"
        raise InputError(
            "load", f"{to_text(highest, 'Pa', 3)} on a seal with a form deviation", expected
        )
    # index of the row of each point; a mesh has no rows, so that all points of a mesh count as one row
    rows = np.arange(len(depth))[:, None] if grid.has_rows else np.zeros((1, 1), int)
    row = np.broadcast_to(rows, depth.shape)[inside]
    points = ContactPoints(body, inside, depth[inside], yield_pressure, row)
    fields = np.zeros((3, len(scene.steps), *depth.shape))  # pressure, separation, opening
    fields[..., inside] = solve_steps(points, scene.steps, layer)
    return SealContact(grid, depth, scene.steps.pressures, *fields)


def opening_permeability(separation: Array, opening: Array) -> Array:
    """Return the increase of the permeability where the rough surfaces do not touch [m³].

    Let s be the separation of the mean planes. The opening e is s minus the separation at which the rough surfaces just
    touch. The permeability increases by (s³ − (s − e)³)/12 between first touch and the separation s. The formula is
    accurate for openings much smaller than the roughness and for openings much larger than the roughness.
    """
    return cubic_law(separation) - cubic_law(separation - opening)


def remove_waves_of_forms(scene: Scene, cut: Cut, forms: Sequence[SealForm]) -> Scene:
    """Remove the long waves of the measured surface that the form deviation of the seal already contains.

    The cut-off wavelength of the filter is the larger of two lengths: the shortest wavelength of the forms, and twice
    the longer side of a cell.
    """
    shortest_of_forms = min((form.shortest_wave for form in forms), default=inf)
    cut_off = max(shortest_of_forms, 2 * max(cut.size))
    if cut_off >= 2 * max(scene.surface.shortest_patch.size):
        return scene  # the surface contains no waves that are longer than the cut-off wavelength
    return replace(scene, surface=scene.surface.high_pass(cut_off))


def sample_form(
    scene: Scene, tiles: SealTiles, forms: Sequence[SealForm]
) -> tuple[ContactGrid, Array]:
    """Cover a seal with a grid of points, and compute the depth of each point below the highest point.

    Returns
    -------
    grid : ContactGrid
        The grid of points.
    depth : array (n1, n2) or (n1, 1), m
        Depth of each grid point, NaN outside of the seal. The array has a single column if the form does not vary along
        the seal.

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
    # a form that does not vary along a strip or a ring is sampled again, on more rows and a single column
    if tiles.grid is not None:
        variation_along_seal = np.ptp(heights, axis=1).max()
        if variation_along_seal <= _SAME_DEPTH * np.ptp(heights):
            grid = ContactGrid.over(tiles, frame, profile=True)
            heights = heights_on(grid)[:, :1]
    breadth = to_text(tiles.seal.size[0], "m", 3)
    inside = grid.inside[:, : heights.shape[1]]
    check_form("form", f"a seal {breadth} wide", heights, grid.spacing, inside)
    return grid, np.nanmax(heights) - heights
