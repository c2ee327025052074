"""Windows on seals of any shape: closed forms, invariants, two ways to the same seal, and bad input."""

from math import pi
from pathlib import Path

import meshio
import numpy as np
import pytest
from femseal.seal.element_windows import ElementSeal, ElementWindows, combined, straightened
from femseal.seal.laid_windows import LinkWindows, Windows
from numpy.testing import assert_allclose, assert_array_equal
from skfem import MeshQuad, MeshTri

from femseal.analytic import annulus_rate, eccentric_annulus_rate, elliptic_annulus_rate, spiral_annulus_rate
from femseal.base.errors import InputError
from femseal.seal import AnnularSeal, MeshSeal, RectangularSeal
from femseal.seal.lay import Lay
from femseal.seal.layouts import AnnularLayout, MeshLayout, RectangularLayout
from femseal.seal.mesh_seal import parts_without_flow

MESHES = Path(__file__).parents[1] / "meshes"
WINDOWS = Windows((1e-4, 1e-4), 10)


def circular(kind, n, radii=(1.0, 1.5), move=None):
    """A ring of n × 8n elements with the boundaries "in" and "out"; `move` maps its points (2, n)."""
    grid = MeshQuad.init_tensor(np.linspace(0, 1, n + 1), np.arange(8 * n + 1.0))
    quads = np.round(grid.p[0] * n).astype(int) * 8 * n + np.round(grid.p[1]).astype(int) % (8 * n)
    quads = quads[grid.t]
    s, θ = (
        a.ravel() for a in np.meshgrid(np.linspace(0, 1, n + 1), 2 * pi * np.arange(8 * n) / (8 * n), indexing="ij")
    )
    r = radii[0] + (radii[1] - radii[0]) * s
    p = np.array([r * np.cos(θ), r * np.sin(θ)])
    p = p if move is None else move(p, s)
    mesh = MeshQuad(p, quads) if kind is MeshQuad else MeshTri(p, np.hstack([quads[[0, 1, 2]], quads[[0, 2, 3]]]))
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
        abs(MeshSeal(circular(kind, n, move=shifted), "in", "out").flow(2.0).conductance - exact) for n in (4, 8, 16)
    ]
    assert_allclose(order_of(errors), 2, atol=0.2)
    assert errors[-1] < 2e-3 * exact


@both_kinds
def test_anisotropic_ring_between_similar_ellipses(kind):
    k1, k2 = 3.0, 0.5
    exact = elliptic_annulus_rate(k1, k2, 1.0, 1.0, 1.0, 1.5)
    stretch = np.sqrt([[k1], [k2]] / np.sqrt(k1 * k2))
    meshes = [circular(kind, n, move=lambda p, s: stretch * p) for n in (4, 8, 16)]
    flows = [MeshSeal(m, "in", "out").flow(np.tile([k1, k2], (m.nelements, 1)), bounds=True) for m in meshes]
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
        return MeshSeal(mesh, *mesh.boundaries).flow(k(*mesh.p[:, mesh.t].mean(axis=1)), bounds=True)

    ring = AnnularSeal(1.0, 1.5, (24, 192))
    laid = LinkWindows(ring)
    reference = ring.flow(tuple(k(*np.moveaxis(laid.places(axis), -1, 0)) for axis in (0, 1))).conductance
    for kind in (MeshQuad, MeshTri):
        flow = on(circular(kind, 16))
        assert_allclose([flow.lower, flow.upper], reference, rtol=4e-3)
    file = MeshSeal(MESHES / "ring.msh", "inlet", "outlet")
    x, y = 100 * file.mesh.p[:, file.mesh.t].mean(axis=1)  # radii 10 and 15 mm
    assert_allclose(file.flow(k(x, y)).conductance, reference, rtol=5e-3)


# --- windows on elements ---


def strip_of(mesh, size):
    facets = mesh.boundary_facets()
    x = mesh.p[0][mesh.facets[:, facets]]
    ends = (facets[(x == end).all(axis=0)] for end in (0.0, size[0]))
    return ElementSeal(mesh, *ends, size, mesh.p.T[mesh.t.T])


