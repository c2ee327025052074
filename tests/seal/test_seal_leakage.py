"""Leakage of seals: closed forms, percolation, bounds, fluids, and bad input."""

from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from skfem import MeshTri, MeshTri2

from femseal.analytic import annulus_rate
from femseal.base import InputError
from femseal.fluids import Liquid
from femseal.gases import IdealGas
from femseal.scene import Scene
from femseal.seal import (
    AnnularLayout,
    AnnularSeal,
    MeshLayout,
    MeshSeal,
    RectangularLayout,
    RectangularSeal,
    seal_leakage,
)
from femseal.seal.tiles import CellSize

MESHES = Path(__file__).parents[2] / "meshes"
RING = MESHES / "ring.msh"
WATER = Liquid(1e-3)
AIR = IdealGas(18e-6, 0.029, 293.0)
STRIP = RectangularSeal((3e-3, 8e-3), (6, 10))


def random_elements(cells, sd, closed=0.0, seed=0):
    """Log-normal permeability (n1, n2, 2) of the elements, a fraction of which is closed."""
    rng = np.random.default_rng(seed)
    k = 1e-18 * np.exp(sd * rng.standard_normal((*cells, 2)))
    return k * (rng.random((*cells, 1)) >= closed)


# --- strips and rings ---


@pytest.mark.parametrize("cells", [(1, 1), (1, 4), (4, 1), (2, 2), (6, 10)])
def test_uniform_rectangle_is_exact(cells):
    seal = RectangularSeal((3e-3, 8e-3), cells)
    leak = seal_leakage(seal, 2e-18, WATER, inlet_pressure=5e6, outlet_pressure=1e6, bounds=True)
    exact = 2e-18 / 1e-3 * 4e6 * 8 / 3
    assert_allclose([leak.volume_rate, leak.lower, leak.upper], exact, rtol=1e-12)
    assert_allclose(leak.per_length, exact / 8e-3, rtol=1e-12)
    assert_allclose(leak.mass_rate, 1000 * exact, rtol=1e-12)
    assert_allclose(leak.conductance, 2e-18 * 8 / 3, rtol=1e-12)
    assert leak.percolates
    expected = 5e6 - 4e6 * seal.points[..., 0] / 3e-3
    assert_allclose(leak.fluid_pressure, expected, rtol=1e-12)
    columns = np.arange(cells[1]) * 8e-3 / cells[1]
    assert_allclose(seal.points[..., 1], np.tile(columns, (cells[0] + 1, 1)))


@pytest.mark.parametrize("inlet", ["inner", "outer"])
@pytest.mark.parametrize("cells", [(1, 1), (3, 5), (8, 40)])
def test_a_ring_is_exact_for_constant_permeability(inlet, cells):
    ring = AnnularSeal(10e-3, 15e-3, cells, inlet)
    leak = seal_leakage(ring, 1e-18, WATER, inlet_pressure=1e6, bounds=True)
    exact = annulus_rate(1e-18, 1e6, 1e-3, 10e-3, 15e-3)
    assert_allclose([leak.lower, leak.volume_rate, leak.upper], exact, rtol=1e-12)
    r = np.hypot(*np.moveaxis(ring.points, -1, 0))
    share = np.log(15e-3 / r) / np.log(1.5)
    share = share if inlet == "inner" else 1 - share
    assert_allclose(leak.fluid_pressure, 1e6 * share, atol=1e-6)
    assert_allclose(ring.length, 2 * np.pi * 12.5e-3)


