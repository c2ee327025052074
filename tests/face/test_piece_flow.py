"""Flow through a piece along both axes: what it makes of its gaps step by step, and by which solver."""

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.ndimage import gaussian_filter

from femseal.face.piece_flow import FlowSettings
from femseal.flow import solve_flow
from femseal.flow.assembly import assemble_on_links
from femseal.flow.coefficient import permeability_on_links
from femseal.flow.grid import Grid
from femseal.flow.law import cubic_law
from femseal.studies.two_scale import _flows_of_piece

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
    """Open, in contact, near closing, closed, of high contrast, hardly rough, parallel, undefined, and two of them again [m]."""
    rng = np.random.default_rng(seed)
    z = gaussian_filter(rng.normal(size=shape), 1.5)
    z /= z.std()
    steps = [np.maximum(UM * (z + mean), 0.0) for mean in (5.0, 1.0, 0.5, 0.2, 0.0, -5.0)]
    steps += [UM * np.exp(contrast * z) for contrast in (1.0, 4.0)]
    steps += [
        UM * np.exp(8.0 * rng.normal(size=shape)),
        UM * (1 + 0.02 * z),
        UM * (1 + 1e-4 * z),
        np.where(z > 0, UM, np.nan),
    ]
    return np.array([*steps, steps[1], steps[5]], dtype=np.float32)


@pytest.mark.parametrize("shape", [(16, 16), (32, 32), (33, 20), (1, 24), (24, 1), (3, 150)])
def test_a_piece_has_the_flow_of_every_step(shape):
    spacing = (UM, 1.5 * UM)
    solvers = set()
    for seed in range(4):
        gaps = gaps_of(shape, seed)
        found = _flows_of_piece(gaps, None, spacing, FlowSettings())
        systems, closed = {}, 0
        for axis in (0, 1):
            for s, gap in enumerate(gaps.astype(float)):
                if s == 10:
                    assert_allclose(found.k[axis, s], cubic_law(gap.mean()), rtol=1e-14)
                elif s == 11:
                    assert np.isnan(found.k[axis, s])
                else:
                    k, flow = by_numpy(gap, spacing, axis)
                    assert_allclose(found.k[axis, s], k, rtol=1e-13)
                    assert_allclose(k, by_numpy(gap, spacing, axis, "elimination")[0], rtol=1e-6)
                    if s < 10:
                        systems[flow.solver] = systems.get(flow.solver, 0) + flow.percolates
                        closed += not flow.percolates
        assert found.failures == ()
        counts = found.counts
        assert (counts.closed, counts.open, counts.equal, counts.solved) == (closed, 2, 4, 20 - closed)
        assert counts.solvers.by_solver() == {name: n for name, n in systems.items() if n}
        solvers |= systems.keys()
    assert shape != (32, 32) or solvers >= {"elimination", "multigrid", "none"}


def test_a_step_that_cannot_be_solved_leaves_the_others():
    gaps = gaps_of((16, 16), 0)[:3]
    gaps[1, 3, 4] = -UM
    found = _flows_of_piece(gaps, None, (UM, UM), FlowSettings())
    assert [text[:15] for text in found.failures] == ["x1, step 1: gap", "x2, step 1: gap"]
    assert np.isfinite(found.k).tolist() == [[True, False, True]] * 2
