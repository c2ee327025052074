"""Flow through a cell along both axes: what it makes of its gaps step by step, and by which solver."""

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.ndimage import gaussian_filter

from femseal.face.cell_flow import FlowSettings, cell_permeabilities
from femseal.face.cells import CellState
from femseal.face.cut import Cut
from femseal.flow import cell_permeability
from femseal.flow.law import cubic_law

UM = 1e-6


def gaps_of(shape, seed):
    """Open, in contact, near closing, closed, of high contrast, hardly rough, parallel [m]."""
    rng = np.random.default_rng(seed)
    z = gaussian_filter(rng.normal(size=shape), 1.5)
    z /= z.std()
    gaps = [np.maximum(UM * (z + mean), 0.0) for mean in (5.0, 1.0, 0.5, 0.2, 0.0, -5.0)]
    gaps += [UM * np.exp(contrast * z) for contrast in (1.0, 4.0)]
    gaps += [UM * np.exp(8.0 * rng.normal(size=shape)), UM * (1 + 0.02 * z), UM * (1 + 1e-4 * z)]
    return np.array(gaps)


@pytest.mark.parametrize("shape", [(16, 16), (32, 32), (33, 20), (1, 24), (24, 1), (3, 150)])
@pytest.mark.parametrize("axis", [0, 1])
def test_a_cell_has_the_flow_of_its_gap(shape, axis):
    """By elimination, of a cell with mirrored sides."""
    spacing = (UM, 1.5 * UM)
    for seed in range(4):
        *gaps, parallel = gaps_of(shape, seed)
        assert_allclose(permeability(parallel, spacing, axis).k, cubic_law(parallel.mean()))
        for gap in gaps:
            found = permeability(gap, spacing, axis)
            exact = cell_permeability(gap, spacing, axis=axis, solver="elimination")
            assert_allclose(found.k, exact.value, rtol=1e-6)
            counts = found.solve_counts
            assert (counts.closed, counts.solved) == (not exact.percolates, exact.percolates)


def permeability(gap, spacing, axis):
    return cell_permeabilities(gap, spacing, axis, FlowSettings())


def test_a_cell_that_cannot_be_solved_leaves_the_others():
    """And one without a gap has no flow and is no failure."""
    gap = gaps_of((32, 32), 0)[0]
    gap[3, 4], gap[20, 20] = -UM, np.nan
    cut = Cut((0, 16, 32), (0, 16, 32), (0, 0), (UM, UM))
    state = CellState.of(gap, 0 * gap, cut, FlowSettings())
    assert [text[:19] for text in state.failures] == [
        "cell (0, 0), x1: ga",
        "cell (0, 0), x2: ga",
    ]
    assert np.isfinite(state.k[0]).tolist() == [[[False, True], [True, False]]] * 2
