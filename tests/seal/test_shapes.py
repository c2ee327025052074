"""Tiles on seals of any shape: closed forms, invariants, two ways to the same seal, and bad input."""

from math import pi
from pathlib import Path

import meshio
import numpy as np
import pytest
from numpy.testing import assert_allclose
from skfem import MeshQuad, MeshTri

from femseal.analytic import (
    annulus_rate,
    eccentric_annulus_rate,
    elliptic_annulus_rate,
    spiral_annulus_rate,
)
from femseal.base.errors import InputError
from femseal.seal import AnnularSeal, MeshSeal
from femseal.seal.lay import Lay
from femseal.seal.layouts import AnnularLayout, MeshLayout, RectangularLayout
from femseal.seal.mesh_seal import boundaries_without_name, parts_without_flow
from femseal.seal.tiles import PieceSize

MESHES = Path(__file__).parents[2] / "meshes"
PIECE = PieceSize((1e-4, 1e-4), 10)


def circular(kind, n, radii=(1.0, 1.5), move=None):
    """A ring of n × 8n elements with the boundaries "in" and "out"; `move` maps its points (2, n)."""
    grid = MeshQuad.init_tensor(np.linspace(0, 1, n + 1), np.arange(8 * n + 1.0))
    quads = np.round(grid.p[0] * n).astype(int) * 8 * n + np.round(grid.p[1]).astype(int) % (8 * n)
    quads = quads[grid.t]
    s, θ = (
        a.ravel()
        for a in np.meshgrid(
            np.linspace(0, 1, n + 1), 2 * pi * np.arange(8 * n) / (8 * n), indexing="ij"
        )
    )
    r = radii[0] + (radii[1] - radii[0]) * s
    p = np.array([r * np.cos(θ), r * np.sin(θ)])
    p = p if move is None else move(p, s)
    mesh = (
        MeshQuad(p, quads)
        if kind is MeshQuad
        else MeshTri(p, np.hstack([quads[[0, 1, 2]], quads[[0, 2, 3]]]))
    )
    facets = mesh.boundary_facets()
    at = s[mesh.facets[0, facets]]
    return mesh.with_boundaries({"in": facets[at == 0], "out": facets[at == 1]})


both_kinds = pytest.mark.parametrize("kind", [MeshQuad, MeshTri])


def order_of(errors):
    return np.log2(np.array(errors[:-1]) / errors[1:])


# --- closed forms on meshes ---


@both_kinds
def test_bounds_enclose_the_annulus_and_close_with_order_two(kind):
    exact = annulus_rate(1.0, 1.0, 1.0, 1.0, 1.5)
    flows = [MeshSeal(circular(kind, n), "in", "out").flow(1.0, bounds=True) for n in (2, 4, 8)]
    assert_allclose(order_of([abs(f.conductance - exact) for f in flows]), 2, atol=0.15)
    assert_allclose(order_of([f.upper - f.lower for f in flows]), 2, atol=0.15)
    assert_allclose([flows[-1].lower, flows[-1].upper], exact, rtol=3e-3)
    assert all(f.imbalance < 1e-10 for f in flows)


@both_kinds
def test_eccentric_annulus(kind):
    e = 0.3
    exact = eccentric_annulus_rate(2.0, 1.0, 1.0, 1.0, 1.5, e)
    assert exact > 1.2 * annulus_rate(2.0, 1.0, 1.0, 1.0, 1.5)

    def shifted(p, s):
        return p + [[e], [0]] * (1 - s)

    errors = [
        abs(MeshSeal(circular(kind, n, move=shifted), "in", "out").flow(2.0).conductance - exact)
        for n in (4, 8, 16)
    ]
    assert_allclose(order_of(errors), 2, atol=0.2)
    assert errors[-1] < 2e-3 * exact


