"""Tiles on seals of any shape: closed forms, invariants, two ways to the same seal, and bad input."""

from functools import partial
from math import pi
from pathlib import Path

import meshio
import numpy as np
import pytest
from numpy.testing import assert_allclose
from skfem import MeshQuad, MeshTri

from femseal.analytic import (
    annulus_rate,
)
from femseal.base import InputError
from femseal.seal import AnnularLayout, MeshLayout, MeshSeal, RectangularLayout
from femseal.seal.lay import Lay
from femseal.seal.layouts import parse_lay
from femseal.seal.tiles import CellSize

MESHES = Path(__file__).parents[2] / "meshes"
CELL = CellSize((1e-4, 1e-4), 10)
RADII = (1e-2, 1.1e-2)


def circular(kind, n, radii=(1.0, 1.5), shift=0.0):
    """A ring of n × 8n elements with the boundaries "in" and "out", the inner circle moved along x."""
    s, θ = np.meshgrid(np.linspace(0, 1, n + 1), pi / 4 * np.arange(8 * n) / n, indexing="ij")
    r = radii[0] + (radii[1] - radii[0]) * s
    p = np.array([r * np.cos(θ) + shift * (1 - s), r * np.sin(θ)]).reshape(2, -1)
    node = np.arange(s.size).reshape(s.shape)
    beside = np.roll(node, -1, axis=1)
    quads = np.stack([node[:-1], node[1:], beside[1:], beside[:-1]]).reshape(4, -1)
    elements = quads if kind is MeshQuad else np.hstack([quads[[0, 1, 2]], quads[[0, 2, 3]]])
    mesh = kind(p, elements)
    facets = mesh.boundary_facets()
    at = s.ravel()[mesh.facets[0, facets]]
    return mesh.with_boundaries({"in": facets[at == 0], "out": facets[at == 1]})


both_kinds = pytest.mark.parametrize("kind", [MeshQuad, MeshTri])


def order_of(errors):
    return np.log2(np.array(errors[:-1]) / errors[1:])


# --- closed forms on meshes ---


def spiral(mesh):
    """5 along and 0.4 across grooves at 1.1 to the radius."""
    x, y = mesh.p[:, mesh.t].mean(axis=1)
    angle = np.arctan2(y, x) + 1.1
    t = np.array([np.cos(angle), np.sin(angle)])
    return 4.6 * np.einsum("an,bn->nab", t, t) + 0.4 * np.eye(2)


@both_kinds
@pytest.mark.parametrize(
    ("shift", "stretch", "k", "exact"),
    [
        (0, 1, lambda mesh: 1.0, annulus_rate(1, 1, 1, 1, 1.5)),
        (0.3, 1, lambda mesh: 2.0, 4 * np.pi / np.arccosh(3.16 / 3)),
        (
            0,
            6**0.5,
            lambda mesh: np.tile([3.0, 0.5], (mesh.nelements, 1)),
            annulus_rate(1.5**0.5, 1, 1, 1, 1.5),
        ),
        (0, 1, spiral, annulus_rate(0.4 + 4.6 * np.cos(1.1) ** 2, 1, 1, 1, 1.5)),
    ],
    ids=["ring", "eccentric", "ellipses", "spiral"],
)
def test_closed_forms_with_order_two(kind, shift, stretch, k, exact):
    flows = []
    for n in (4, 8, 16):
        mesh = circular(kind, n, shift=shift).scaled((stretch**0.5, stretch**-0.5))
        flows.append(MeshSeal(mesh, "in", "out").flow(k(mesh), bounds=True))
    assert_allclose(order_of([abs(f.conductance - exact) for f in flows]), 2, atol=0.35)
    assert_allclose(order_of([f.upper - f.lower for f in flows]), 2, atol=0.35)
    assert_allclose([flows[-1].lower, flows[-1].conductance], exact, rtol=5e-3)
    assert all(f.imbalance < 1e-10 for f in flows)


# --- tiles ---


