"""Seals: closed forms, percolation, bounds, fluids, meshes by name, and every bad input."""

from pathlib import Path
from types import SimpleNamespace

import meshio
import numpy as np
import pytest
from networks import network, solve_links
from numpy.testing import assert_allclose, assert_array_equal
from skfem import MeshLine, MeshQuad, MeshTri, MeshTri2

from femseal.analytic import annulus_rate
from femseal.base import InputError
from femseal.flow.error_bound import least_conductance
from femseal.flow.permeability_table import Mobility, PressureCurve
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


def test_means_between_pressures_are_exact_for_a_liquid():
    """k = k₀ exp(−p/P) between its knots, constant beyond them, and linear beside a pressure at which it is closed."""
    scale, knots = 2e6, np.linspace(0.0, 8e6, 5)
    k = np.stack([np.exp(-knots / scale), np.where(knots < 4e6, 0.0, 3.0)], axis=1)
    even = Mobility(np.linspace(0, 1e7, 11), np.full(11, 5.0), np.full(11, 5.0))
    curve = PressureCurve(knots, k, True)
    for a, b in ((1e6, 1.5e6), (7e6, 5e5), (3e6, 3e6 + 1.0), (3e6, 3e6)):
        mean = (
            scale * (np.exp(-b / scale) - np.exp(-a / scale)) / (a - b)
            if a != b
            else np.exp(-a / scale)
        )
        assert_allclose(curve.mean_between(np.full(2, a), np.full(2, b), even)[0], mean, rtol=1e-9)
    beyond = curve.mean_between(np.full(2, 7e6), np.full(2, 1e7), even)
    within = scale * (np.exp(-3.5) - np.exp(-4.0))
    assert_allclose(beyond, [(within + 2e6 * np.exp(-4.0)) / 3e6, 3.0], rtol=1e-12)
    assert_allclose(
        curve.mean_between(np.full(2, 2.5e6), np.full(2, 3.5e6), even)[1], 1.5, rtol=1e-12
    )


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


@pytest.mark.parametrize("noise", [1e-8, 1e-3, 0.1])
def test_the_lower_bound_holds_for_a_wrong_potential(noise):
    """Thomson's principle with the flux of a disturbed potential, made to balance."""
    rng = np.random.default_rng(0)
    c1, c2 = (np.exp(rng.standard_normal(shape)) for shape in ((7, 9), (6, 9)))
    exact = solve_links(c1, c2)
    rng = np.random.default_rng(3)
    potential = exact.potential.copy()
    potential[1:-1] += noise * rng.standard_normal((6, 9))
    stencil = network(c1, c2)
    lower = least_conductance(stencil, potential, 1 - potential)
    assert lower < exact.conductance * (1 + 1e-14)
    assert lower > exact.conductance * (1 - 1e4 * noise**2 - 1e-12)
    best = least_conductance(stencil, exact.potential, exact.complement)
    assert_allclose(best, exact.conductance, rtol=1e-13)


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


def square(kind, **kwargs):
    """Unit square of 2 × 2 cells as a meshio mesh; lines of group 7 at x = 0 and group 8 at x = 1."""
    mesh = (MeshTri if kind == "triangle" else MeshQuad).init_tensor(*2 * [np.linspace(0, 1, 3)])
    points = np.c_[mesh.p.T, np.full(mesh.nvertices, 0.5)]
    left, right = (
        mesh.facets[:, mesh.facets_satisfying(lambda x, at=at: x[0] == at)].T for at in (0, 1)
    )
    tags = [np.full(2, 7), np.full(2, 8), np.full(mesh.nelements, 7)]
    cells = [("line", left), ("line", right), (kind, mesh.t.T)]
    data = {"gmsh:physical": tags, "gmsh:geometrical": tags}
    return meshio.Mesh(points, cells, **({"cell_data": data} | kwargs))


NAMES = {"left": np.array([7, 1]), "right": np.array([8, 1]), "body": np.array([7, 2])}


@pytest.mark.parametrize("kind", ["triangle", "quad"])
@pytest.mark.parametrize(("names", "ends"), [(NAMES, ("left", "right")), ({}, ("7", "8"))])
def test_boundaries_by_name_or_number(tmp_path, kind, names, ends):
    path = tmp_path / "square.msh"
    mesh = square(kind, field_data=names)
    mesh.points = np.vstack([mesh.points, [[9.0, 9.0, 0.5]]])  # a node that no element uses
    meshio.write(path, mesh, file_format="gmsh22", binary=False)
    seal = MeshSeal(path, *ends)
    assert len(seal.points) == 9
    flow = seal.flow(3.0)
    assert_allclose(flow.conductance, 3.0, rtol=1e-12)
    assert_allclose(flow.potential, 1 - seal.points[:, 0], atol=1e-12)
    assert_allclose([seal.length, seal.area], 1.0, rtol=1e-12)


