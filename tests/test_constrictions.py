"""Where the pressure drops: shares of links in chains and side by side, and of windows of a resolved face."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from femseal import analytic
from femseal.base.errors import InputError
from femseal.flow import cell_permeability
from femseal.fluids import IdealGas, Liquid
from femseal.results import assemble, open_results, save
from femseal.seal import AnnularSeal, RectangularSeal, drop_fractions, largest_fractions, seal_leakage
from femseal.studies import Scene, two_scale
from femseal.topography import self_affine
from femseal.windows import Partition, window_dissipation

WATER = Liquid(1e-3)


def shares(seal, k1, k2, counts):
    return drop_fractions(k1, k2, seal, seal.flow((k1, k2)).potential, counts)


class TestNetwork:
    @pytest.mark.parametrize("n", [1, 2, 7])
    def test_equal_links_of_a_chain_take_equal_parts(self, n):
        seal = RectangularSeal((n * 1e-3, 2e-3), (n, 1))
        expected = [min(m / n, 1) for m in (1, 3, 10)]
        assert_allclose(shares(seal, 2e-18, 0.0, (1, 3, 10)), expected, rtol=1e-12)

    @pytest.mark.parametrize("narrower", [3.0, 1e3, 1e9])
    def test_one_narrow_link_of_a_chain(self, narrower):
        """m of m + n − 1 lengths of equal links."""
        n = 6
        k1 = np.full((n, 1), 1e-18)
        k1[4] /= narrower
        seal = RectangularSeal((3e-3, 1e-3), (n, 1))
        total = narrower + n - 1
        assert_allclose(shares(seal, k1, 0.0, (1, 2, 6)), [narrower / total, (narrower + 1) / total, 1.0], rtol=1e-12)

    def test_links_of_unequal_length_take_parts_as_their_lengths(self):
        seal = RectangularSeal((4e-3, 1e-3), (3, 1), rows=(0.0, 0.5e-3, 3e-3, 4e-3))
        assert_allclose(shares(seal, 1e-18, 0.0, (1, 2, 3)), [2.5 / 4, 3.5 / 4, 1.0], rtol=1e-12)

    def test_chains_side_by_side(self):
        """Flow² / k: of three links k = 2 with the flow 2/3, 2/9 each; of k = 1, ½, 1 with 1/4, 1/16, 1/8, 1/16."""
        k1 = 1e-18 * np.array([[2.0, 1.0], [2.0, 0.5], [2.0, 1.0]])
        seal = RectangularSeal((3e-3, 2e-3), (3, 2))
        total = 11 / 12
        expected = np.array([2 / 9, 6 / 9, 6 / 9 + 1 / 8, total]) / total
        assert_allclose(shares(seal, k1, 0.0, (1, 3, 4, 6)), expected, rtol=1e-12)

    @pytest.mark.parametrize("first", [1.0, 0.5])
    def test_link_across_counts(self, first):
        """A path that has to change columns: resistances `first`, two of 10 side by side as wide as 1 mm, the rest."""
        k1 = 1e-18 * np.array([[1.0, 0.0], [0.0, 1.0]])
        seal = RectangularSeal((2e-3, 2e-3), (2, 2), rows=(0.0, first * 1e-3, 2e-3))
        k2 = np.full((1, 2), 0.1e-18)
        assert_allclose(shares(seal, k1, k2, (1, 2, 3)), [2.5 / 7, 5 / 7, (7 - first) / 7], rtol=1e-12)

    @pytest.mark.parametrize(
        "seal",
        [
            RectangularSeal((3e-3, 8e-3), (6, 10), (0, 2e-4, 1e-3, 1.1e-3, 2e-3, 2.9e-3, 3e-3)),
            AnnularSeal(10e-3, 15e-3, (6, 10)),
        ],
    )
    def test_all_links_dissipate_the_whole_flow(self, seal):
        rng = np.random.default_rng(3)
        k = [1e-18 * np.exp(2 * rng.standard_normal(s)) * (rng.random(s) > 0.2) for s in ((6, 10), (5, 10))]
        flow = seal.flow(tuple(k))
        stencil = seal.stencil(tuple(k))
        c1, c2 = stencil.along, stencil.across
        φ = np.nan_to_num(flow.potential)
        energy = np.r_[(c1 * np.diff(φ, axis=0) ** 2).ravel(), (c2 * (np.roll(φ, -1, 1) - φ)[1:-1] ** 2).ravel()]
        assert_allclose(energy.sum(), flow.conductance, rtol=1e-7)
        expected = np.sort(energy)[::-1].cumsum()[[0, 2, 9, 109]] / flow.conductance
        assert_allclose(shares(seal, *k, (1, 3, 10, 1000)), expected, rtol=1e-7)

    def test_unit_of_the_potential_does_not_matter(self):
        rng = np.random.default_rng(1)
        k = tuple(1e-18 * np.exp(rng.standard_normal(s)) for s in ((4, 5), (3, 5)))
        seal, air = RectangularSeal((1e-3, 1e-3), (4, 5)), IdealGas(18e-6, 0.029, 293.0)
        expected = shares(seal, *k, (1, 3, 10))
        water = seal_leakage(seal, k, WATER, inlet_pressure=5e6, outlet_pressure=1e5)
        assert_allclose(drop_fractions(*k, seal, water.fluid_pressure), expected, rtol=1e-9)
        gas = seal_leakage(seal, k, air, inlet_pressure=5e6, outlet_pressure=1e5)
        assert_allclose(drop_fractions(*k, seal, air.potential(gas.fluid_pressure)), expected, rtol=1e-9)

    def test_no_share_of_no_flow(self):
        seal = RectangularSeal((3e-3, 2e-3), (3, 2))
        k1 = np.full((3, 2), 1e-18)
        k1[1] = 0
        assert np.isnan(shares(seal, k1, 1e-18, (1, 3))).all()

    def test_bad_input(self):
        seal = RectangularSeal((3e-3, 2e-3), (3, 2))
        with pytest.raises(InputError, match=r"potential: given shape \(3, 2\), expected shape \(4, 2\)"):
            drop_fractions(1e-18, 1e-18, seal, np.ones((3, 2)))
        with pytest.raises(InputError, match="k1"):
            drop_fractions(-1e-18, 1e-18, seal, np.ones((4, 2)))
        with pytest.raises(InputError, match="counts: given 0, expected a whole number >= 1"):
            largest_fractions([1.0], counts=(0,))


class TestWindows:
    SPACING = (1e-6, 1.5e-6)

    def test_wave_across_the_leakage(self):
        """One flow through all of h(x1): a window takes the share of ∫ h⁻³ dx1 over it, with uneven lines too."""
        n, m2 = 192, 2
        partition = Partition((n, 16), self.SPACING, (4, m2), lines=(0, 40, 100, 150, 192))

        def h(x):
            return 1e-6 * (1 + 0.6 * np.cos(2 * np.pi * (x - 0.2)))

        gap = np.repeat(h((np.arange(n) + 0.5) / n)[:, None], 16, axis=1)
        found = window_dissipation(gap, partition)
        assert found.shape == (4, m2)
        assert_allclose(found[:, 0], found[:, 1], rtol=1e-9)
        fine = h((np.arange(100 * n) + 0.5) / (100 * n)) ** -3
        expected = np.add.reduceat(fine, 100 * np.array(partition.lines[:-1])) / fine.sum()
        assert_allclose(found.sum(axis=1) / found.sum(), expected, rtol=2e-3)
        k = analytic.wavy_gap_across(1e-6, 0.6)
        assert_allclose(found.sum(), k * 16 * self.SPACING[1] / (n * self.SPACING[0]), rtol=1e-3)

    def test_channels_along_the_leakage(self):
        """Side by side windows take the share of ⟨h³⟩, one after the other equal ones."""
        gap = np.tile(1e-6 * (1.2 + np.sin(np.arange(48))), (32, 1))
        found = window_dissipation(gap, Partition((32, 48), self.SPACING, (4, 3)))
        expected = (gap[0] ** 3).reshape(3, 16).sum(axis=1) / (gap[0] ** 3).sum() / 4
        assert_allclose(found / found.sum(), np.tile(expected, (4, 1)), rtol=1e-6)

    @pytest.mark.parametrize("level", [-0.5, -0.1])
    def test_sum_is_the_flow(self, level):
        """On a gap with contact and pockets, for uneven lines."""
        z = self_affine((64, 96), (64e-6, 96e-6), hurst=0.8, rms_height=1e-6, roll_off=30e-6, rng=4).heights
        gap = np.maximum(z - level * 1e-6, 0.0)
        k = cell_permeability(gap, (1e-6, 1e-6), sides="periodic")
        assert k.percolates
        assert np.isnan(k.fluid_pressure).any()
        partition = Partition((64, 96), (1e-6, 1e-6), (4, 6), lines=(0, 14, 33, 47, 64))
        found = window_dissipation(gap, partition)
        assert_allclose(found.sum(), k.value * 96 / 64, rtol=1e-6)
        # each pixel has half of the links to both sides: nothing is left or right
        assert_allclose(window_dissipation(gap[:, ::-1], partition), found[:, ::-1], atol=1e-5 * found.max())

    def test_dissipation_lies_where_the_channel_is_narrow(self):
        """One channel of ten pixels, two in the window (1, 2)."""
        gap = np.zeros((32, 48))
        gap[:, 16:26] = 1e-6
        gap[8:16, 16:24] = 0
        found = window_dissipation(gap, Partition((32, 48), self.SPACING, (4, 3)))
        assert_array_equal(found[:, [0, 2]], 0)
        assert np.argmax(found[:, 1]) == 1
        assert found[1, 1] > found.sum() / 4
        gap[:, 24:] = 0
        assert_array_equal(window_dissipation(gap, Partition((32, 48), self.SPACING, (4, 3))), 0)

    def test_bad_input(self):
        partition = Partition((32, 48), self.SPACING, (4, 3))
        with pytest.raises(InputError, match=r"gap: given shape \(32, 32\), expected shape \(32, 48\)"):
            window_dissipation(np.ones((32, 32)), partition)
        with pytest.raises(InputError, match="gap"):
            window_dissipation(-np.ones((32, 48)), partition)


@pytest.fixture(scope="module")
def study():
    face = self_affine((64, 96), (64e-6, 96e-6), hurst=0.8, rms_slope=0.2, roll_off=30e-6, rng=5)
    scene = Scene(
        face,
        115e9,
        3e9,
        IdealGas(18e-6, 0.029, 293.0),
        1e6,
        1e5,
        loading=(1e8, 6e8, 1.5e9),
        unload_from=(1.5e9,),
        unloading=(1e8,),
    )
    return scene, two_scale(scene, (4, 6))


class TestDataset:
    def test_shares_of_a_run(self, study, tmp_path):
        scene, result = study
        save(assemble(scene, two_scale=result), tmp_path)
        data = open_results(tmp_path).dataset
        assert data["drop_fraction"].dims == ("step", "narrowest")
        assert_array_equal(data["narrowest"], [1, 3, 10])
        seal = RectangularSeal(scene.surface.size, (4, 6), result.partition.node_rows)
        for s in range(4):
            expected = shares(seal, result.k1[s], result.k2[s], (1, 3, 10))
            assert_allclose(data["drop_fraction"][s], expected, rtol=1e-6, equal_nan=True)
        found = data["drop_fraction"].values[result.leakage > 0]
        assert len(found) >= 3
        assert (np.diff(found, axis=1) > 0).all()

    def test_failed_and_sealed_steps_have_none(self, study):
        scene, result = study
        k1, leakage, pressure = result.k1.copy(), result.leakage.copy(), result.fluid_pressure.copy()
        k1[0, 0, 0] = leakage[0] = pressure[0] = np.nan
        k1[1, 2], leakage[1] = 0.0, 0.0
        seal = RectangularSeal(scene.surface.size, (4, 6), result.partition.node_rows)
        pressure[1] = scene.leakage(seal, (k1[1], result.k2[1])).fluid_pressure
        broken = replace(result, k1=k1, leakage=leakage, fluid_pressure=pressure)
        assert np.isnan(assemble(scene, two_scale=broken).dataset["drop_fraction"][:2]).all()
