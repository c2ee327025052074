"""Flow through a piece along both axes: what it makes of its gaps step by step, and by which solver."""

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.ndimage import gaussian_filter

from femseal.face.piece_flow import FlowSettings, piece_permeability
from femseal.face.pieces import Cut, PieceState
from femseal.flow import solve_flow
from femseal.flow.assembly import assemble_on_links
from femseal.flow.coefficient import permeability_on_links
from femseal.flow.grid import Grid
from femseal.flow.law import cubic_law

UM = 1e-6


def by_numpy(gap, spacing, axis, solver="auto"):
    """Permeability of a gap from its links, which numpy assembles, and the flow through them."""
    h, (d1, d2) = (gap, spacing) if axis == 0 else (np.ascontiguousarray(gap.T), spacing[::-1])
    scale, size = h.max() or 1.0, max(spacing)
    grid = Grid.of_pixel_centres(h.shape, (d1 / size, d2 / size), "mirror")
    stencil = assemble_on_links(grid, *permeability_on_links(h / scale, False, False))
    flow = solve_flow(stencil, solver=solver)
    return scale**3 * flow.conductance * (h.shape[0] * d1) / (h.shape[1] * d2), flow


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
def test_a_piece_has_the_flow_of_its_gap(shape):
    spacing = (UM, 1.5 * UM)
    solvers = set()
    for seed in range(4):
        for s, gap in enumerate(gaps_of(shape, seed)):
            for axis in (0, 1):
                found = piece_permeability(gap, spacing, axis, FlowSettings())
                counts = found.counts
                if s == 10:
                    assert_allclose(found.k, cubic_law(gap.mean()), rtol=1e-14)
                    assert (counts.closed, counts.open, counts.solved) == (0, 1, 0)
                    continue
                k, flow = by_numpy(gap, spacing, axis)
                assert_allclose(found.k, k, rtol=1e-13)
                assert_allclose(k, by_numpy(gap, spacing, axis, "elimination")[0], rtol=1e-6)
                assert (counts.closed, counts.open, counts.solved) == (
                    not flow.percolates,
                    0,
                    flow.percolates,
                )
                assert counts.solvers.by_solver() == ({flow.solver: 1} if flow.percolates else {})
                solvers |= {flow.solver}
    assert shape != (32, 32) or solvers >= {"elimination", "multigrid", "none"}


def test_a_piece_that_cannot_be_solved_leaves_the_others():
    """And one without a gap has no flow and is no failure."""
    gap = gaps_of((32, 32), 0)[0]
    gap[3, 4], gap[20, 20] = -UM, np.nan
    cut = Cut((0, 16, 32), (0, 16, 32), (0, 0), (UM, UM))
    state = PieceState.of(gap, 0 * gap, cut, FlowSettings())
    assert [text[:20] for text in state.failures] == [
        "piece (0, 0), x1: ga",
        "piece (0, 0), x2: ga",
    ]
    assert np.isfinite(state.k[0]).tolist() == [[[False, True], [True, False]]] * 2
