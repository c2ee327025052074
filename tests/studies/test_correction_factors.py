"""The correction factor of each axis: what leaks along a cell's k2 has its own, and periodic surfaces leak exactly."""

from functools import cache

import numpy as np
import pytest
from mesh_files import write_gmsh
from numpy.testing import assert_allclose
from skfem import MeshTri
from small_cases import E, steel_scene

from femseal.contact import solve_contact
from femseal.face.cell_flow import permeability_along_x2
from femseal.face.cut import Cut
from femseal.flow import cell_permeability
from femseal.loads import LoadProgramme, LoadStep
from femseal.seal import AnnularLayout, MeshLayout, RectangularLayout
from femseal.studies import Sampling, cell_states, stochastic, two_scale
from femseal.studies.cell_states import solve_cells_at_pressures
from femseal.topography import Patches, Topography, self_affine

D = 1e-6
PERIODIC = ("periodic", "periodic")
VISCOSITY = 1e-3


def scene(surface, **changed):
    usual = {"loading": (2e8,), "unload_from": (), "unloading": (), "boundary": PERIODIC}
    return steel_scene(**(usual | {"surface": surface, "fluid_pressure": "ignored"} | changed))


def turned(n=64, rng=1, depth=0.5e-6):
    """A rough surface with grooves along x2."""
    rough = self_affine(
        (n, n), (n * D, n * D), hurst=0.8, rms_height=0.15e-6, cut_off=8 * D, rng=rng
    )
    x1 = (np.arange(n) + 0.5) * D
    grooves = depth * np.cos(2 * np.pi * x1 / (16 * D))
    return Topography(rough.heights + grooves[:, None], (D, D), (True, True))


def transposed(surface):
    return Topography(np.ascontiguousarray(surface.heights.T), (D, D), (True, True))


@cache
def identical_cells(phase=(0.1, 0.4), depth2=0.5):
    """A surface of 4 × 4 equal periods that are not symmetric about their sides."""
    x = (np.arange(64) + 0.5) / 16
    z1 = np.cos(2 * np.pi * (x + phase[0])) + 0.3 * np.cos(4 * np.pi * x)
    z2 = np.cos(2 * np.pi * (x + phase[1])) + 0.3 * np.sin(4 * np.pi * x)
    return Topography(0.1e-6 * (z1[:, None] + depth2 * z2), (D, D), (True, True))


def gap_of(one):
    heights = one.surface.heights
    contact = solve_contact(
        heights.max() - heights, one.half_space, pressure=one.loading[0], hardness=one.hardness
    )
    return contact.gap


def test_turned_by_a_right_angle_both_axes_of_a_surface_change_place():
    surface, loads = turned(), LoadProgramme([LoadStep(p) for p in (1e8, 5e8, 9e8)])
    along, across = (
        solve_cells_at_pressures(scene(top), Cut.of(top, (4, 4)), loads, map)
        for top in (surface, transposed(surface))
    )
    assert_allclose(along.corrected_k[:, 1], across.corrected_k[:, 0].swapaxes(-1, -2), rtol=1e-3)
    assert_allclose(along.factor_k2, across.factor, rtol=1e-3)
    assert np.abs(np.log(along.factor_k2 / along.factor)).max() > 0.05


def test_a_surface_that_is_closed_along_x1_leaks_along_x2_what_it_leaks():
    """A wall across the flow along x1 makes that factor run to its limit; along x2 it is a groove beside another."""
    surface = turned(depth=2e-6)
    one = scene(surface, loading=(8e8,))
    cells = solve_cells_at_pressures(one, Cut.of(surface, (4, 4)), one.steps, map)
    assert cells.surface_leakage[0] == 0
    gap = gap_of(one)
    whole = cell_permeability(gap, (D, D), axis=1, sides="periodic").value
    assert_allclose(cells.surface_k2, whole, rtol=1e-3)
    assert_allclose(cells.factor_k2 * cells.cells_k2, whole, rtol=1e-3)
    assert_allclose(cells.factor_k2, 1, atol=0.1)


def rectangle(folder, size):
    """A rectangle of triangles [m] with inlet and outlet at its ends along x1."""
    mesh = MeshTri.init_tensor(np.linspace(0, size[0], 7), np.linspace(0, size[1], 9))
    path = folder / "rectangle.msh"
    x1 = mesh.p[0][mesh.facets]
    inlet, outlet = (np.flatnonzero(np.isclose(x1, end).all(axis=0)) for end in (0, size[0]))
    write_gmsh(path, mesh, inlet=inlet, outlet=outlet)
    return path


