"""Random and large cells: every choice of the solver against elimination, which is exact to rounding. Slow."""

import numpy as np
import pytest
from networks import cell_links, solve_links
from numpy.testing import assert_allclose

from femseal import cell_permeability, self_affine

D = 1e-6
KINDS = ("cut by a plane", "white noise", "log-normal", "one channel", "stretched pixels")


def hard_links(seed):
    """A cell of 24 to 200 pixels a side that is nearly closed, rough at the pixel, of extreme contrast or stretched."""
    rng = np.random.default_rng([11, seed])
    kind = KINDS[seed % len(KINDS)]
    shape = tuple(int(n) for n in rng.integers(24, 200, 2))
    roll_off = max(9 * D, min(shape) * D / rng.uniform(1, 6))
    size = (shape[0] * D, shape[1] * D)
    z = self_affine(shape, size, hurst=0.8, rms_slope=0.2, roll_off=roll_off, cut_off=8 * D, rng=seed).heights
    spacing = (D, D)
    if kind == "white noise":
        z = rng.standard_normal(shape)
        h = np.maximum(np.quantile(z, 1 - rng.uniform(0, 0.42)) - z, 0)
    elif kind == "log-normal":
        h = np.exp(rng.uniform(0.5, 6) * z / z.std())
        h[h < np.quantile(h, rng.uniform(0, 0.4))] = 0
    elif kind == "one channel":
        h = np.maximum(np.quantile(z, 1 - rng.uniform(0.3, 0.6)) - z, 0)
        column = rng.integers(shape[1])
        h[:, column] = np.maximum(h[:, column], h.max() * 10 ** -rng.uniform(0, 5))
    else:
        h = np.maximum(np.quantile(z, 1 - rng.uniform(0, 0.5)) - z, 0)
        if kind == "stretched pixels":
            spacing = (D, D * 10 ** rng.uniform(-1, 1))
    return cell_links(h / h.max(), spacing, ("mirror", "periodic")[seed // len(KINDS) % 2])


@pytest.mark.slow
@pytest.mark.parametrize("block", range(10))
def test_random_cells_whatever_the_solver_chosen(block):
    for seed in range(100 * block, 100 * (block + 1)):
        c1, c2 = hard_links(seed)
        exact = solve_links(c1, c2, solver="elimination")
        for rtol in (1e-3, 1e-6):
            chosen = solve_links(c1, c2, rtol=rtol)
            assert chosen.percolates == exact.percolates
            assert_allclose(
                chosen.conductance, exact.conductance, rtol=rtol, err_msg=f"seed {seed}, {KINDS[seed % len(KINDS)]}"
            )
        balanced = solve_links(c1, c2, field_rtol=1e-6)
        assert_allclose(balanced.conductance, exact.conductance, rtol=1e-6)
        assert max(balanced.imbalance, exact.imbalance) <= 1e-5


@pytest.mark.slow
@pytest.mark.parametrize("share", [0.05, 0.35])
def test_4096_pixels_a_side(share):
    n = 4096
    z = self_affine((n, n), (n * D, n * D), hurst=0.8, rms_slope=0.2, roll_off=n * D / 4, cut_off=8 * D, rng=1).heights
    h = np.maximum(np.quantile(z[::8, ::8], 1 - share) - z, 0)
    k = cell_permeability(h, (D, D), sides="periodic", field_rtol=1e-6)
    assert 0 < k.iterations < 200
    assert_allclose(cell_permeability(h, (D, D), sides="periodic").value, k.value, rtol=1e-6)
    # in every section the same flow
    c1, _ = cell_links(h, (D, D), "periodic")
    p = np.nan_to_num(k.fluid_pressure)
    sections = (c1[1:-1] * (p[:-1] - p[1:])).sum(axis=1)
    assert_allclose(sections, k.value, rtol=1e-4)