@pytest.mark.parametrize(
    ("kind", "cells"),
    [(MeshQuad, (10, 60)), (MeshQuad, (5, 30)), (MeshTri, (7, 43)), (MeshTri, (5, 30)), (MeshTri, (3, 15))],
)
def test_a_strip_of_elements_leaks_what_a_strip_of_links_does(kind, cells):
    """The same windows, ln k normal with deviation 1, on links and on elements of 1 to 7 windows."""
    size, sigma, draws = (10.0, 60.0), 1.0, 30
    rng = np.random.default_rng(5)
    links = RectangularSeal(size, (10, 60))
    reference = np.median(
        [
            links.flow(tuple(np.exp(sigma * rng.standard_normal(s)) for s in ((10, 60), (9, 60)))).conductance
            for _ in range(draws)
        ]
    )
    seal = strip_of(
        kind.init_tensor(*(np.linspace(0, length, n + 1) for length, n in zip(size, cells, strict=True))), size
    )
    windows = ElementWindows(seal, (1.0, 1.0), Lay("x2").directions(seal.outlines.mean(axis=1)))
    assert_allclose(windows.draws[0][1], 600, rtol=0.1)
    found, upper = [], []
    for _ in range(draws):
        flow = seal.flow(windows.permeability(*np.exp(sigma * rng.standard_normal((2, *windows.draws[0])))))
        assert flow.lower <= flow.conductance <= flow.upper
        found.append(flow.conductance)
        upper.append(flow.upper)
    assert_allclose(np.median(found), reference, rtol=0.05)
    assert np.median(upper) > 1.015 * np.median(found)


def test_four_windows_are_a_bridge_of_links():
    k1, k2 = np.random.default_rng(0).lognormal(sigma=2, size=(2, 1, 2, 2))
    along, across = combined(k1, k2, (1.0, 3.0))
    # closed sides: the bridge of two columns has one link between them
    links = np.zeros((1, 2))
    links[0, 0] = k2[0, 0, 0]
    assert_allclose(along, RectangularSeal((2.0, 6.0), (2, 2)).flow((k1[0], links)).conductance / 3, rtol=1e-10)
    links[0, 0] = k1[0, 1, 1]
    assert_allclose(across, RectangularSeal((6.0, 2.0), (2, 2)).flow((k2[0].T, links)).conductance * 3, rtol=1e-10)


def test_windows_together_keep_the_median_and_close_at_one_half():
    rng = np.random.default_rng(1)
    k1, k2 = rng.lognormal(sigma=1.5, size=(2, 4000, 8, 8))
    for k in combined(k1, k2, (1.0, 1.0)):
        assert abs(np.median(np.log(k))) < 0.02
        assert np.std(np.log(k)) < 0.3
    for share, low, high in ((0.45, 0.0, 0.15), (0.5, 0.45, 0.55), (0.55, 0.85, 1.0)):
        is_open = (rng.random((2, 2000, 32, 32)) < share).astype(float)
        assert all(low <= np.mean(k > 0) <= high for k in combined(*is_open, (1.0, 1.0)))
    one = np.array([[[2.0]]])
    assert [float(k[0]) for k in combined(one, 3 * one, (1.0, 5.0))] == [2.0, 6.0]
    stripes = np.array([[[1.0, 3.0]]])
    assert_allclose(combined(stripes, stripes, (1.0, 1.0)), [[2.0], [1.5]])


@pytest.mark.parametrize("angle", [0.4, 2.5])
def test_turning_mesh_and_lay_together_changes_nothing(tmp_path, angle):
    c, s = np.cos(angle), np.sin(angle)
    mesh = meshio.read(MESHES / "racetrack.msh")
    mesh.points[:, :2] = mesh.points[:, :2] @ [[c, s], [-s, c]]
    meshio.write(tmp_path / "turned.msh", mesh, file_format="gmsh22", binary=False)
    ends = {"unit": "mm", "inlet": "inside", "outlet": "outside"}
    windows = Windows((3e-4, 6e-4), 1)
    plain = MeshLayout(MESHES / "racetrack.msh", **ends, lay={"angle": 0.3}).lay_out(windows)
    turned = MeshLayout(tmp_path / "turned.msh", **ends, lay={"angle": 0.3 + angle}).lay_out(windows)
    assert plain.draws == turned.draws
    k = np.random.default_rng(2).lognormal(size=(2, *plain.draws[0])) * [[[1.0]], [[6.0]]]
    first, second = (laid.seal.flow(laid.permeability(*k)) for laid in (plain, turned))
    assert_allclose([second.conductance, second.lower], [first.conductance, first.lower], rtol=1e-8)
    other = MeshLayout(tmp_path / "turned.msh", **ends, lay={"angle": 0.3}).lay_out(windows)
    assert abs(other.seal.flow(other.permeability(*k)).conductance / first.conductance - 1) > 1e-3


