"""Tiles of strips, rings and meshes: closed forms, what closes a seal, how cells are drawn, and faults."""

from dataclasses import replace

import numpy as np
import pytest
from mesh_files import write_gmsh
from numpy.testing import assert_allclose, assert_array_equal
from skfem import MeshTri

from femseal.base import InputError
from femseal.seal import AnnularLayout, MeshLayout, RectangularLayout
from femseal.seal.tiles import CellSize, face_tiles, harmonic_row_means

A = 1e-4
CELL = CellSize((A, A), 3, length=9 * A)


def wide(rows=4, columns=9, lay="x2"):
    return RectangularLayout(lay).lay_out(replace(CELL, length=columns * A, breadth=rows * A))


def ring(lay="circumferential", inlet="inner", inner=1e-3, outer=1.4e-3, sides=(A, A)):
    return AnnularLayout(inner, outer, inlet, lay=lay).lay_out(CellSize(sides, 3))


def conductance(tiles, k1, k2=None):
    k1 = np.broadcast_to(k1, tiles.count)
    k = tiles.permeability(k1, k1 if k2 is None else np.broadcast_to(k2, tiles.count))
    return tiles.seal.flow(k, bounds=True).conductance


def ring_file(folder, n):
    """A quarter of a ring of triangles in millimetres, with its ends, as Gmsh writes it."""
    mesh = MeshTri.init_tensor(np.linspace(1, 1.4, n + 1), np.linspace(0, np.pi / 2, 4 * n + 1))
    r, angle = mesh.p
    points = np.stack([r * np.cos(angle), r * np.sin(angle)], axis=1)
    inner, outer = (
        mesh.facets_satisfying(lambda x, at=at: np.isclose(x[0], at)) for at in (1, 1.4)
    )
    write_gmsh(folder / "seal.msh", mesh, points, **{"in": inner, "out": outer})
    return folder / "seal.msh"


@pytest.mark.parametrize("columns", [1, 2, 3, 9])
def test_equal_tiles_of_a_strip_are_the_closed_form(columns):
    tiles = wide(4, columns)
    per_length = conductance(tiles, 2e-18) / tiles.seal.length
    assert_allclose(per_length, 2e-18 / (4 * A), rtol=1e-7)
    assert tiles.size == pytest.approx((4 * A, columns * A))


@pytest.mark.parametrize("inlet", ["inner", "outer"])
def test_equal_tiles_of_a_ring_are_the_closed_form(inlet):
    exact = 2 * np.pi * 3e-19 / np.log(1.4)
    assert_allclose(conductance(ring(inlet=inlet), 3e-19), exact, rtol=1e-7)
    assert_allclose(conductance(ring("x1", inlet), 3e-19), exact, rtol=1e-7)


def test_equal_tiles_of_triangles_are_the_closed_form(tmp_path):
    """A quarter of a ring with the second order of its edges."""
    errors = []
    for n in (4, 8, 16):
        layout = MeshLayout(ring_file(tmp_path, n), "mm", "in", "out", lay="x1")
        found = conductance(layout.lay_out(CellSize((A, A), 3)), 1e-18)
        errors.append(abs(found / (np.pi / 2 * 1e-18 / np.log(1.4)) - 1))
    assert errors[2] < 1e-4
    assert errors[0] / errors[2] == pytest.approx(16, rel=0.2)


@pytest.mark.parametrize(
    ("lay", "share"),
    [("x2", 0.0), ("x1", 1.0), ({"angle": np.pi / 6}, 0.75), ({"angle": 2.0}, np.cos(2.0) ** 2)],
)
def test_the_lay_turns_the_permeability(lay, share):
    """k1 sin² + k2 cos² of the angle from x1, on a strip along which nothing changes."""
    tiles = wide(lay=lay)
    assert_allclose(
        conductance(tiles, 1e-18, 5e-18) / tiles.seal.length * 4 * A,
        (1 + 4 * share) * 1e-18,
        rtol=1e-6,
    )


@pytest.mark.parametrize("inlet", ["inner", "outer"])
def test_the_lay_of_a_ring_chooses_the_permeability(inlet):
    lays = "circumferential", "radial", "x1", "x2"
    found = [
        conductance(ring(lay, inlet), 1e-18, 5e-18) * np.log(1.4) / (2 * np.pi) for lay in lays
    ]
    assert_allclose(found[:2], [1e-18, 5e-18], rtol=1e-7)
    assert_allclose(found[2], found[3], rtol=1e-2)
    assert 2 * 5 / (1 + 5) < found[2] / 1e-18 < (1 + 5) / 2