def test_an_uneven_ring_is_its_conformal_image_with_order_two():
    """(r, θ) → (ln r, θ) keeps the conductance of any isotropic k; here the flow runs round the ring too."""

    def k(r, θ):
        return np.exp(np.cos(θ) + 2 * np.sin(9 * r - 4 * θ))

    def rates(n, around=1.0):
        cells = (n, 8 * n)
        ring = AnnularSeal(1.0, 1.5, cells)
        image = RectangularSeal((np.log(1.5), 2 * np.pi), cells)
        θ = (np.arange(8 * n) + 0.5) * 2 * np.pi / (8 * n)
        found = []
        for seal, radii in ((ring, ring.radii), (image, np.exp(image.points[:, 0, 0]))):
            values = k((radii[:-1] + radii[1:])[:, None] / 2, θ)
            axes = np.stack([values, around * values], axis=-1)
            found.append(seal.flow(axes).conductance)
        return np.array(found)

    coarse, middle, fine = (rates(n) for n in (16, 32, 64))
    assert_allclose(np.log2((coarse - middle) / (middle - fine)), 2, atol=0.1)
    ring, image = fine + (fine - middle) / 3
    assert_allclose(ring, image, rtol=1e-4)
    assert rates(16, around=0.01)[0] < 0.95 * ring  # so the flow around the ring is put to the test


def test_swapping_the_inlet_of_a_ring_mirrors_the_rows():
    k = random_elements((5, 8), 2.0)
    inner, outer = (AnnularSeal(1.0, 1.6, (5, 8), inlet) for inlet in ("inner", "outer"))
    a, b = inner.flow(k, bounds=True), outer.flow(k[::-1], bounds=True)
    assert_allclose([a.conductance, a.lower], [b.conductance, b.lower], rtol=1e-12)
    assert_allclose(a.potential, 1 - b.potential[::-1], atol=1e-12)
    assert_allclose(inner.points, outer.points[::-1])


@pytest.mark.parametrize("seal", [STRIP, AnnularSeal(1e-3, 2e-3, (6, 10))])
def test_closed_is_exactly_zero(seal):
    k = random_elements((6, 10), 1.0)
    ends = {"inlet_pressure": 1e6, "outlet_pressure": 1e5, "bounds": True}
    k[[3, 5]] = 0  # an open row between two closed rows
    leak = seal_leakage(seal, k, WATER, **ends)
    rates = leak.volume_rate, leak.mass_rate, leak.per_length, leak.lower, leak.upper
    assert not any(rates)
    assert not leak.percolates
    expected = np.repeat([[1e6], [np.nan], [1e5]], [4, 2, 1], axis=0) * np.ones((1, 10))
    assert_allclose(leak.fluid_pressure, expected, rtol=1e-14)
    k[5], k[3, 4] = 1e-18, 1e-30
    leak = seal_leakage(seal, k, WATER, **ends)
    assert leak.percolates
    assert 0 < leak.lower <= leak.volume_rate <= leak.upper
    assert_allclose(leak.lower, leak.upper, rtol=1e-9)


# --- fluids ---


@pytest.mark.parametrize("fluid", [WATER, AIR, Liquid(0.05, 870.0, 20e-9)])
@pytest.mark.parametrize(
    "seal", [STRIP, AnnularSeal(1e-3, 2e-3, (6, 10)), MeshSeal(RING, "inlet", "outlet")]
)
def test_reversed_pressures_reverse_the_leakage(seal, fluid):
    there, back = (
        seal_leakage(seal, 1e-18, fluid, inlet_pressure=a, outlet_pressure=b, bounds=True)
        for a, b in ((3e6, 1e5), (1e5, 3e6))
    )
    assert there.volume_rate > 0
    assert_allclose(back.volume_rate, -there.volume_rate, rtol=1e-12)
    assert_allclose([back.lower, back.upper], [-there.upper, -there.lower], rtol=1e-12)
    for leak in (there, back):
        assert leak.lower <= leak.volume_rate <= leak.upper
        p = leak.fluid_pressure
        assert_allclose([p.min(), p.max()], [1e5, 3e6], rtol=1e-9)