@both_kinds
def test_anisotropic_ring_between_similar_ellipses(kind):
    k1, k2 = 3.0, 0.5
    exact = elliptic_annulus_rate(k1, k2, 1.0, 1.0, 1.0, 1.5)
    stretch = np.sqrt([[k1], [k2]] / np.sqrt(k1 * k2))
    meshes = [circular(kind, n, move=lambda p, s: stretch * p) for n in (4, 8, 16)]
    flows = [
        MeshSeal(m, "in", "out").flow(np.tile([k1, k2], (m.nelements, 1)), bounds=True)
        for m in meshes
    ]
    assert_allclose(order_of([abs(f.conductance - exact) for f in flows]), 2, atol=0.2)
    assert flows[-1].lower < exact * (1 + 2e-3)
    assert_allclose([flows[-1].lower, flows[-1].upper], exact, rtol=2e-3)


@both_kinds
def test_spiral_lay_on_a_ring(kind):
    β, along, across = 1.1, 5.0, 0.4
    exact = spiral_annulus_rate(along, across, β, 1.0, 1.0, 1.0, 1.5)
    errors = []
    for n in (4, 8, 16):
        mesh = circular(kind, n)
        centres = mesh.p[:, mesh.t].mean(axis=1)
        angle = np.arctan2(centres[1], centres[0]) + β
        t, m = np.array([np.cos(angle), np.sin(angle)]), np.array([-np.sin(angle), np.cos(angle)])
        k = along * np.einsum("an,bn->nab", t, t) + across * np.einsum("an,bn->nab", m, m)
        errors.append(abs(MeshSeal(mesh, "in", "out").flow(k).conductance - exact))
    assert_allclose(order_of(errors), 2, atol=0.35)
    assert errors[-1] < 3e-3 * exact


def test_one_smooth_map_on_grid_triangles_quadrilaterals_and_a_file():
    """A permeability that varies over the ring, taken at the centres of links or elements."""

    def k(x, y):
        return np.exp(0.8 * np.cos(2 * x - y) + 0.5 * np.sin(3 * y))

    def on(mesh):
        return MeshSeal(mesh, *mesh.boundaries).flow(
            k(*mesh.p[:, mesh.t].mean(axis=1)), bounds=True
        )

    ring = AnnularSeal(1.0, 1.5, (24, 192))
    r, θ = ring.radii[:, None], 2 * pi * np.arange(1, 193) / 192
    links = ((r[:-1] + r[1:]) / 2, θ - pi / 192), (r[1:-1], θ)
    reference = ring.flow(
        tuple(k(at * np.cos(angle), at * np.sin(angle)) for at, angle in links)
    ).conductance
    for kind in (MeshQuad, MeshTri):
        flow = on(circular(kind, 16))
        assert_allclose([flow.lower, flow.upper], reference, rtol=4e-3)
    file = MeshSeal(MESHES / "ring.msh", "inlet", "outlet")
    x, y = 100 * file.mesh.p[:, file.mesh.t].mean(axis=1)  # radii 10 and 15 mm
    assert_allclose(file.flow(k(x, y)).conductance, reference, rtol=5e-3)


# --- tiles ---


def of_elements(tiles, k):
    """Permeability (2, tiles) from that of the elements (2, n), each of which is a tile."""
    assert tiles.count == k.shape[1]
    of_tiles = np.empty_like(k)
    of_tiles[:, tiles.tile] = k
    return of_tiles


@pytest.mark.parametrize("angle", [0.4, 2.5])
def test_turning_mesh_and_lay_together_changes_nothing(tmp_path, angle):
    c, s = np.cos(angle), np.sin(angle)
    mesh = meshio.read(MESHES / "racetrack.msh")
    mesh.points[:, :2] = mesh.points[:, :2] @ [[c, s], [-s, c]]
    meshio.write(tmp_path / "turned.msh", mesh, file_format="gmsh22", binary=False)
    ends, piece = {"unit": "mm", "inlet": "inside", "outlet": "outside"}, PieceSize((1e-6, 1e-6), 1)
    plain = MeshLayout(MESHES / "racetrack.msh", **ends, lay={"angle": 0.3}).lay_out(piece)
    turned = MeshLayout(tmp_path / "turned.msh", **ends, lay={"angle": 0.3 + angle}).lay_out(piece)
    k = np.random.default_rng(2).lognormal(size=(2, plain.count)) * [[1.0], [6.0]]

    def flow(tiles):
        return tiles.seal.flow(tiles.permeability(*of_elements(tiles, k)), bounds=True)

    first, second = flow(plain), flow(turned)
    found, known = ([f.conductance, f.lower, f.upper] for f in (second, first))
    assert_allclose(found, known, rtol=1e-8)
    other = MeshLayout(tmp_path / "turned.msh", **ends, lay={"angle": 0.3}).lay_out(piece)
    assert abs(flow(other).conductance / first.conductance - 1) > 1e-3