def test_a_lay_along_the_axes_is_that_of_an_angle():
    """Constant windows: links along the axes, and elements whose lay is turned by 0 or 90 degrees."""
    k = {"x1": (2.0, 7.0), "x2": (7.0, 2.0)}  # along x1 of the seal: k2 of the windows where their lay runs along it
    for name, angle in (("x1", 0.0), ("x2", pi / 2)):
        windows = Windows((1e-5, 2e-5), 8, length=2e-3)
        links, turned = (RectangularLayout(lay).lay_out(windows) for lay in (name, {"angle": angle}))
        drawn = [np.full(shape, (7.0, 2.0)[axis]) for shape, axis in zip(links.draws, links.axes, strict=True)]
        flow = links.seal.flow(links.permeability(*drawn)).conductance
        assert_allclose(flow * links.seal.size[0] / links.seal.size[1], k[name][0], rtol=1e-9)
        tensors = turned.permeability(*(np.full(turned.draws[0], value) for value in (7.0, 2.0)))
        flow = turned.seal.flow(tensors).conductance
        assert_allclose(flow * turned.seal.size[0] / turned.seal.size[1], k[name][0], rtol=1e-9)


@pytest.mark.parametrize("inlet", ["inner", "outer"])
def test_a_straight_lay_over_a_ring(inlet):
    """Equal along both axes it is the ring of one permeability; unequal, between those of both."""
    laid = AnnularLayout(1e-3, 1.5e-3, inlet, lay={"angle": 0.7}).lay_out(Windows((2e-5, 2e-5), 1))
    ones = np.ones(laid.draws[0])
    assert_allclose(laid.seal.flow(laid.permeability(3 * ones, 3 * ones)).conductance, 6 * pi / np.log(1.5), rtol=1e-3)
    uneven = laid.seal.flow(laid.permeability(ones, 9 * ones)).conductance
    assert 2 * pi / np.log(1.5) < uneven < 9 * 2 * pi / np.log(1.5)


def test_elements_of_the_second_order_are_four_straight_ones():
    seal = MeshSeal(MESHES / "bolted_ring.msh", "bore", ("rim", "bolts"), "mm")
    mesh, ends = straightened(seal.mesh, *seal.ends)
    assert mesh.nelements == 4 * seal.mesh.nelements
    assert [len(facets) for facets in ends] == [2 * len(facets) for facets in seal.ends]
    flow = ElementSeal(mesh, *ends, (1.0, 1.0), mesh.p.T[mesh.t.T]).flow(1.0)
    assert_allclose(flow.conductance, seal.flow(1.0).conductance, rtol=4e-3)
    assert_allclose([flow.lower, flow.upper], seal.flow(1.0).conductance, rtol=8e-3)
    assert flow.lower < flow.conductance < flow.upper


def test_closed_windows_seal_exactly():
    laid = MeshLayout(MESHES / "ring.msh", "m", "inlet", "outlet").lay_out(WINDOWS)
    k = np.ones(laid.draws[0])
    centres = laid.places(0)
    k[np.hypot(*np.moveaxis(centres, -1, 0)) < 11e-3] = 0.0
    flow = laid.seal.flow(laid.permeability(k, k))
    assert (flow.conductance, flow.lower, flow.percolates) == (0.0, 0.0, False)
    # closed across the lay, which runs round the bore; no side of an element runs along it
    turned = MeshLayout(MESHES / "bolted_ring.msh", "mm", "bore", "rim").lay_out(WINDOWS)
    one = np.ones(turned.draws[0])
    half = turned.seal.flow(turned.permeability(0 * one, one))
    assert (half.conductance, half.percolates, half.upper > 0) == (0.0, False, True)
    rows = AnnularLayout(10e-3, 15e-3).lay_out(WINDOWS)
    assert rows.places(0).shape == (50, 785, 2)
    assert_allclose(np.hypot(*np.moveaxis(rows.places(1), -1, 0))[0], 10.1e-3, rtol=1e-12)


# --- layouts ---


