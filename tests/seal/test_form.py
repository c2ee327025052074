"""Forms of a whole seal: waves, measured heights, files; and the cells over a seal."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

import femseal as fs
from femseal.base import InputError
from femseal.seal.contact_grid import ContactGrid, element_of_cells
from femseal.seal.form import FileForm, MeasuredForm, ScaledForm, WavyForm
from femseal.seal.layouts import AnnularLayout, RectangularLayout
from femseal.seal.pressure_map import Frame
from femseal.seal.tiles import PieceSize

STRIP = Frame.of_strip((2e-3, 8e-3))
RING = AnnularLayout(20e-3, 22e-3).frame((2e-3, 0.13))


def around(count=36, radius=21e-3):
    angle = np.arange(count) * (2 * np.pi / count)
    return np.stack([radius * np.cos(angle), radius * np.sin(angle)], axis=1), angle


def lattice(sides=(2e-3, 8e-3), counts=(5, 17)):
    x1, x2 = (np.linspace(0, side, n) for side, n in zip(sides, counts, strict=True))
    return np.stack(np.meshgrid(x1, x2, indexing="ij"), axis=-1).reshape(-1, 2)


def test_waves_are_as_high_as_given_and_come_around_as_often():
    points, angle = around(360)
    z = WavyForm(3e-6, lobes=2).heights(points, RING)
    assert_allclose(z, 1.5e-6 * np.cos(2 * angle), atol=1e-18)
    x2 = np.linspace(0, 8e-3, 81)
    points = np.stack([np.zeros_like(x2), x2], axis=1)
    z = WavyForm(3e-6, wavelength=2e-3).heights(points, STRIP)
    assert_allclose(z, 1.5e-6 * np.cos(2 * np.pi * x2 / 2e-3), atol=1e-18)


@pytest.mark.parametrize(
    ("given", "text"),
    [
        ({"height": 1e-6}, "lobes: given neither"),
        ({"height": 1e-6, "lobes": 2, "wavelength": 1e-3}, "lobes: given both"),
        ({"height": -1e-6, "lobes": 2}, "height: given"),
        ({"height": 1e-6, "lobes": 0}, "lobes: given 0"),
    ],
)
def test_bad_waves(given, text):
    with pytest.raises(InputError, match=text):
        WavyForm(**given)


def test_waves_longer_than_the_seal_or_of_a_length_on_a_mesh_are_refused():
    with pytest.raises(InputError, match="wavelength: given 10 mm"):
        WavyForm(1e-6, wavelength=10e-3).heights(np.zeros((1, 2)), STRIP)
    with pytest.raises(InputError, match=r"wavelength: .* on a mesh"):
        WavyForm(1e-6, wavelength=1e-3).heights(np.zeros((1, 2)), Frame())


def test_a_plane_is_no_form():
    """Clamped faces align."""
    points = lattice()
    tilted = MeasuredForm.of(points, 1e-3 * points[:, 0] - 2e-4 * points[:, 1] + 1e-6)
    assert_allclose(tilted.heights(lattice(counts=(9, 33)), STRIP), 0.0, atol=1e-8 * 1e-3)


@pytest.mark.parametrize("polar", [False, True])
def test_one_circle_of_heights_is_enough(polar):
    """What a flatness tester measures at the middle of a flange, in the plane and by radius and angle."""
    points, angle = around()
    given = np.stack([np.full(angle.size, 21e-3), angle], axis=1) if polar else points
    form = MeasuredForm.of(given, 1e-6 * np.cos(2 * angle), polar=polar)
    between, fine = around(144)
    assert_allclose(form.heights(between, RING), 1e-6 * np.cos(2 * fine), atol=0.05e-6)
    assert_allclose(form.heights(between * 20.2 / 21, RING), 1e-6 * np.cos(2 * fine), atol=0.12e-6)
    assert_allclose(form.shortest_wave, 3 * 42e-3 * np.sin(np.pi / 36), rtol=1e-9)


def test_interpolation_converges_on_finer_points():
    inside = lattice(counts=(30, 60)) * [0.9, 0.9] + [1e-4, 4e-4]
    errors = []
    for n in (5, 9, 17):
        points = lattice(counts=(n, 4 * n))
        form = MeasuredForm.of(
            points, 1e-6 * np.sin(np.pi * points[:, 0] / 2e-3) * np.cos(np.pi * points[:, 1] / 4e-3)
        )
        exact = 1e-6 * np.sin(np.pi * inside[:, 0] / 2e-3) * np.cos(np.pi * inside[:, 1] / 4e-3)
        plane = np.column_stack([np.ones(len(inside)), inside])
        exact -= plane @ np.linalg.lstsq(plane, exact)[0]
        errors.append(np.abs(form.heights(inside, STRIP) - exact).max())
    assert errors[1] < 0.6 * errors[0]
    assert errors[2] < 0.6 * errors[1]


def test_a_dense_map_is_averaged_and_keeps_its_long_waves():
    shape = (100, 400)
    spacing = (2e-5, 2e-5)
    x1, x2 = ((np.arange(n) + 0.5) * d for n, d in zip(shape, spacing, strict=True))
    heights = 1e-6 * np.cos(2 * np.pi * x2 / 8e-3) * np.ones((shape[0], 1)) + 1e-7 * np.cos(
        np.pi * x1[:, None] / 4e-5
    )
    heights[10:20, 30:40] = np.nan
    form = MeasuredForm.of_map(fs.Topography(heights, spacing, (False, False)))
    points = lattice(counts=(20, 80)) * [0.98, 0.98] + [2e-5, 8e-5]
    expected = 1e-6 * np.cos(2 * np.pi * points[:, 1] / 8e-3)
    assert_allclose(form.heights(points, STRIP) - expected, 0, atol=0.06e-6)
    assert 1e-4 < form.shortest_wave < 5e-4


def test_points_of_another_unit_do_not_cover_a_seal():
    points, angle = around()
    with pytest.raises(InputError, match=r"points that cover it, .*is their unit right"):
        MeasuredForm.of(1e3 * points, np.cos(angle)).heights(points, RING)
    with pytest.raises(InputError, match="radii and angles on a strip"):
        MeasuredForm.of(points, np.cos(angle), polar=True).heights(points, STRIP)


@pytest.mark.parametrize(
    "bad",
    [([[0, 0], [1, 1]], [0, 0]), ([[0, 0], [1, np.nan], [2, 2]], [0, 0, 0]), ([0, 1, 2], [0] * 3)],
)
def test_bad_heights(bad):
    with pytest.raises(InputError, match="form"):
        MeasuredForm.of(*bad)


def test_columns_and_maps_are_read_with_their_units(tmp_path):
    _, angle = around()
    lines = [f"21, {np.degrees(a)}, {np.cos(2 * a)}" for a in angle]
    path = tmp_path / "flatness.csv"
    path.write_text("r, theta, z\n" + "\n".join(lines))
    between, fine = around(72)
    form = FileForm(path, "um")
    assert_allclose(form.heights(between, RING), 1e-6 * np.cos(2 * fine), atol=0.05e-6)
    assert_allclose(ScaledForm(form, 3.0).heights(between, RING), 3 * form.heights(between, RING))
    with pytest.raises(InputError, match="unit: given none"):
        FileForm(path).heights(between, RING)
    path.write_text(
        "x;y;z\n" + "\n".join(f"{1e3 * x};{1e3 * y};{1e3 * x * y}" for x, y in lattice())
    )
    points = lattice(counts=(9, 9))
    z = FileForm(path, "um").heights(points, STRIP)
    product = 1e-3 * (points[:, 0] - points[:, 0].mean()) * (points[:, 1] - points[:, 1].mean())
    assert_allclose(z, product, atol=0.05 * np.abs(product).max())
    grid = tmp_path / "map.npy"
    np.save(grid, np.arange(12.0).reshape(3, 4) ** 2)
    with pytest.raises(InputError):
        FileForm(tmp_path / "none.csv", "um").heights(points, STRIP)


# cells over a seal


def tiles_of(layout, pieces=PieceSize((0.5e-3, 0.5e-3), 4, 8e-3, 2e-3)):  # noqa: B008
    return layout.lay_out(pieces)


def test_cells_of_a_strip_have_the_means_of_their_tiles():
    tiles = tiles_of(RectangularLayout())
    grid = ContactGrid.over(tiles, STRIP)
    n1, n2 = grid.tile.shape
    assert n1 * grid.spacing[0] == pytest.approx(2e-3)
    assert n2 * grid.spacing[1] == pytest.approx(8e-3)
    means = grid.means(np.moveaxis(grid.points, -1, 0))
    assert_allclose(means.T, tiles.middles, rtol=1e-9)
    along_rows = grid.means(grid.points[:, :1, 0])
    assert_allclose(along_rows, tiles.middles[:, 0], rtol=1e-9)


def test_a_seal_of_many_tiles_has_fewer_cells():
    tiles = tiles_of(RectangularLayout(), PieceSize((0.02e-3, 0.02e-3), 50, 80e-3, 2e-3))
    grid = ContactGrid.over(tiles, Frame.of_strip((2e-3, 80e-3)))
    assert grid.tile.size <= 2**15 < tiles.count
    means = grid.means(np.moveaxis(grid.points, -1, 0)).T
    assert np.abs(means - tiles.middles).max() < max(grid.spacing)


def test_cells_of_a_ring_lie_on_it_from_the_inlet_on():
    layout = AnnularLayout(20e-3, 22e-3, "outer")
    tiles = tiles_of(layout, PieceSize((0.5e-3, 0.5e-3), 4))
    grid = ContactGrid.over(tiles, layout.frame(tiles.size))
    radius = np.hypot(*np.moveaxis(grid.points, -1, 0))
    assert_allclose(radius[[0, -1], 0], [22e-3 - grid.spacing[0] / 2, 20e-3 + grid.spacing[0] / 2])
    assert grid.spacing[1] * grid.tile.shape[1] == pytest.approx(2 * np.pi * 21e-3)
    assert_allclose(grid.means(radius), np.hypot(*tiles.middles.T), rtol=1e-2)


def test_cells_lie_in_the_elements_of_a_mesh_or_outside():
    corners = np.array([[[0, 0], [4, 0], [0, 4]], [[4, 0], [4, 4], [0, 4]]], float)
    element = element_of_cells(corners, (6, 4))
    assert (element[4:] == -1).all()
    i, j = np.meshgrid(np.arange(4), np.arange(4), indexing="ij")
    below, above = i + j < 3, i + j > 3
    assert (element[:4][below] == 0).all()
    assert (element[:4][above] == 1).all()
    assert (element[:4][i + j == 3] >= 0).all()
    clockwise = element_of_cells(corners[:, ::-1].copy(), (6, 4))
    assert (clockwise[:4] >= 0).all()