@pytest.mark.parametrize("cells", [(2, 2), (4, 4)])
def test_surfaces_of_identical_periods_leak_what_one_leaks_in_every_direction(cells, tmp_path):
    surface = identical_cells()
    gap = gap_of(scene(surface))
    k1, k2 = (cell_permeability(gap, (D, D), axis=a, sides="periodic").value for a in (0, 1))
    assert k2 > 1.5 * k1 > 0
    side, drop = surface.size[0], 1e6 / VISCOSITY
    inner, outer = 1e-3, 1e-3 + 3 * side
    logarithm = (outer - inner) / np.log(outer / inner) / ((inner + outer) / 2)
    path = rectangle(tmp_path, (3 * side, 4 * side))

    def leakage(layout, length=None, breadth=None):
        sampling = Sampling(length, 2, seed=1, breadth=breadth)
        return stochastic(scene(surface, layout=layout), cells, sampling).leakage

    for layout, k in ((RectangularLayout(), k1), (RectangularLayout(lay="x1"), k2)):
        expected = k * drop / (3 * side)
        assert_allclose(leakage(layout, 5 * side, 3 * side), expected, rtol=1e-5)
    for lay, k in (("circumferential", k1), ("radial", k2)):
        expected = k * drop / (outer - inner) * logarithm
        assert_allclose(leakage(AnnularLayout(inner, outer, lay=lay)), expected, rtol=1e-5)
    for lay, k in (("x2", k1), ("x1", k2)):
        found = leakage(MeshLayout(path, "m", "inlet", "outlet", lay=lay))
        assert_allclose(found, k * drop / (3 * side), rtol=1e-5)


def test_leakage_along_grooves_is_that_of_their_mean_cube():
    """Also of the whole pitches of a spiral, whose flow follows the grooves (Westergaard, elastic, p = 0.5 p*)."""
    n, pitch, half = 256, 64, 0.4e-6
    x1 = (np.arange(n) + 0.5) * D
    surface = Topography(
        np.repeat(half * np.cos(2 * np.pi * (x1 / (pitch * D) + 0.3))[:, None], 64, axis=1),
        (D, D),
        (True, True),
    )
    load = 0.5 * np.pi * E * half / (pitch * D)
    one = scene(surface, hardness=np.inf, loading=(load,), rtol=1e-8)
    exact = 3.534788e-3 * (2 * half) ** 3 / 12
    cells = solve_cells_at_pressures(one, Cut.of(surface, (4, 1)), one.steps, map)
    assert_allclose(cells.corrected_k[0, 1], (gap_of(one) ** 3).mean() / 12, rtol=1e-6)
    assert_allclose(cells.k[0, 1], (gap_of(one) ** 3).mean() / 12, rtol=1e-6)
    assert_allclose(cells.k2, exact, rtol=0.02)
    inner, outer = 2e-3, 2e-3 + n * D
    spiral = AnnularLayout(inner, outer, lay={"kind": "spiral", "lead": pitch * D})
    found = stochastic(
        scene(surface, hardness=np.inf, loading=(load,), layout=spiral),
        (4, 1),
        Sampling(None, 2, seed=1),
    )
    r = np.linspace(inner, outer, 4001)
    square = (pitch * D / (2 * np.pi * r)) ** 2
    k2 = (gap_of(one) ** 3).mean() / 12
    resistance = np.trapezoid((1 + square) / (2 * np.pi * r * k2 * square), r)
    expected = 1e6 / VISCOSITY / resistance / (np.pi * (inner + outer))
    assert_allclose(found.leakage[:, 0], expected, rtol=3e-3)


def test_patches_leak_along_x2_each_by_itself():
    """A patch and its mirror image leak alike; next to a closed one a patch leaks half."""
    first = turned()
    image = Topography(np.ascontiguousarray(first.heights[:, ::-1]), (D, D), (True, True))
    alone, both = (
        solve_cells_at_pressures(scene(top), Cut.of(top, cells), scene(top).steps, map)
        for top, cells in ((first, (4, 4)), (Patches([first, image]), (4, 8)))
    )
    for name in ("surface_k2", "cells_k2", "factor_k2", "factor"):
        assert_allclose(getattr(both, name), getattr(alone, name), rtol=1e-3, err_msg=name)
    gap = np.concatenate([np.full((32, 32), 1e-6), np.zeros((32, 64))], axis=1)
    found = permeability_along_x2(gap, (32, 64), (D, D), scene(first).flow, "periodic")
    assert_allclose(found, 1e-18 / 12 / 3, rtol=1e-9)


def test_the_flow_along_x2_is_not_solved_where_cells_stay_in_order(monkeypatch):
    monkeypatch.setattr(cell_states, "permeability_along_x2", None)
    one = scene(turned(32))
    assert np.isnan(two_scale(one, (2, 2)).cells.surface_k2).all()
    drawn = stochastic(one, (2, 2), Sampling(2e-4, 2, seed=1))
    assert drawn.tiles.in_order
    assert (drawn.leakage > 0).all()
    assert_allclose(drawn.cells.factor_k2, 1)