def test_sizes_and_numbers_of_windows():
    strip = RectangularLayout().lay_out(Windows((1e-5, 3e-5), 8, length=3e-3, breadth=4e-4))
    assert (strip.seal.cells, strip.axes, strip.rows) == ((40, 100), (0, 1), 40)
    along = RectangularLayout("x1").lay_out(Windows((1e-5, 3e-5), 9, length=3e-3))
    assert (along.seal.cells, along.axes, along.rows) == ((3, 300), (1, 0), 0)
    assert_allclose(along.seal.size, (9e-5, 3e-3))
    ring = AnnularLayout(1e-2, 1.1e-2, "outer").lay_out(WINDOWS)
    assert ring.seal == AnnularSeal(1e-2, 1.1e-2, (10, 660), "outer")
    radial = AnnularLayout(1e-2, 1.1e-2, lay="radial").lay_out(Windows((1e-4, 2e-4), 1))
    assert (radial.seal.cells, radial.axes) == ((5, 660), (1, 0))
    mesh = MeshLayout(MESHES / "frame.msh", "mm", "inside", ["outside"], length=0.1).lay_out(WINDOWS)
    assert_allclose(mesh.seal.size, (384e-6 / 0.1, 0.1))
    assert_allclose(mesh.draws[0][1], 384e-6 / 1e-8, rtol=0.07)  # powers of 2 whose logarithms have the right mean
    assert_allclose(mesh.places(0).shape, (1, mesh.draws[0][1], 2))
    shares = mesh.means(np.repeat(np.arange(len(mesh.outlines)), 2 ** mesh._powers.sum(axis=0))[None].astype(float))
    assert_array_equal(shares, np.arange(len(mesh.outlines)))


def test_outlines_cover_the_seal():
    def area(outlines):
        x, y = np.moveaxis(outlines, -1, 0)
        return 0.5 * np.abs((x * np.roll(y, -1, axis=1) - np.roll(x, -1, axis=1) * y).sum(axis=1)).sum()

    assert_allclose(area(RectangularLayout().lay_out(Windows((1e-5, 3e-5), 8, length=3e-3)).outlines), 8e-5 * 3e-3)
    assert_allclose(area(AnnularLayout(1e-2, 1.1e-2).lay_out(WINDOWS).outlines), pi * 21e-6, rtol=1e-4)
    assert_allclose(
        area(RectangularLayout({"angle": 1.0}).lay_out(Windows((1e-5, 1e-5), 8, length=3e-4)).outlines), 24e-9
    )


def test_lay_from_a_field(tmp_path):
    """Vectors round the bore at the points of a coarse mesh, either way: the circumferential lay."""
    places = circular(MeshQuad, 4, (10.0, 15.0)).p
    turned = np.array([-places[1], places[0], 0 * places[0]]) * np.where(places[0] > 0, 1, -3)
    quads = circular(MeshQuad, 4).t.T
    points = np.column_stack([*places, 0 * places[0]])
    meshio.write(tmp_path / "lay.vtu", meshio.Mesh(points, [("quad", quads)], point_data={"t": turned.T}))
    at = MeshSeal(MESHES / "ring.msh", "inlet", "outlet").points
    found = Lay.of({"field": "lay.vtu:t"}, tmp_path).directions(at, unit=1e-3)
    expected = Lay("circumferential").directions(at)
    assert np.abs((found * expected).sum(axis=1)).min() > np.cos(0.12)
    for key, words in (("lay.vtu:s", "'s' of .*one of its fields: 't'"), ("no.vtu:t", "an existing mesh file")):
        with pytest.raises(InputError, match=words):
            Lay.of({"field": key}, tmp_path).directions(at)
    with pytest.raises(InputError, match="which leaves out 864 elements, expected a field that covers the seal"):
        Lay.of({"field": "lay.vtu:t"}, tmp_path).directions(at + 1.0, unit=1e-3)
    turned[0, 3] = np.nan
    meshio.write(tmp_path / "nan.vtu", meshio.Mesh(points, [("quad", quads)], point_data={"t": turned.T}))
    with pytest.raises(InputError, match="vectors along the lay, finite and not 0"):
        Lay.of({"field": "nan.vtu:t"}, tmp_path).directions(at, unit=1e-3)