@pytest.mark.parametrize("angle", [0.4, 2.5])
def test_turning_mesh_and_lay_together_changes_nothing(tmp_path, angle):
    c, s = np.cos(angle), np.sin(angle)
    mesh = meshio.read(MESHES / "racetrack.msh")
    mesh.points[:, :2] = mesh.points[:, :2] @ [[c, s], [-s, c]]
    turned = tmp_path / "turned.msh"
    meshio.write(turned, mesh, file_format="gmsh22", binary=False)

    def rates(path, direction):
        lay = {"angle": direction}
        layout = MeshLayout(path, "mm", "inside", "outside", lay=lay)
        tiles = layout.lay_out(CellSize((1e-6, 1e-6), 1))  # an element each
        k = np.random.default_rng(2).lognormal(size=(2, tiles.count)) * [[1.0], [6.0]]
        of_tiles = np.empty_like(k)
        of_tiles[:, tiles.tile] = k
        flow = tiles.seal.flow(tiles.permeability(*of_tiles), bounds=True)
        return np.array([flow.conductance, flow.lower, flow.upper])

    plain = rates(MESHES / "racetrack.msh", 0.3)
    assert_allclose(rates(turned, 0.3 + angle), plain, rtol=1e-8)
    assert abs(rates(turned, 0.3)[0] / plain[0] - 1) > 1e-3


def test_closed_tiles_seal_exactly():
    tiles = MeshLayout(MESHES / "ring.msh", "m", "inlet", "outlet").lay_out(CELL)
    k = np.ones(tiles.count)
    k[np.hypot(*tiles.middles.T) < 11e-3] = 0.0
    flow = tiles.seal.flow(tiles.permeability(k, k), bounds=True)
    assert (flow.conductance, flow.lower, flow.percolates) == (0.0, 0.0, False)
    # closed across the lay, which runs round the bore; no side of an element runs along it
    turned = MeshLayout(MESHES / "bolted_ring.msh", "mm", "bore", "rim").lay_out(CELL)
    one = np.ones(turned.count)
    half = turned.seal.flow(turned.permeability(0 * one, one), bounds=True)
    assert (half.conductance, half.percolates, half.upper > 0) == (0.0, False, True)


# --- layouts ---


@pytest.mark.parametrize(
    ("layout", "cell", "grid", "size"),
    [
        (RectangularLayout(), CellSize((1e-5, 3e-5), 8, 3e-3, 4e-4), (40, 100), (4e-4, 3e-3)),
        (RectangularLayout(), CellSize((1e-5, 3e-5), 8, 3e-3), (8, 100), (8e-5, 3e-3)),
        (RectangularLayout("x1"), CellSize((1e-5, 3e-5), 9, 3e-3), (3, 300), (9e-5, 3e-3)),
        (AnnularLayout(1e-2, 1.1e-2, "outer"), CELL, (10, 660), (1e-3, pi * 21e-3)),
        (
            AnnularLayout(1e-2, 1.1e-2, lay="radial"),
            CellSize((1e-4, 2e-4), 1),
            (5, 660),
            (1e-3, pi * 21e-3),
        ),
    ],
)
def test_sizes_and_numbers_of_tiles(layout, cell, grid, size):
    tiles = layout.lay_out(cell)
    assert tiles.grid == grid
    assert_allclose(tiles.size, size)


@pytest.mark.parametrize(
    ("layout", "cell", "area"),
    [
        (RectangularLayout(), CellSize((1e-5, 3e-5), 8, length=3e-3), 8e-5 * 3e-3),
        (AnnularLayout(1e-2, 1.1e-2), CELL, pi * 21e-6),
        (RectangularLayout({"angle": 1.0}), CellSize((1e-5, 1e-5), 8, length=3e-4), 24e-9),
        (MeshLayout(MESHES / "frame.msh", "mm", "inside", ["outside"]), CELL, 384e-6),
    ],
)
def test_outlines_cover_the_seal(layout, cell, area):
    x, y = np.moveaxis(layout.lay_out(cell).outlines, -1, 0)
    parts = (x * np.roll(y, -1, axis=1) - np.roll(x, -1, axis=1) * y).sum(axis=1)
    assert_allclose(0.5 * np.abs(parts).sum(), area, rtol=1e-4)