def test_a_groove_that_winds_adds_its_own_way():
    """k1 cos²α + k2 sin²α, of tiles in a row by their harmonic mean; no lead, none of it."""
    lead, k2 = 2 * A, np.exp(np.random.default_rng(0).normal(0, 1, (4, 9)))
    tiles = wide(lay={"kind": "spiral", "lead": lead})
    tangent = lead / (9 * A)
    assert_allclose(tiles.tangent, tangent)
    rows = 1 / np.mean(1 / k2, axis=1)
    found = conductance(tiles, 1e-30, k2.ravel()) / tiles.seal.length
    assert_allclose(found, 1 / np.sum(A / (tangent**2 * rows / (1 + tangent**2))), rtol=1e-6)
    short = wide(lay={"kind": "spiral", "lead": lead, "circumference": 1.0})
    assert_allclose(conductance(short, 1.0, 3.0), conductance(wide(), 1.0), rtol=1e-6)
    assert_array_equal(harmonic_row_means(np.array([[1.0, 0.0], [2.0, 2.0]])), [0.0, 2.0])


@pytest.mark.parametrize(
    "tiles", [wide(4, 8), ring(), ring("x1")], ids=["strip", "ring", "ring x1"]
)
def test_a_closed_row_closes_the_seal(tiles):
    row = np.ones(tiles.grid)
    row[2] = 0
    corners = (np.indices(tiles.grid).sum(axis=0) % 2).astype(float)
    for k in (row, corners) if tiles.grid[1] % 2 == 0 else (row,):
        assert conductance(tiles, k.ravel()) == 0
        k[2, 1] = k[1, 1] = k[0, 0] = k[3, 1] = k[0, 1] = 1  # a way through sides
        assert conductance(tiles, k.ravel()) > 0


def test_half_closed_tiles_carry_along_their_open_axis_alone():
    tiles = wide()
    assert conductance(tiles, 0.0, 1e-18) == 0
    assert_allclose(conductance(tiles, 1e-18, 0.0), 1e-18 * 9 / 4, rtol=1e-6)
    across = wide(lay="x1")
    assert conductance(across, 1e-18, 0.0) == 0
    one = np.zeros(tiles.grid)
    one[:, 3] = 1e-18
    assert_allclose(conductance(tiles, one.ravel(), 0.0), 1e-18 / 4, rtol=1e-6)


def test_an_open_seal_goes_over_into_a_closed_one_without_a_jump():
    """The limit at which elements count as closed changes the way of solution, not the leakage."""
    tiles = wide(3, 5)
    k = np.exp(np.random.default_rng(0).normal(0, 1, tiles.count))
    k[7] = 2e-12 * k.max()
    before = conductance(tiles, k)
    k[7] = 0.5e-12 * k.max()
    assert_allclose(conductance(tiles, k), before, rtol=1e-5)