@pytest.mark.parametrize(
    "given", ["across", 30, {"angle": "30 mm"}, {"angle": True}, {"field": "lay.vtu"}, {"angle": 1, "field": "a:b"}]
)
def test_bad_lay(given):
    with pytest.raises(InputError, match=r"^lay"):
        Lay.of(given)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: RectangularLayout("radial"), "^lay: given 'radial' on a strip"),
        (lambda: RectangularLayout().lay_out(WINDOWS), "^length: given none"),
        (
            lambda: RectangularLayout({"angle": 1}).lay_out(Windows((1e-4, 1e-4), 4, length=2e-4)),
            "^length: given 2 windows",
        ),
        (lambda: AnnularLayout(1e-2, 1e-2), "^outer_radius: given 0.01 m, expected a number > the inner radius"),
        (lambda: AnnularLayout(10.0, 120.0), "^outer_radius: given a seal 240 m across, .* is its unit right"),
        (
            lambda: AnnularLayout(1e-2, 1.1e-2).lay_out(Windows((1e-4, 1e-4), 4, length=1.0)),
            "^length: given 1 m, expected none",
        ),
        (
            lambda: AnnularLayout(1e-2, 1.1e-2).lay_out(Windows((1e-4, 1e-4), 4, breadth=1.0)),
            "^breadth: given 1 m, expected",
        ),
        (
            lambda: AnnularLayout(1e-2, 1.1e-2).lay_out(Windows((2e-3, 1e-4), 4)),
            "^outer_radius: given a ring 1 mm broad",
        ),
        (lambda: AnnularLayout(1e-3, 1e-2).lay_out(WINDOWS), "^inner_radius: given .*18% as wide as windows"),
        (lambda: MeshLayout(MESHES / "ring.msh", "kg", "inlet", "outlet"), "^unit"),
        (
            lambda: MeshLayout(MESHES / "ring.msh", "um", "inlet", "outlet").lay_out(WINDOWS),
            "^path: given a seal 30 nm across with the unit 'um'",
        ),
        (
            lambda: MeshLayout(MESHES / "ring.msh", "cm", "inlet", "outlet").lay_out(Windows((1e-3, 1e-3), 1)),
            "^seal: given elements with sides",
        ),
        (
            lambda: MeshLayout(MESHES / "ring.msh", "m", "inlet", ("outlet", "rim")).lay_out(WINDOWS),
            "^outlet: given 'rim'",
        ),
        (lambda: MeshLayout(MESHES / "ring.msh", "m", "inlet", ()).lay_out(WINDOWS), r"^outlet: given \(\)"),
        (
            lambda: MeshLayout(MESHES / "ring.msh", "m", "inlet", "inlet").lay_out(WINDOWS),
            "^inlet and outlet: given boundaries that touch",
        ),
        (
            lambda: MeshLayout(MESHES / "none.msh", "m", "inlet", "outlet").lay_out(WINDOWS),
            "^path: given .* an existing mesh",
        ),
        (lambda: MeshLayout(MESHES / "ring.msh", "m", "inlet", "outlet", length=-1.0), "^length: given -1"),
        (lambda: Lay("radial").directions(np.zeros((1, 2))), "^lay: given 'radial' at the centre"),
    ],
)
def test_bad_shapes(make, message):
    with pytest.raises(InputError, match=message) as error:
        make()
    assert "\n" not in str(error.value)


def test_elements_near_the_size_of_a_window_are_warned_of():
    (told,) = MeshLayout(MESHES / "ring.msh", "m", "inlet", "outlet").lay_out(Windows((1e-3, 1.5e-3), 1)).warnings
    assert "elements with sides of 0.5" in told
    (told,) = AnnularLayout(1e-3, 3e-3).lay_out(WINDOWS).warnings
    assert "50% as wide as windows" in told


def test_parts_of_a_mesh_that_nothing_flows_through_are_warned_of():
    strip = MeshQuad.init_tensor(np.linspace(0, 2e-3, 3), np.linspace(0, 1e-3, 2))
    mesh = (strip + strip.translated((3e-3, 0.0)) + strip.scaled(0.5).translated((6e-3, 0.0))).with_boundaries(
        {"in": lambda x: x[0] == 0, "out": lambda x: np.isin(x[0], (2e-3, 5e-3))}
    )
    seal = MeshSeal(mesh, "in", "out")
    assert [*parts_without_flow(mesh, *seal.ends)] == [
        "a part of the mesh around (4 mm, 500 µm), 2 of 4.5 mm², touches no inlet: nothing flows there",
        "a part of the mesh around (6.5 mm, 250 µm), 0.5 of 4.5 mm², touches neither inlet nor outlet: "
        "nothing flows there",
    ]