@pytest.mark.parametrize("array", ["gmsh:physical", "boundary"])
def test_boundaries_in_a_vtu_go_by_their_number(tmp_path, array):
    tags = square("triangle").cell_data["gmsh:physical"]
    meshio.write(tmp_path / "square.vtu", square("triangle", cell_data={array: tags}))
    seal = MeshSeal(tmp_path / "square.vtu", "7", "8")
    assert_allclose(seal.flow(1.0).conductance, 1.0, rtol=1e-12)


def test_cell_sets_of_another_format(tmp_path):
    path, none, both = tmp_path / "square.inp", np.array([], int), np.array([0, 1])
    sets = {"in": [both, none, none], "out": [none, both, none]}
    meshio.write(path, square("quad", cell_sets=sets, cell_data={}))
    assert_allclose(MeshSeal(path, "in", "out").flow(1.0).conductance, 1.0, rtol=1e-12)


def test_elements_keep_the_order_of_the_file(tmp_path):
    mesh = square("triangle", field_data=NAMES)
    mesh.cells[2].data = mesh.cells[2].data[::-1]
    path = tmp_path / "square.msh"
    meshio.write(path, mesh, file_format="gmsh22", binary=False)
    seal = MeshSeal(path, "left", "right")
    triangles = mesh.points[mesh.cells[2].data][..., :2]
    assert_allclose(seal.points[seal.mesh.t.T].mean(axis=1), triangles.mean(axis=1))
    k = np.where(triangles.mean(axis=1)[:, 0] < 0.5, 1.0, 3.0)
    assert_allclose(seal.flow(k).conductance, 1.5, rtol=1e-12)


def test_gmsh_version_4(tmp_path):
    path = tmp_path / "square.msh"
    path.write_text(
        "$MeshFormat\n4.1 0 8\n$EndMeshFormat\n"
        '$PhysicalNames\n3\n1 1 "west"\n1 2 "east"\n2 3 "seal"\n$EndPhysicalNames\n'
        "$Entities\n0 2 1 0\n"
        "1 0 0 0 0 1 0 1 1 0\n2 1 0 0 1 1 0 1 2 0\n1 0 0 0 1 1 0 1 3 0\n$EndEntities\n"
        "$Nodes\n1 4 1 4\n2 1 0 4\n1\n2\n3\n4\n0 0 0\n1 0 0\n1 1 0\n0 1 0\n$EndNodes\n"
        "$Elements\n3 4 1 4\n1 1 1 1\n1 4 1\n1 2 1 1\n2 2 3\n2 1 2 2\n3 1 2 3\n4 1 3 4\n$EndElements\n"
    )
    seal = MeshSeal(path, "west", "east")
    assert_allclose(seal.flow(2.0, bounds=True).lower, 2.0, rtol=1e-12)


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


CORNERS = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [2, 0, 0], [2, 1, 0]])
QUAD, TRIANGLES = ("quad", [[0, 1, 2, 3]]), ("triangle", [[1, 4, 2], [4, 5, 2]])
RAISED = np.where(np.arange(18).reshape(6, 3) == 2, 1, CORNERS)


@pytest.mark.parametrize(
    ("file", "message"),
    [
        (None, r"^path: given '.*mesh\.msh', expected an existing mesh file"),
        ("not a mesh", r"mesh\.msh'.*, expected a mesh in a format that meshio reads"),
        ("$MeshFormat\n2.2 0 8\n$EndMeshFormat\n$Nodes\n3\n1 0 0", "in a format that meshio reads"),
        (
            meshio.Mesh(CORNERS, [("line", [[0, 1]])]),
            "with line, expected elements of the seal's area",
        ),
        (meshio.Mesh(CORNERS, [QUAD, TRIANGLES]), "with triangle and quad, expected a mesh with"),
        (meshio.Mesh(RAISED, [QUAD]), "with varying z, expected"),
        (
            meshio.Mesh(CORNERS, [QUAD]),
            "^inlet: given 'inlet', .*the mesh: none; name the boundaries: in gmsh by physical groups of curves",
        ),
    ],
)
def test_bad_mesh_files(tmp_path, file, message):
    path = tmp_path / "mesh.msh"
    if isinstance(file, str):
        path.write_text(file)
    elif file:
        meshio.write(path, file, file_format="gmsh22", binary=False)
    with pytest.raises(InputError, match=message) as error:
        MeshSeal(path, "inlet", "outlet")
    assert "\n" not in str(error.value)


@pytest.mark.parametrize(
    ("inlet", "outlet", "message"),
    [
        ("west", "outlet", "inlet: given 'west', expected the name of a boundary of the mesh: 'i"),
        ("inlet", "seal", "outlet: given 'seal', expected the name"),
        ("inlet", "inlet", "inlet and outlet: given boundaries that touch"),
    ],
)
def test_bad_boundaries(inlet, outlet, message):
    with pytest.raises(InputError, match="^" + message):
        MeshSeal(RING, inlet, outlet)