def test_elements_of_a_mesh_are_tiles():
    seal = MeshSeal(MESHES / "bolted_ring.msh", "bore", ("rim", "bolts"), "mm")
    tiles = MeshLayout(MESHES / "bolted_ring.msh", "mm", "bore", ("rim", "bolts")).lay_out(PIECE)
    assert len(tiles.tile) == seal.mesh.nelements
    flow, known = (
        tiles.seal.flow(np.ones((len(tiles.tile), 2)), bounds=True),
        seal.flow(1.0, bounds=True),
    )
    assert_allclose([flow.lower, flow.upper], [known.lower, known.upper], rtol=1e-12)
    assert flow.lower < flow.conductance < flow.upper


def test_closed_tiles_seal_exactly():
    tiles = MeshLayout(MESHES / "ring.msh", "m", "inlet", "outlet").lay_out(PIECE)
    k = np.ones(tiles.count)
    k[np.hypot(*tiles.middles.T) < 11e-3] = 0.0
    flow = tiles.seal.flow(tiles.permeability(k, k), bounds=True)
    assert (flow.conductance, flow.lower, flow.percolates) == (0.0, 0.0, False)
    # closed across the lay, which runs round the bore; no side of an element runs along it
    turned = MeshLayout(MESHES / "bolted_ring.msh", "mm", "bore", "rim").lay_out(PIECE)
    one = np.ones(turned.count)
    half = turned.seal.flow(turned.permeability(0 * one, one), bounds=True)
    assert (half.conductance, half.percolates, half.upper > 0) == (0.0, False, True)


# --- layouts ---


def test_sizes_and_numbers_of_tiles():
    strip = RectangularLayout().lay_out(PieceSize((1e-5, 3e-5), 8, length=3e-3, breadth=4e-4))
    assert (strip.grid, strip.turned, strip.in_place) == ((40, 100), False, False)
    as_broad = RectangularLayout().lay_out(PieceSize((1e-5, 3e-5), 8, length=3e-3))
    assert (as_broad.grid, as_broad.in_place) == ((8, 100), True)
    along = RectangularLayout("x1").lay_out(PieceSize((1e-5, 3e-5), 9, length=3e-3))
    assert (along.grid, along.turned, along.in_place) == ((3, 300), True, False)
    assert_allclose(along.size, (9e-5, 3e-3))
    ring = AnnularLayout(1e-2, 1.1e-2, "outer").lay_out(PIECE)
    assert (ring.grid, ring.in_place) == ((10, 660), True)
    assert_allclose(ring.size, (1e-3, pi * 21e-3))
    radial = AnnularLayout(1e-2, 1.1e-2, lay="radial").lay_out(PieceSize((1e-4, 2e-4), 1))
    assert (radial.grid, radial.turned) == ((5, 660), True)
    mesh = MeshLayout(MESHES / "frame.msh", "mm", "inside", ["outside"], length=0.1).lay_out(PIECE)
    assert_allclose(mesh.size, (384e-6 / 0.1, 0.1))
    coarse = MeshLayout(MESHES / "frame.msh", "mm", "inside", ["outside"]).lay_out(
        PieceSize((4e-3, 4e-3), 1)
    )
    assert_allclose(coarse.count, 384e-6 / 16e-6, rtol=0.7)


