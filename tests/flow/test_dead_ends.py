"""Dead ends of a network: found, and given the potential of the node that they hang on."""

import numpy as np
from networks import cell_links, network, restricted
from numpy.testing import assert_allclose

from femseal.flow import solve_flow
from femseal.flow.percolation import dead_ends, fill_dead_ends, nodes_reached

D = 1e-6


def test_dead_ends_carry_nothing_and_have_the_potential_they_hang_on():
    dead = 0
    for seed in range(60):
        rng = np.random.default_rng([23, seed])
        shape = tuple(int(n) for n in rng.integers(2, 40, 2))
        h = (rng.random(shape) < rng.uniform(0.6, 0.95)) * rng.uniform(0.5, 1, shape)
        stencil = network(*cell_links(h, (D, D), ("mirror", "periodic")[seed % 2]))
        keep = nodes_reached(stencil.along, stencil.across) == 3
        if not keep[0].any():
            continue
        exact = solve_flow(stencil, solver="elimination")
        left, ends = dead_ends(restricted(stencil, keep), keep)
        flow = solve_flow(restricted(stencil, left), solver="elimination")
        assert_allclose(flow.conductance, exact.conductance, rtol=1e-13)
        φ = np.where(left, flow.potential, np.nan)[1:-1].copy()
        fill_dead_ends(φ, ends, 1.0, 0.0)
        assert_allclose(φ[keep[1:-1]], exact.potential[1:-1][keep[1:-1]], atol=1e-10)
        # something flows at every other node
        along, across = restricted(stencil, left).dissipation(flow.potential)
        sides = across if across.shape[1] == along.shape[1] else np.pad(across, ((0, 0), (0, 1)))
        assert np.all((along[1:] + along[:-1] + sides + np.roll(sides, 1, axis=1))[left[1:-1]] > 0)
        dead += ends[0].size
    assert dead > 500
