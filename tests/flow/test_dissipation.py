"""Where the pressure drops: dissipation in the cells of a face."""

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from femseal import analytic
from femseal.base import InputError
from femseal.face.cut import Cut
from femseal.flow import cell_permeability
from femseal.flow.dissipation import pixel_dissipation
from femseal.gases import IdealGas
from femseal.studies import Scene, two_scale
from femseal.topography import Topography, self_affine


def of_cells(gap, cut):
    """Dissipation in the cells of a face."""
    k = cell_permeability(gap, cut.spacing, sides="periodic", field_rtol=1e-6)
    found = pixel_dissipation(gap, cut.spacing, k.fluid_pressure)
    return cut.sums(found)


class TestCells:
    SPACING = (1e-6, 1.5e-6)

    def test_wave_across_the_leakage(self):
        """One flow through all of h(x1): a cell takes the share of ∫ h⁻³ dx1 over it."""
        n, m2 = 192, 2
        cut = Cut.of(Topography(np.zeros((n, 16)), self.SPACING), (4, m2))

        def h(x):
            return 1e-6 * (1 + 0.6 * np.cos(2 * np.pi * (x - 0.2)))

        gap = np.repeat(h((np.arange(n) + 0.5) / n)[:, None], 16, axis=1)
        found = of_cells(gap, cut)
        assert found.shape == (4, m2)
        assert_allclose(found[:, 0], found[:, 1], rtol=1e-9)
        fine = h((np.arange(100 * n) + 0.5) / (100 * n)) ** -3
        expected = fine.reshape(4, -1).sum(axis=1) / fine.sum()
        assert_allclose(found.sum(axis=1) / found.sum(), expected, rtol=2e-3)
        k = analytic.wavy_gap_across(1e-6, 0.6)
        assert_allclose(found.sum(), k * 16 * self.SPACING[1] / (n * self.SPACING[0]), rtol=1e-3)

    def test_channels_along_the_leakage(self):
        """Side by side cells take the share of ⟨h³⟩, one after the other equal ones."""
        gap = np.tile(1e-6 * (1.2 + np.sin(np.arange(48))), (32, 1))
        found = of_cells(gap, Cut.of(Topography(np.zeros((32, 48)), self.SPACING), (4, 3)))
        expected = (gap[0] ** 3).reshape(3, 16).sum(axis=1) / (gap[0] ** 3).sum() / 4
        assert_allclose(found / found.sum(), np.tile(expected, (4, 1)), rtol=1e-6)

    @pytest.mark.parametrize("level", [-0.5, -0.1])
    def test_sum_is_the_flow(self, level):
        """On a gap with contact and pockets."""
        z = self_affine(
            (64, 96), (64e-6, 96e-6), hurst=0.8, rms_height=1e-6, roll_off=30e-6, rng=4
        ).heights
        gap = np.maximum(z - level * 1e-6, 0.0)
        k = cell_permeability(gap, (1e-6, 1e-6), sides="periodic")
        assert k.percolates
        assert np.isnan(k.fluid_pressure).any()
        cut = Cut.of(Topography(np.zeros((64, 96)), (1e-6, 1e-6)), (4, 6))
        found = of_cells(gap, cut)
        assert_allclose(found.sum(), k.value * 96 / 64, rtol=1e-6)
        # each pixel has half of the links to both sides: nothing is left or right
        assert_allclose(of_cells(gap[:, ::-1], cut), found[:, ::-1], atol=1e-5 * found.max())

    def test_dissipation_lies_where_the_channel_is_narrow(self):
        """One channel of ten pixels, two in the cell (1, 2)."""
        gap = np.zeros((32, 48))
        gap[:, 16:26] = 1e-6
        gap[8:16, 16:24] = 0
        found = of_cells(gap, Cut.of(Topography(np.zeros((32, 48)), self.SPACING), (4, 3)))
        assert_array_equal(found[:, [0, 2]], 0)
        assert np.argmax(found[:, 1]) == 1
        assert found[1, 1] > found.sum() / 4
        gap[:, 24:] = 0
        assert_array_equal(
            of_cells(gap, Cut.of(Topography(np.zeros((32, 48)), self.SPACING), (4, 3))), 0
        )

    def test_bad_input(self):
        with pytest.raises(InputError, match="gap"):
            pixel_dissipation(-np.ones((32, 48)), self.SPACING, np.ones((32, 48)))


@pytest.fixture(scope="module")
def study():
    face = self_affine((64, 96), (64e-6, 96e-6), hurst=0.8, rms_slope=0.2, roll_off=30e-6, rng=5)
    gas = IdealGas(18e-6, 0.029, 293.0, slip=False)
    loads = {"loading": (1e8, 6e8, 1.5e9), "unload_from": (1.5e9,), "unloading": (1e8,)}
    return two_scale(Scene(face, 115e9, 3e9, gas, 1e6, 1e5, **loads), (4, 6))


def test_fractions_of_a_run(study):
    """They lie where the permeability is low, and are unknown where nothing flows."""
    flows = study.leakage > 0
    assert flows.sum() >= 3
    fractions = study.cells.drop_fraction
    assert np.isnan(fractions[~flows]).all()
    for s in np.flatnonzero(flows):
        expected = of_cells(study.gap[s].astype(float), study.cells.cut)
        assert_allclose(fractions[s], expected / expected.sum(), atol=2e-3)