def test_outlines_cover_the_seal():
    def area(tiles):
        x, y = np.moveaxis(tiles.outlines, -1, 0)
        return (
            0.5
            * np.abs((x * np.roll(y, -1, axis=1) - np.roll(x, -1, axis=1) * y).sum(axis=1)).sum()
        )

    assert_allclose(
        area(RectangularLayout().lay_out(PieceSize((1e-5, 3e-5), 8, length=3e-3))), 8e-5 * 3e-3
    )
    assert_allclose(area(AnnularLayout(1e-2, 1.1e-2).lay_out(PIECE)), pi * 21e-6, rtol=1e-4)
    assert_allclose(
        area(RectangularLayout({"angle": 1.0}).lay_out(PieceSize((1e-5, 1e-5), 8, length=3e-4))),
        24e-9,
    )
    assert_allclose(
        area(MeshLayout(MESHES / "frame.msh", "mm", "inside", ["outside"]).lay_out(PIECE)), 384e-6
    )


def test_lay_from_a_field(tmp_path):
    """Vectors round the bore at the points of a coarse mesh, either way: the circumferential lay."""
    places = circular(MeshQuad, 4, (10.0, 15.0)).p
    turned = np.array([-places[1], places[0], 0 * places[0]]) * np.where(places[0] > 0, 1, -3)
    quads = circular(MeshQuad, 4).t.T
    points = np.column_stack([*places, 0 * places[0]])
    meshio.write(
        tmp_path / "lay.vtu", meshio.Mesh(points, [("quad", quads)], point_data={"t": turned.T})
    )
    at = MeshSeal(MESHES / "ring.msh", "inlet", "outlet").points
    found = Lay.of({"field": "lay.vtu:t"}, tmp_path).directions(at, unit=1e-3)
    expected = Lay("circumferential").directions(at)
    assert np.abs((found * expected).sum(axis=1)).min() > np.cos(0.12)
    for key, words in (
        ("lay.vtu:s", "'s' of .*one of its fields: 't'"),
        ("no.vtu:t", "an existing mesh file"),
    ):
        with pytest.raises(InputError, match=words):
            Lay.of({"field": key}, tmp_path).directions(at)
    with pytest.raises(
        InputError, match="which leaves out 864 elements, expected a field that covers the seal"
    ):
        Lay.of({"field": "lay.vtu:t"}, tmp_path).directions(at + 1.0, unit=1e-3)
    turned[0, 3] = np.nan
    meshio.write(
        tmp_path / "nan.vtu", meshio.Mesh(points, [("quad", quads)], point_data={"t": turned.T})
    )
    with pytest.raises(InputError, match="vectors along the lay, finite and not 0"):
        Lay.of({"field": "nan.vtu:t"}, tmp_path).directions(at, unit=1e-3)