def test_a_longer_seal_begins_with_the_tiles_of_a_shorter_one():
    """In place, rows draw from their own row."""
    for rows in (3, 4):
        short, long = (
            t.choose_cells((3, 5), np.random.default_rng(7)).reshape(t.grid)
            for t in (wide(rows, 9), wide(rows, 30))
        )
        assert_array_equal(short, long[:, :9])
        if rows == 3:
            assert_array_equal(long // 5, np.repeat(np.arange(3)[:, None], 30, axis=1))
            assert set(long[1]) == set(range(5, 10))


def test_every_cell_is_drawn_as_often_and_independent_of_its_neighbour():
    """By chi², of which 99.9 % are below 31 with 11 degrees of freedom, 200 with 143."""
    tiles = wide(10, 2000)
    drawn = tiles.choose_cells((3, 4), np.random.default_rng(1)).reshape(tiles.grid)
    beside, below = drawn[:, 1:] * 12 + drawn[:, :-1], drawn[1:] * 12 + drawn[:-1]
    for numbers, kinds, most in ((drawn, 12, 31.3), (beside, 144, 200), (below, 144, 200)):
        count, expected = np.bincount(numbers.ravel(), minlength=kinds), numbers.size / kinds
        assert ((count - expected) ** 2 / expected).sum() < most


def test_cells_stay_in_order_where_the_seal_is_like_the_face_alone():
    """Not where a lay does not run along the seal, or where grooves wind."""
    outer, turned = 1e-3 + 3 * A, ("x1", {"angle": 1.0}, {"kind": "spiral", "lead": A})
    assert wide(3).in_order
    assert ring(outer=outer).in_order
    assert not wide(4).in_order
    assert not any(wide(3, lay=lay).in_order for lay in turned)
    assert not any(ring(lay, outer=outer).in_order for lay in ("radial", "x2", *turned))


def test_elements_much_larger_than_cells_are_warned_of(tmp_path):
    """The largest is the outermost half of a quadrilateral, 0.1 mm broad and up to 0.14 mm long."""
    layout = MeshLayout(ring_file(tmp_path, 4), "mm", "in", "out")

    def scatter_warnings(side):
        texts = layout.lay_out(CellSize((side, side), 4)).warnings
        return [text for text in texts if "scatters too much" in text]

    side = 2e-5
    (text,) = scatter_warnings(side)
    angle = np.pi / 2 / 16
    largest = 0.5 * 1.4e-3 * 0.1e-3 * np.sin(angle)
    assert f"where up to {largest / side**2:.0f} cells of 20 µm have room" in text
    assert f"by a factor of up to {np.sqrt(largest) / side:.2g}:" in text
    assert "over 100% of the seal" in text
    assert "-clmax 0.02," in text
    for fitting in (6e-5, 1e-3):
        assert scatter_warnings(fitting) == []


def test_scatter_grows_with_the_root_of_the_cells_for_which_an_element_has_room(tmp_path):
    """Seals of independent log-normal permeabilities: elements of four times the area, twice the scatter."""
    deviations = []
    rng = np.random.default_rng(3)
    for n in (6, 12):
        tiles = MeshLayout(ring_file(tmp_path, n), "mm", "in", "out").lay_out(
            CellSize((1e-6, 1e-6), 4)
        )
        k = np.exp(rng.normal(0, 0.5, (60, tiles.count)))
        rates = [tiles.seal.flow(tiles.permeability(one, one)).conductance for one in k]
        deviations.append(np.log(rates).std())
    assert_allclose(deviations[0] / deviations[1], 2, rtol=0.35)


def test_elements_smaller_than_a_cell_share_its_tile(tmp_path):
    layout = MeshLayout(ring_file(tmp_path, 8), "mm", "in", "out")
    fine, coarse = (layout.lay_out(CellSize((s, s), 3)) for s in (1e-6, 2 * A))
    assert fine.count == len(fine.tile)
    assert coarse.count < 2.5 * np.pi / 4 * (1.4e-3**2 - 1e-3**2) / (2 * A) ** 2
    middles = coarse.outlines.mean(axis=1)
    for n in range(coarse.count):
        assert np.ptp(middles[coarse.tile == n], axis=0).max() <= 2 * A
    k = np.exp(np.random.default_rng(0).normal(0, 1, (2, coarse.count)))
    assert_array_equal(coarse.permeability(*k), k.T[coarse.tile])


@pytest.mark.parametrize(
    "tiles", [wide(lay={"angle": 0.4}), ring("x1"), ring(inlet="outer")], ids=["strip", "in", "out"]
)
def test_the_flux_carries_the_leakage(tiles):
    """Through every row it is the rate, up to what the middles of tiles do not see."""
    k = tiles.permeability(*np.exp(np.random.default_rng(0).normal(0, 0.5, (2, tiles.count))))
    flow = tiles.seal.flow(k, bounds=True)
    flux, centre = (
        tiles.flux(k, 3 * flow.potential, 3 * flow.conductance) / 3,
        tiles.outlines.mean(axis=1),
    )
    radius = np.hypot(*centre.T)
    around = centre[:, 0].max() < 5 * A  # a strip
    across = flux[:, 0] if around else (flux * centre).sum(axis=1) / radius
    width = tiles.seal.length / tiles.grid[1] if around else 2 * np.pi * radius / tiles.grid[1]
    rows = (across * width).reshape(tiles.grid).sum(axis=1)
    inward = -1 if not around and tiles.outlines[0, 0] @ tiles.outlines[0, 0] > 1.3e-3**2 else 1
    assert_allclose(inward * rows, flow.conductance, rtol=0.1)


def test_faults_of_sizes():
    with pytest.raises(InputError, match="at least as wide as a cell"):
        ring(outer=1e-3 + 0.5 * A)
    with pytest.raises(InputError, match="a mesh can have tiles of equal width"):
        ring(inner=1e-5)
    with pytest.raises(InputError, match="cross the seal within a turn"):
        wide(lay={"kind": "spiral", "lead": 5 * A})
    assert "too narrow" in ring(inner=2e-4, outer=8e-4).warnings[0]


def test_the_cells_of_a_face_lie_in_their_order():
    tiles = face_tiles((2.0, 6.0), (2, 3))
    assert tiles.in_order
    assert_allclose(tiles.middles, [[0.5 + i, 1 + 2 * j] for i in range(2) for j in range(3)])
    k = np.arange(1.0, 7.0)
    # columns that hardly exchange, in series along x1 and beside each other along x2: the lower bound is exact
    found = tiles.seal.flow(tiles.permeability(k, np.full(6, 1e-9)), bounds=True)
    exact = 2 * (1 / (1 / k.reshape(2, 3)).sum(axis=0)).sum()
    assert_allclose(found.lower, exact, rtol=1e-6)
    assert_allclose(found.conductance, exact, rtol=1e-2)


def test_a_ring_of_which_a_part_is_drawn_is_as_long_as_the_whole():
    tiles = AnnularLayout(1e-2, 1.04e-2).lay_out(CellSize((A, A), 4, most_tiles=200))
    assert tiles.covered_fraction < 0.5
    assert_allclose(tiles.size, (4e-4, 2 * np.pi * 1.02e-2), rtol=1e-3)
