"""Open paths through a gap: the critical constriction, and the fraction that percolates."""

import numpy as np
import pytest
from gaps_of_cells import cut_by_plane
from networks import cell_links, solve_links

from femseal.base import InputError
from femseal.flow import (
    cell_permeability,
    critical_constriction,
    permeability_tensor,
)

D = 1e-6


@pytest.mark.parametrize("shape", [(2**15, 2**15), (2**30, 1), (1, 2**30)])
@pytest.mark.parametrize(
    "function", [cell_permeability, permeability_tensor, critical_constriction]
)
def test_a_gap_with_more_links_than_can_be_numbered_is_refused_before_any_work(function, shape):
    # an array of a single number, which takes no memory
    gap = np.broadcast_to(1e-6, shape)
    with pytest.raises(InputError, match=r"gap: given shape .* at most 2147483647 links"):
        function(gap, (1e-6, 1e-6))


@pytest.mark.parametrize("sides", ["mirror", "periodic"])
@pytest.mark.parametrize("axis", [0, 1])
@pytest.mark.parametrize("seed", range(4))
def test_without_the_critical_link_the_widest_path_is_closed(sides, axis, seed):
    """Links as wide as it percolate, those wider than it do not; it lies where it says."""
    h = cut_by_plane((24, 21), 0.15, seed, cut=5)
    found = critical_constriction(h, (D, 2 * D), axis=axis, sides=sides)
    d1, d2 = (D, 2 * D) if axis == 0 else (2 * D, D)
    c1, c2 = cell_links(h if axis == 0 else h.T, (d1, d2), sides)
    h1, h2 = np.cbrt(12 * c1 * d1 / d2), np.cbrt(12 * c2 * d2 / d1)
    h1[[0, -1]] /= np.cbrt(2)
    for least, percolates in (((1 - 1e-9) * found.gap, True), ((1 + 1e-9) * found.gap, False)):
        assert solve_links(c1 * (h1 >= least), c2 * (h2 >= least)).percolates == percolates
    i, j = np.array(found.position)[[axis, 1 - axis]] / (d1, d2)
    there = h1[int(i), int(j)] if i % 1 == 0 else h2[int(i), round(j) - 1]
    assert there == pytest.approx(found.gap, rel=1e-12)


def test_constriction_of_a_channel_with_a_neck():
    h = np.zeros((12, 9))
    h[:, 3:6] = 2 * D
    h[7, 3:6] = 0, D / 2, 0
    found = critical_constriction(h, (D, 3 * D))
    cubic = (9 * (0.5 + 2) - 2 - 2) / 16 * D
    assert found.gap == pytest.approx(cubic)
    assert found.position[0] in (7 * D, 8 * D)
    assert found.position[1] == 4.5 * 3 * D
    assert critical_constriction(np.where(h == D / 2, 0, h), (D, D)) is None
    assert critical_constriction(h, (D, D), axis=1) is None


def test_percolating_fraction():
    h = np.full((10, 8), D)
    assert cell_permeability(h, (D, D)).percolating_fraction == 1
    h[:, 3] = 0  # two channels
    h[2:5, 5:8] = 0
    h[3, 6] = D  # a pocket
    assert cell_permeability(h, (D, D)).percolating_fraction == pytest.approx((80 - 10 - 9) / 80)
    h[7] = 0
    assert cell_permeability(h, (D, D)).percolating_fraction == 0