@pytest.mark.parametrize(
    "given",
    [
        "across",
        30,
        {"angle": "30 mm"},
        {"angle": True},
        {"field": "lay.vtu"},
        {"angle": 1, "field": "a:b"},
    ],
)
def test_bad_lay(given):
    with pytest.raises(InputError, match=r"^lay"):
        Lay.of(given)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: RectangularLayout("radial"), "^lay: given 'radial' on a strip"),
        (lambda: RectangularLayout().lay_out(PIECE), "^length: given none"),
        (
            lambda: AnnularLayout(1e-2, 1e-2),
            "^outer_radius: given 0.01 m, expected a number > the inner radius",
        ),
        (
            lambda: AnnularLayout(10.0, 120.0),
            "^outer_radius: given a seal 240 m across, .* is its unit right",
        ),
        (
            lambda: AnnularLayout(1e-2, 1.1e-2).lay_out(PieceSize((1e-4, 1e-4), 4, length=1.0)),
            "^length: given 1 m, expected none",
        ),
        (
            lambda: AnnularLayout(1e-2, 1.1e-2).lay_out(PieceSize((1e-4, 1e-4), 4, breadth=1.0)),
            "^breadth: given 1 m, expected",
        ),
        (
            lambda: AnnularLayout(1e-2, 1.1e-2).lay_out(PieceSize((2e-3, 1e-4), 4)),
            "^outer_radius: given a ring 1 mm broad",
        ),
        (
            lambda: AnnularLayout(1e-3, 1e-2).lay_out(PIECE),
            "^inner_radius: given .*18% as wide as pieces",
        ),
        (lambda: MeshLayout(MESHES / "ring.msh", "kg", "inlet", "outlet"), "^unit"),
        (
            lambda: MeshLayout(MESHES / "ring.msh", "um", "inlet", "outlet").lay_out(PIECE),
            "^path: given a seal 30 nm across with the unit 'um'",
        ),
        (
            lambda: MeshLayout(MESHES / "ring.msh", "m", "inlet", ("outlet", "rim")).lay_out(PIECE),
            "^outlet: given 'rim'",
        ),
        (
            lambda: MeshLayout(MESHES / "ring.msh", "m", "inlet", ()).lay_out(PIECE),
            r"^outlet: given \(\)",
        ),
        (
            lambda: MeshLayout(MESHES / "ring.msh", "m", "inlet", "inlet").lay_out(PIECE),
            "^inlet and outlet: given boundaries that touch",
        ),
        (
            lambda: MeshLayout(MESHES / "none.msh", "m", "inlet", "outlet").lay_out(PIECE),
            "^path: given .* an existing mesh",
        ),
        (
            lambda: MeshLayout(MESHES / "ring.msh", "m", "inlet", "outlet", length=-1.0),
            "^length: given -1",
        ),
        (lambda: Lay("radial").directions(np.zeros((1, 2))), "^lay: given 'radial' at the centre"),
    ],
)
def test_bad_shapes(make, message):
    with pytest.raises(InputError, match=message) as error:
        make()
    assert "\n" not in str(error.value)


def test_tiles_that_are_narrow_at_the_inner_radius_are_warned_of():
    (told,) = AnnularLayout(1e-3, 3e-3).lay_out(PIECE).warnings
    assert "50% as wide as pieces" in told


def test_parts_of_a_mesh_that_nothing_flows_through_are_warned_of():
    strip = MeshQuad.init_tensor(np.linspace(0, 2e-3, 3), np.linspace(0, 1e-3, 2))
    mesh = (
        strip + strip.translated((3e-3, 0.0)) + strip.scaled(0.5).translated((6e-3, 0.0))
    ).with_boundaries({"in": lambda x: x[0] == 0, "out": lambda x: np.isin(x[0], (2e-3, 5e-3))})
    seal = MeshSeal(mesh, "in", "out")
    assert [*parts_without_flow(mesh, *seal.ends)] == [
        "a part of the mesh around (4 mm, 500 µm), 2 of 4.5 mm², touches no inlet: nothing flows there",
        "a part of the mesh around (6.5 mm, 250 µm), 0.5 of 4.5 mm², touches neither inlet nor outlet: "
        "nothing flows there",
    ]


def test_a_hole_whose_boundary_is_in_no_group_is_said():
    """A square of 4 mm with a hole of 2 mm: its outline has 8 mm, around its middle."""
    mesh = MeshQuad.init_tensor(*(np.linspace(0, 4e-3, 5),) * 2)
    ends = {"left": lambda x: x[0] < 1e-9, "right": lambda x: x[0] > 4e-3 - 1e-9}
    sides = {"sides": lambda x: abs(x[1] - 2e-3) > 2e-3 - 1e-9}
    hole = mesh.remove_elements(
        mesh.elements_satisfying(lambda x: abs(x - 2e-3).max(axis=0) < 1e-3)
    )
    assert [*boundaries_without_name(hole.with_boundaries(ends | sides))] == [
        "a boundary of the mesh around (2 mm, 2 mm), 8 mm long, is in no group: it is closed"
    ]
    assert [*boundaries_without_name(mesh.with_boundaries(ends | sides))] == []
    assert len([*boundaries_without_name(mesh.with_boundaries(ends))]) == 2
