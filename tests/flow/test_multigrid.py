"""Parts of multigrid: the symmetry of its cycle, the correction of clusters, and the certified error."""

import numpy as np
import pytest
from networks import cell_links, solve_links
from numpy.testing import assert_allclose
from scipy.ndimage import gaussian_filter

from femseal.flow.percolation import prepare_links_in_place
from femseal.flow.solvers import clusters, hierarchy, multigrid


def smooth_gap(n, contact, seed):
    """Gap of filtered Gaussian noise, in contact on a fraction of the area."""
    z = gaussian_filter(np.random.default_rng(seed).standard_normal((n, n)), 4, mode="wrap")
    h = np.clip(np.quantile(z, 1 - contact) - z, 0, None)
    return h / h.max()


def levels_of(gap, sides):
    """Levels of a gap, the eliminated coarsest level, and whether the columns form a ring."""
    links = prepare_links_in_place(*cell_links(gap, (1.0, 1.0), sides))
    ring = np.bool_(sides == "periodic")
    return *multigrid.build_levels(links.along, links.across, ring), ring


@pytest.mark.parametrize("sides", ["mirror", "periodic"])
@pytest.mark.parametrize(("n", "contact"), [(62, 0.3), (65, 0.35), (96, 0.1)])
def test_the_cycle_is_symmetric(sides, n, contact):
    """Conjugate gradients require u·Mv = v·Mu for the preconditioner M."""
    levels, coarsest, ring = levels_of(smooth_gap(n, contact, 1), sides)
    rng = np.random.default_rng(2)
    finest = levels[0]
    is_open = finest.inverse[1:-1, 1:-1] > 0
    sources, results = [], []
    for _ in range(2):
        source = rng.standard_normal(is_open.shape) * is_open
        finest.b[1:-1, 1:-1] = source
        multigrid.cycle(levels, coarsest, ring)
        sources.append(source)
        results.append(finest.r[1:-1, 1:-1].astype(float))
    (u, v), (mu, mv) = sources, results
    largest = np.sqrt((u * mu).sum() * (v * mv).sum())
    assert largest > 0
    assert abs((u * mv).sum() - (v * mu).sum()) < 1e-4 * largest


def inflow(level, i, j):
    """Source of a node and its inflow from all neighbours, less the outflow, in double precision."""
    right, below, below_right, below_left = (a.astype(float) for a in level.links)
    x = level.x.astype(float)
    total = level.b[i, j] - x[i, j] / float(level.inverse[i, j])
    total += right[i, j] * x[i, j + 1] + right[i, j - 1] * x[i, j - 1]
    total += below[i, j] * x[i + 1, j] + below[i - 1, j] * x[i - 1, j]
    if below_right.size > 1:
        total += below_right[i, j] * x[i + 1, j + 1] + below_right[i - 1, j - 1] * x[i - 1, j - 1]
        total += below_left[i, j] * x[i + 1, j - 1] + below_left[i - 1, j + 1] * x[i - 1, j + 1]
    return total


def check_corrected_clusters(level, ring):
    """Correct the clusters of a random potential, and check their balance and the updated residual."""
    rng = np.random.default_rng(4)
    is_open = level.inverse[1:-1, 1:-1] > 0
    for field in (level.b, level.x):
        field[1:-1, 1:-1] = rng.standard_normal(is_open.shape) * is_open
        if ring:
            field[:, 0], field[:, -1] = field[:, -2], field[:, 1]
    level.b[:] /= np.where(level.inverse > 0, level.inverse, np.inf)
    nodes, first, *_ = level.clusters
    near = {(i + a, j + b) for i, j in nodes for a in (-1, 0, 1) for b in (-1, 0, 1)}
    near = [(i, j) for i, j in near if level.inverse[i, j] > 0]
    for i, j in near:
        level.r[i, j] = inflow(level, i, j)
    clusters.correct_clusters(level, ring, np.bool_(True))
    last = nodes[first[-2] : first[-1]]
    total = sum(1 / level.inverse[i, j] for i, j in last)
    assert abs(sum(inflow(level, i, j) for i, j in last)) < 1e-5 * total
    for i, j in nodes:
        allowed = 1e-4 / level.inverse[i, j]
        assert_allclose(level.r[i, j], inflow(level, i, j), atol=allowed)


@pytest.mark.parametrize("sides", ["mirror", "periodic"])
def test_a_corrected_cluster_is_balanced(sides):
    """The last corrected cluster has no excess, and the updated residual is that of the new potential."""
    stencils = set()
    for seed in (3, 5, 7):
        levels, _, ring = levels_of(smooth_gap(250, 0.3, seed), sides)
        for k, level in enumerate(levels):
            if level.clusters.inverse.size:
                check_corrected_clusters(level, ring)
                stencils.add("five points" if k == 0 else "nine points")
    assert stencils == {"five points", "nine points"}


def test_clusters_save_iterations(monkeypatch):
    """A gap with bays and channels that the coarse grids do not resolve."""
    links = cell_links(smooth_gap(128, 0.3, 15), (1.0, 1.0), "mirror")
    monkeypatch.setattr(multigrid, "THREADED_NODES", 0)
    with_clusters = solve_links(*links, solver="multigrid").iterations
    monkeypatch.setattr(hierarchy, "find_clusters", lambda *_: clusters.no_clusters())
    without = solve_links(*links, solver="multigrid").iterations
    assert with_clusters <= 0.75 * without


@pytest.mark.parametrize("rtol", [1e-2, 1e-4, 1e-6, 1e-8])
def test_the_error_is_certified(rtol):
    """The true error is at most the stated error, which is at most the tolerance, near closing too."""
    solved = 0
    for seed in range(12):
        contact = (0.02, 0.3, 0.4)[seed % 3]
        links = cell_links(smooth_gap(96, contact, seed), (1.0, 1.0), "mirror")
        exact = solve_links(*links, solver="elimination")
        if not exact.percolates:
            continue
        flow = solve_links(*links, solver="multigrid", rtol=rtol)
        error = flow.conductance / exact.conductance - 1
        assert -1e-12 < error <= flow.residual**2 * (1 + 1e-6) + 1e-12
        assert flow.residual**2 <= rtol
        solved += 1
    assert solved >= 6