def test_gas_and_liquid():
    """The same conductance; mass rate M(p_i² − p_o²)/(2RTη)·C; the pressure squared falls linearly."""
    gas, liquid = (
        seal_leakage(STRIP, 1e-18, f, inlet_pressure=4e5, outlet_pressure=1e5) for f in (AIR, WATER)
    )
    assert gas.conductance == liquid.conductance
    mean_density = 2.5e5 * 0.029 / (8.31446261815324 * 293.0)
    assert_allclose(gas.mass_rate, gas.conductance * mean_density / 18e-6 * 3e5, rtol=1e-12)
    assert_allclose(gas.volume_rate, gas.mass_rate / AIR.reference_density, rtol=1e-14)
    x = STRIP.points[..., 0] / 3e-3
    assert_allclose(gas.fluid_pressure, np.sqrt(16e10 - 15e10 * x), rtol=1e-12)


# --- meshes ---


def test_a_ready_mesh_has_bounds():
    mesh = MeshTri.init_tensor(np.linspace(0, 2, 4), np.linspace(0, 1, 3))
    mesh = mesh.with_boundaries({"a": lambda x: x[0] == 0, "b": lambda x: x[0] == 2})
    k = np.tile([4e-18, 1e-18], (mesh.nelements, 1))
    leak = seal_leakage(MeshSeal(mesh, "a", "b"), k, WATER, inlet_pressure=1e6, bounds=True)
    assert_allclose([leak.lower, leak.upper], 4e-18 / 2 * 1e6 / 1e-3, rtol=1e-12)
    curved = MeshTri2.from_mesh(mesh).with_boundaries(mesh.boundaries)
    with pytest.raises(InputError, match=r"^path: given a MeshTri2, expected .* linear elements"):
        MeshSeal(curved, "a", "b")


# --- the quantity and the solver ---


@pytest.mark.parametrize(
    "layout",
    [
        RectangularLayout(),
        RectangularLayout(lay={"angle": 0.4}),
        AnnularLayout(1e-3, 2e-3),
        MeshLayout(RING, "m", "inlet", "outlet"),
    ],
    ids=lambda layout: str(layout)[:12],
)
def test_the_leakage_does_not_depend_on_whether_bounds_are_asked_for(layout):
    length = 6e-3 if layout.has_length else None
    seal = layout.lay_out(CellSize((2e-4, 3e-4), 5, length=length)).seal
    k = random_elements((len(seal.outlines), 1), 1.5)[:, 0]
    alone, bounded = (seal_leakage(seal, k, WATER, inlet_pressure=1e6, bounds=b) for b in (0, 1))
    assert_allclose(alone.volume_rate, bounded.volume_rate, rtol=1e-7)
    assert_allclose(bounded.volume_rate**2, bounded.lower * bounded.upper, rtol=1e-7)
    assert_array_equal(alone.fluid_pressure, bounded.fluid_pressure)
    assert np.isnan([alone.lower, alone.upper]).all()
    conforming = seal.conforming_flow(k)
    flow = seal.flow(k, bounds=True)
    assert_allclose(conforming.conductance, flow.upper, rtol=1e-7)
    assert_array_equal(conforming.potential, flow.potential)


@pytest.mark.parametrize("solver", ["multigrid", "elimination"])
def test_a_fast_solver_is_refused_where_it_cannot_be_used(solver):
    oblique = np.tile([[2e-18, 1e-18], [1e-18, 2e-18]], (60, 1, 1))
    along = np.tile([[2e-18, 0.0], [0.0, 1e-18]], (60, 1, 1))
    assert leak(along, solver=solver).solver == solver
    turned = RectangularLayout(lay={"angle": 0.4}).lay_out(CellSize((5e-4, 5e-4), 4, length=4e-3))
    for seal, k in (
        (MeshSeal(RING, "inlet", "outlet"), 1e-18),
        (STRIP, oblique),
        (turned.seal, np.tile([2e-18, 1e-18], (turned.count, 1))),
    ):
        expected = rf"^solver: given '{solver}', expected one of auto, amg, direct"
        with pytest.raises(InputError, match=expected):
            leak(k, seal, solver=solver)