def test_lay_from_a_field(tmp_path):
    """Vectors round the bore at the points of a coarse mesh, either way: the circumferential lay."""
    mesh = circular(MeshQuad, 4, (10.0, 15.0))
    x, y = mesh.p
    vectors = np.array([-y, x, 0 * x]).T * np.where(x > 0, 1, -3)[:, None]
    points, cells = np.column_stack([x, y, 0 * x]), [("quad", mesh.t.T)]
    bad = vectors.copy()
    bad[3, 0] = np.nan
    data = {"t": vectors, "bad": bad}
    meshio.write(tmp_path / "lay.vtu", meshio.Mesh(points, cells, point_data=data))
    at = MeshSeal(MESHES / "ring.msh", "inlet", "outlet").points
    found = parse_lay({"field": "lay.vtu:t"}, tmp_path).directions(at, unit=1e-3)
    expected = Lay("circumferential").directions(at)
    assert np.abs((found * expected).sum(axis=1)).min() > np.cos(0.12)
    for key, shift, words in (
        ("lay.vtu:s", 0.0, "'s' of .*one of the fields in the file: 't'"),
        ("no.vtu:t", 0.0, "an existing mesh file"),
        (
            "lay.vtu:t",
            1.0,
            "which does not cover 864 elements, expected a field that covers the seal",
        ),
        ("lay.vtu:bad", 0.0, "vectors along the lay, finite and not 0"),
    ):
        with pytest.raises(InputError, match=words):
            parse_lay({"field": key}, tmp_path).directions(at + shift, unit=1e-3)


@pytest.mark.parametrize(
    "given",
    [
        "across",
        30,
        {"angle": "30 mm"},
        {"angle": True},
        {"angle": 10**400},
        {"angle": np.inf},
        {"field": "a"},
        {"angle": 1, "field": "a:b"},
    ],
)
def test_bad_lay(given):
    with pytest.raises(InputError, match=r"^lay"):
        parse_lay(given)


RINGS = MESHES / "ring.msh"


@pytest.mark.parametrize(
    ("layout", "given", "cell", "message"),
    [
        (RectangularLayout, ("radial",), CELL, "lay: given 'radial' on a strip"),
        (RectangularLayout, (), CELL, "length: given none"),
        (RectangularLayout, (), CellSize((1e-6, 1e-4), 1001, 1e-3), "at most 1000 tiles"),
        (AnnularLayout, (1e-2, 1e-2), CELL, "outer_radius: given 0.01 m, expected a number > the"),
        (AnnularLayout, (10.0, 120.0), CELL, "outer_radius: given a seal 240 m across, .* unit r"),
        (AnnularLayout, RADII, CellSize((1e-4, 1e-4), 4, length=1.0), "length: given 1 m, expec"),
        (AnnularLayout, RADII, CellSize((1e-4, 1e-4), 4, breadth=1.0), "breadth: given 1 m, exp"),
        (AnnularLayout, RADII, CellSize((2e-3, 1e-4), 4), "outer_radius: given a ring 1 mm wide"),
        (AnnularLayout, (1e-3, 1e-2), CELL, "inner_radius: given .*18% as wide as cells"),
        (MeshLayout, (RINGS, "kg", "inlet", "outlet"), CELL, "unit"),
        (MeshLayout, (RINGS, "um", "inlet", "outlet"), CELL, "path: given a seal 30 nm across wi"),
        (MeshLayout, (RINGS, "m", "inlet", ("outlet", "rim")), CELL, "outlet: given 'rim'"),
        (MeshLayout, (RINGS, "m", "inlet", ()), CELL, r"outlet: given \(\)"),
        (
            partial(MeshLayout, length="80 mm"),
            (RINGS, "m", "inlet", "outlet"),
            CELL,
            r"length: given '80 mm', expected a finite number > 0 \[m\]",
        ),
        (MeshLayout, (RINGS, "m", "inlet", "inlet"), CELL, "inlet and outlet: given boundaries"),
        (MeshLayout, (MESHES / "none.msh", "m", "a", "b"), CELL, "path: given .* an existing mes"),
    ],
)
def test_bad_shapes(layout, given, cell, message):
    with pytest.raises(InputError, match=message) as error:
        layout(*given).lay_out(cell)
    assert "\n" not in str(error.value)


def test_tiles_that_are_narrow_at_the_inner_radius_are_warned_of():
    (told,) = AnnularLayout(1e-3, 3e-3).lay_out(CELL).warnings
    assert "50% as wide as cells" in told
