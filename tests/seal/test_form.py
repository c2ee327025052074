"""Forms of a whole seal: waves, measured heights, files; and the cells over a seal."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

import femseal as fs
from femseal.base import InputError
from femseal.seal import AnnularLayout, FileForm, Frame, MeasuredForm, RectangularLayout, WavyForm
from femseal.seal.contact_grid import ContactGrid
from femseal.seal.form import ScaledForm
from femseal.seal.tiles import CellSize

STRIP = Frame.for_strip((2e-3, 8e-3))
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
    ("given", "frame", "text"),
    [
        ({"height": 1e-6}, RING, "lobes: given neither"),
        ({"height": 1e-6, "lobes": 2, "wavelength": 1e-3}, RING, "lobes: given both"),
        ({"height": -1e-6, "lobes": 2}, RING, "height: given"),
        ({"height": 1e-6, "lobes": 0}, RING, "lobes: given 0"),
        ({"height": 1e-6, "wavelength": 10e-3}, STRIP, "wavelength: given 10 mm"),
        ({"height": 1e-6, "wavelength": 1e-3}, Frame(), r"wavelength: .* on a mesh"),
    ],
)
def test_bad_waves(given, frame, text):
    with pytest.raises(InputError, match=text):
        WavyForm(**given).heights(np.zeros((1, 2)), frame)


def test_a_plane_is_no_form():
    """Clamped faces align."""
    points = lattice()
    tilted = MeasuredForm.from_points(points, 1e-3 * points[:, 0] - 2e-4 * points[:, 1] + 1e-6)
    assert_allclose(tilted.heights(lattice(counts=(9, 33)), STRIP), 0.0, atol=1e-8 * 1e-3)


@pytest.mark.parametrize("polar", [False, True])
def test_one_circle_of_heights_is_enough(polar):
    """What a flatness tester measures at the middle of a flange, in the plane and by radius and angle."""
    points, angle = around()
    given = np.stack([np.full(angle.size, 21e-3), angle], axis=1) if polar else points
    form = MeasuredForm.from_points(given, 1e-6 * np.cos(2 * angle), polar=polar)
    between, fine = around(144)
    assert_allclose(form.heights(between, RING), 1e-6 * np.cos(2 * fine), atol=0.05e-6)
    assert_allclose(form.heights(between * 20.2 / 21, RING), 1e-6 * np.cos(2 * fine), atol=0.12e-6)
    assert_allclose(form.shortest_wave, 3 * 42e-3 * np.sin(np.pi / 36), rtol=1e-9)


def test_interpolation_converges_on_finer_points():
    def height(x):
        return 1e-6 * np.sin(np.pi * x[:, 0] / 2e-3) * np.cos(np.pi * x[:, 1] / 4e-3)

    inside = lattice(counts=(30, 60)) * [0.9, 0.9] + [1e-4, 4e-4]
    plane = np.column_stack([np.ones(len(inside)), inside])
    exact = height(inside)
    exact -= plane @ np.linalg.lstsq(plane, exact)[0]
    errors = []
    for n in (5, 9, 17):
        points = lattice(counts=(n, 4 * n))
        found = MeasuredForm.from_points(points, height(points)).heights(inside, STRIP)
        errors.append(np.abs(found - exact).max())
    assert errors[2] < 0.6 * errors[1] < 0.36 * errors[0]


def test_a_dense_map_is_averaged_and_keeps_its_long_waves():
    x1, x2 = ((np.arange(n) + 0.5) * 2e-5 for n in (100, 400))
    short = 1e-7 * np.cos(np.pi * x1[:, None] / 4e-5)
    heights = 1e-6 * np.cos(2 * np.pi * x2 / 8e-3) + short
    heights[10:20, 30:40] = np.nan
    form = MeasuredForm.from_map(fs.Topography(heights, (2e-5, 2e-5), (False, False)))
    points = lattice(counts=(20, 80)) * [0.98, 0.98] + [2e-5, 8e-5]
    expected = 1e-6 * np.cos(2 * np.pi * points[:, 1] / 8e-3)
    assert_allclose(form.heights(points, STRIP) - expected, 0, atol=0.06e-6)
    assert 1e-4 < form.shortest_wave < 5e-4


@pytest.mark.parametrize(
    ("points", "heights", "more", "text"),
    [
        (
            1e3 * around()[0],
            np.ones(36),
            {},
            r"points that cover the seal, .*is the unit of the points right",
        ),
        (around()[0], np.ones(36), {"polar": True}, "radii and angles on a strip"),
        ([[0, 0], [1, 1]], [0, 0], {}, "form"),
        ([[0, 0], [1, np.nan], [2, 2]], [0, 0, 0], {}, "form"),
        ([0, 1, 2], [0] * 3, {}, "form"),
    ],
)
def test_bad_heights(points, heights, more, text):
    with pytest.raises(InputError, match=text):
        MeasuredForm.from_points(points, heights, **more).heights(lattice(), STRIP)


def test_columns_are_read_with_their_units(tmp_path):
    _, angle = around()
    path = tmp_path / "flatness.csv"
    columns = np.stack([np.full(angle.size, 21), np.degrees(angle), np.cos(2 * angle)], axis=1)
    np.savetxt(path, columns, delimiter=", ", header="r, theta, z", comments="")
    between, fine = around(72)
    form = FileForm(path, "um")
    assert_allclose(form.heights(between, RING), 1e-6 * np.cos(2 * fine), atol=0.05e-6)
    assert_allclose(ScaledForm(form, 3.0).heights(between, RING), 3 * form.heights(between, RING))
    with pytest.raises(InputError, match="unit: given none"):
        FileForm(path).heights(between, RING)
    columns = np.c_[1e3 * lattice(), 1e3 * lattice().prod(axis=1)]
    np.savetxt(path, columns, delimiter=";", header="x;y;z", comments="")
    points = lattice(counts=(9, 9))
    product = 1e-3 * (points - points.mean(axis=0)).prod(axis=1)
    found = FileForm(path, "um").heights(points, STRIP)
    assert_allclose(found, product, atol=0.05 * np.abs(product).max())
    with pytest.raises(InputError):
        FileForm(tmp_path / "none.csv", "um").heights(points, STRIP)


# cells over a seal


def tiles_of(layout, cells=CellSize((0.5e-3, 0.5e-3), 4, 8e-3, 2e-3)):  # noqa: B008
    return layout.lay_out(cells)


@pytest.mark.parametrize(
    ("length", "cell", "rtol"),
    [
        (8e-3, CellSize((0.5e-3, 0.5e-3), 4, 8e-3, 2e-3), 1e-9),
        (80e-3, CellSize((2e-5, 2e-5), 50, 80e-3, 2e-3), None),
    ],
)
def test_cells_of_a_strip_have_the_means_of_their_tiles(length, cell, rtol):
    """Of many tiles there are fewer cells."""
    tiles = tiles_of(RectangularLayout(), cell)
    grid = ContactGrid.over(tiles, Frame.for_strip((2e-3, length)))
    assert_allclose(np.multiply(grid.tile.shape, grid.spacing), (2e-3, length))
    means = grid.means(np.moveaxis(grid.points, -1, 0)).T
    if rtol:
        assert_allclose(means, tiles.middles, rtol=rtol)
    else:
        assert grid.tile.size <= 2**15 < tiles.count
        assert np.abs(means - tiles.middles).max() < max(grid.spacing)


def test_cells_of_a_ring_lie_on_it_from_the_inlet_on():
    layout = AnnularLayout(20e-3, 22e-3, "outer")
    tiles = tiles_of(layout, CellSize((0.5e-3, 0.5e-3), 4))
    grid = ContactGrid.over(tiles, layout.frame(tiles.size))
    radius = np.hypot(*np.moveaxis(grid.points, -1, 0))
    assert_allclose(radius[[0, -1], 0], [22e-3 - grid.spacing[0] / 2, 20e-3 + grid.spacing[0] / 2])
    assert grid.spacing[1] * grid.tile.shape[1] == pytest.approx(2 * np.pi * 21e-3)
    assert_allclose(grid.means(radius), np.hypot(*tiles.middles.T), rtol=1e-2)