def test_a_case_may_name_a_fast_solver_for_its_cells_and_have_a_seal_on_a_mesh():
    scene = SimpleNamespace(
        fluid=WATER, inlet_pressure=1e6, outlet_pressure=0.0, solver="elimination"
    )
    on_mesh = Scene.leakage(scene, MeshSeal(RING, "inlet", "outlet"), 1e-18)
    assert on_mesh.solver == "direct"
    assert Scene.leakage(scene, STRIP, 1e-18).solver == "elimination"


# --- bad input ---


@pytest.mark.parametrize(
    ("kind", "given", "message"),
    [
        (RectangularSeal, ((0.0, 1.0), (2, 2)), r"size: given 0\.0, expected a finite number > 0"),
        (RectangularSeal, ((1.0, np.nan), (2, 2)), "size: given nan"),
        (RectangularSeal, (1.0, (2, 2)), r"size: given 1\.0, expected two finite numbers"),
        (RectangularSeal, (("a", 1.0), (2, 2)), "size: given 'a'"),
        (RectangularSeal, ((1.0, 1.0), (0, 2)), r"cells: given \(0, 2\), expected two whole numb"),
        (RectangularSeal, ((1.0, 1.0), (2.5, 2)), r"cells: given \(2\.5, 2\), expected two whole"),
        (RectangularSeal, ((1.0, 1.0), 4), "cells: given 4, expected two whole numbers"),
        (AnnularSeal, (0.0, 1.0, (2, 2)), r"inner_radius: given 0\.0, expected a finite number"),
        (AnnularSeal, (1.0, np.inf, (2, 2)), "outer_radius: given inf"),
        (AnnularSeal, (2.0, 1.0, (2, 2)), "outer_radius: given 1 m, expected .*> the inner radiu"),
        (AnnularSeal, (1.0, 2.0, (2, 2), "left"), "inlet: given 'left', expected 'inner' or"),
    ],
)
def test_bad_shapes(kind, given, message):
    with pytest.raises(InputError, match="^" + message):
        kind(*given)


def leak(permeability=1e-18, seal=STRIP, fluid=WATER, **kwargs):
    return seal_leakage(seal, permeability, fluid, **({"inlet_pressure": 1e6} | kwargs))


@pytest.mark.parametrize(
    ("k", "message"),
    [
        (np.nan, ": given 1 value not finite, expected numbers >= 0"),
        (-1.0, ": given -1, expected numbers >= 0"),
        ("much", ": given 'much', expected numbers"),
        (
            np.ones((6, 9)),
            r": given shape \(6, 9\), expected a number or shape \(60,\) or \(6, 10\)",
        ),
        ((1.0, 1.0, 1.0), r": given shape \(3,\), expected a number or shape"),
        ((np.ones((6, 10)), np.ones((5, 10))), ": given a pair of arrays, as of links, expected"),
    ],
)
def test_bad_permeability(k, message):
    for seal in (STRIP, AnnularSeal(1.0, 2.0, (6, 10))):
        with pytest.raises(InputError, match="^permeability" + message):
            leak(k, seal)
    with pytest.raises(InputError, match=r"^permeability: given shape \(5,\), .* shape \(768,\)"):
        leak(np.ones(5), MeshSeal(RING, "inlet", "outlet"))


@pytest.mark.parametrize("name", ["inlet_pressure", "outlet_pressure"])
@pytest.mark.parametrize(
    ("fluid", "value", "message"),
    [
        (WATER, np.nan, ".*, expected a finite number"),
        (WATER, "high", ".*, expected a finite number"),
        (AIR, -1e3, "-1000 Pa, expected a pressure that IdealGas"),
        (Liquid(0.05, pressure_viscosity=20e-9), 5e9, "5e.09 Pa, expected a pressure that Liquid"),
    ],
)
def test_bad_pressures(name, fluid, value, message):
    with pytest.raises(InputError, match=rf"^{name}: given {message}"):
        leak(fluid=fluid, **{name: value})
    assert leak(fluid=WATER, outlet_pressure=-1e4).volume_rate > 0  # a liquid may be in tension