@pytest.mark.parametrize("kind", [MeshTri, MeshQuad])
def test_meshes_that_overlap_themselves_or_have_undefined_nodes(kind):
    """A node pushed over the opposite edge leaves each element whole, but some upside down."""
    mesh = kind.init_tensor(*2 * [np.linspace(0, 1, 5)])
    middle = int(np.argmin(np.hypot(*(mesh.p - 0.5))))
    undefined, over = mesh.p.copy(), mesh.p.copy()
    undefined[:, middle] = np.nan
    over[:, middle] = (0.9, 0.57)
    faults = [
        (undefined, mesh.t, f"^path: given a mesh whose node {middle} has no finite coordinates"),
        (mesh.p, np.hstack([mesh.t, mesh.t[:, 5:6]]), "overlap"),
    ]
    if kind is MeshTri:
        faults.append((over, mesh.t, r"^path: given a mesh whose elements \d+ and \d+ overlap"))
    for points, elements, message in faults:
        with pytest.raises(InputError, match=message):
            MeshSeal(kind(points, elements).with_boundaries(ENDS), "a", "b")


ENDS = {"a": lambda x: x[0] == 0, "b": lambda x: x[0] == 1}


def two_parts(kind, shift, turn=0.0, cells=6, size=1.0):
    """A unit square and another one with its own nodes, moved."""
    one = kind.init_tensor(*2 * [np.linspace(0, 1, 7)])
    two = kind.init_tensor(*2 * [np.linspace(0, size, cells + 1)])
    c, s = np.cos(turn), np.sin(turn)
    moved = np.array([[c, -s], [s, c]]) @ two.p + np.array(shift)[:, None]
    both = kind(np.hstack([one.p, moved]), np.hstack([one.t, two.t + one.nvertices]))
    ends = {name: one.facets_satisfying(end) for name, end in ENDS.items()}
    return both.with_boundaries(ends)


@pytest.mark.parametrize("kind", [MeshTri, MeshQuad])
@pytest.mark.parametrize(
    ("shift", "more"),
    [
        ((0, 0), {}),
        ((1 / 3, 0), {}),
        ((0.43, 0.21), {}),
        ((0.3, 0.9), {"turn": 0.4}),
        ((0.95, 0.95), {}),
        ((0.5, -0.2), {"turn": np.pi / 4}),
        ((0.3, 0.3), {"cells": 1, "size": 0.1}),
    ],
)
def test_parts_that_lie_on_each_other_are_refused(kind, shift, more):
    """Nodes of the two parts that coincide, lie on edges, or lie anywhere; one within the other."""
    with pytest.raises(
        InputError, match=r"^path: given a mesh whose el.* (overlap|lies on others)"
    ):
        MeshSeal(two_parts(kind, shift, **more), "a", "b")


@pytest.mark.parametrize("kind", [MeshTri, MeshQuad])
@pytest.mark.parametrize(
    "shift", [(1, 0), (1, 0.5), (1 - 1e-4, 0.37), (1, 1), (0, -1 + 1e-12), (1.5, 0.2)]
)
def test_parts_beside_each_other_are_taken(kind, shift):
    assert MeshSeal(two_parts(kind, shift), "a", "b").length == pytest.approx(1)


@pytest.mark.parametrize(("angle", "good"), [(1.9, True), (2.3, False)])
def test_a_band_that_winds_onto_itself_is_refused(angle, good):
    """All its elements lie beside their neighbours; it is a ring with a slit, or covers its beginning once more."""
    band = MeshQuad.init_tensor(np.linspace(0, 1, 4), np.linspace(0, angle * np.pi, 60))
    ends = {name: band.facets_satisfying(end) for name, end in ENDS.items()}
    r, theta = band.p
    points = (1 + r) * np.stack([np.cos(theta), np.sin(theta)])
    mesh = MeshQuad(points, band.t).with_boundaries(ends)
    if good:
        assert MeshSeal(mesh, "a", "b").length == pytest.approx(2 * angle * np.pi, rel=1e-2)
    else:
        with pytest.raises(InputError, match=r"overlap|lies on others"):
            MeshSeal(mesh, "a", "b")


def test_bad_ready_meshes():
    with pytest.raises(InputError, match=r"^path: given a MeshLine1, expected a plane mesh"):
        MeshSeal(MeshLine(), "a", "b")
    ends = {"a": lambda x: x[0] == 0, "b": lambda x: x[0] == 3}
    x = np.array([[0, 1, 1, 0, 2, 3, 3, 2], [0, 0, 1, 1, 0, 0, 1, 1]], float)
    apart = MeshQuad(x, np.array([[0, 1, 2, 3], [4, 5, 6, 7]]).T)
    tangled = MeshQuad(x[:, :4] * [[3], [1]], np.array([[0, 1, 3, 2]]).T)
    points = np.array([[0, 3, 3, 1.5], [0, 0, 1, -1e-14]])
    flat = MeshTri(points, np.array([[0, 1, 2], [0, 3, 1]]).T)
    for mesh, message in (
        (apart, "inlet and outlet: given boundaries that the mesh does not connect"),
        (tangled, "path: given a mesh whose element 0 is degenerate or tangled"),
        (flat, "path: given a mesh whose element 1 is degenerate or tangled"),
    ):
        with pytest.raises(InputError, match="^" + message):
            MeshSeal(mesh.with_boundaries(ends), "a", "b")
