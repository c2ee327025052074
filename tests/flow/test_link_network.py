"""Link networks: solvers against each other and against scikit-fem, closed forms, exact duality, any contrast."""

import re

import numpy as np
import pytest
from networks import cell_links, solve_links
from numpy.testing import assert_allclose, assert_array_equal
from scipy.ndimage import gaussian_filter
from scipy.sparse.csgraph import connected_components

from femseal import analytic
from femseal.base import InputError, NotConverged
from femseal.flow import Stencil, solve_flow
from femseal.flow.solvers.thresholds import MOST_MULTIGRID_ITERATIONS

SHAPES = [(1, 1), (1, 6), (6, 1), (2, 2), (2, 3), (7, 5), (5, 7), (20, 16)]


def links(n1, n2, periodic, seed=0, contrast=1e2, closed=0.0):
    rng = np.random.default_rng(seed)
    c1 = contrast ** rng.random((n1, n2))
    c2 = contrast ** rng.random((n1 - 1, n2 if periodic else n2 - 1))
    return c1 * (rng.random(c1.shape) >= closed), c2 * (rng.random(c2.shape) >= closed)


def laplacian(c1, c2):
    """Rate and potential from the dense graph Laplacian; NaN without an open link to an end."""
    n1, n2 = c1.shape
    node = np.arange((n1 + 1) * n2).reshape(n1 + 1, n2)
    beside = np.roll(node, -1, axis=1)[1:-1, : c2.shape[1]]
    a = np.r_[node[:-1].ravel(), node[1:-1, : c2.shape[1]].ravel()]
    b, c = np.r_[node[1:].ravel(), beside.ravel()], np.r_[c1.ravel(), c2.ravel()]
    drops = np.zeros((c.size, node.size))
    np.add.at(drops, (np.arange(c.size), a), 1.0)
    np.add.at(drops, (np.arange(c.size), b), -1.0)
    matrix = drops.T @ (c[:, None] * drops)
    _, part = connected_components(matrix != 0)
    p = np.where(node.ravel() < n2, 1.0, np.where(np.isin(part, part[node[[0, -1]]]), 0.0, np.nan))
    free = np.setdiff1d(np.flatnonzero(np.isfinite(p)), node[[0, -1]])
    if free.size:
        p[free] = np.linalg.solve(matrix[np.ix_(free, free)], -matrix[np.ix_(free, node[0])].sum(1))
    known = np.nan_to_num(p)
    return known @ matrix @ known, p.reshape(node.shape)


@pytest.mark.parametrize("shape", SHAPES)
@pytest.mark.parametrize("periodic", [True, False])
@pytest.mark.parametrize(
    ("closed", "wall"), [(0.0, None), (0.25, None), (0.5, None), (0.3, 0), (0.3, -1), (1.0, None)]
)
def test_solvers_and_an_independent_solution_agree(shape, periodic, closed, wall):
    """Where nothing flows an end gives its potential exactly, and a pocket has none."""
    c1, c2 = links(*shape, periodic, seed=sum(shape), closed=closed)
    if wall is not None:
        c1[wall] = 0
    rate, potential = laplacian(c1, c2)
    for solver in ("elimination", "multigrid", "auto"):
        direct = solver == "elimination"
        flow = solve_links(c1, c2, solver=solver, rtol=1e-10, field_rtol=1e-6)
        assert flow.percolates == (flow.conductance > 0)
        assert_allclose(flow.conductance, rate, rtol=1e-9, atol=1e-12)
        assert_allclose(flow.potential, potential, rtol=0, atol=1e-10 if direct else 1e-5)
        assert_array_equal(flow.potential[[0, -1]], [[1.0] * shape[1], [0.0] * shape[1]])
        if not flow.percolates:
            assert set(np.unique(flow.potential[np.isfinite(flow.potential)])) <= {0.0, 1.0}
        assert_allclose(flow.complement, 1 - flow.potential, rtol=0, atol=1e-12)
        sections = np.nansum(c1 * -np.diff(flow.potential, axis=0), axis=1)
        assert_allclose(sections, rate, rtol=1e-10 if direct else 1e-3, atol=1e-5)
    assert flow.imbalance <= 1e-5


@pytest.mark.parametrize("shape", [(60, 48), (48, 61), (31, 67), (9, 80), (80, 9)])
@pytest.mark.parametrize("periodic", [True, False])
def test_iterative_solution_of_a_larger_network(shape, periodic):
    c1, c2 = links(*shape, periodic, 1, contrast=1e4, closed=0.2)
    flow = solve_links(c1, c2, solver="multigrid", rtol=1e-6, field_rtol=1e-6)
    assert flow.iterations > 0
    assert_allclose(
        flow.conductance, solve_links(c1, c2, solver="elimination").conductance, rtol=1e-6
    )
    assert flow.imbalance <= 1e-5


@pytest.mark.parametrize("shape", [(64, 64), (200, 128), (127, 255), (40, 300)])
@pytest.mark.parametrize("periodic", [True, False])
def test_multigrid_takes_few_iterations_on_a_smooth_gap(shape, periodic):
    """Also on odd rings, whose last and first column are neighbours on every coarser grid."""
    n1, n2 = shape
    x, y = np.arange(n1 + 1)[:, None] / n1, np.arange(n2) / n2
    c = (1.2 + np.cos(2 * np.pi * 3 * y) * np.cos(2 * np.pi * 2 * x)) ** 3
    c1, c2 = c[:-1], c[1:-1] if periodic else c[1:-1, :-1]
    exact = solve_links(c1, c2, solver="elimination").conductance
    for asked, rtol, most in (({"field_rtol": 1e-6}, 1e-11, 15), ({"rtol": 1e-6}, 1e-6, 8)):
        flow = solve_links(c1, c2, solver="multigrid", **asked)
        assert_allclose(flow.conductance, exact, rtol=rtol)
        assert 0 < flow.iterations <= most


@pytest.mark.parametrize("closed", [0.0, 0.3])
@pytest.mark.parametrize("periodic", [True, False])
def test_multigrid_is_what_is_chosen_for_large_open_networks(closed, periodic):
    x, y = np.arange(130)[:, None] / 129, np.arange(129) / 129
    h = np.sin(2 * np.pi * (2 * x + y)) * np.sin(2 * np.pi * (x - 2 * y))
    h = np.maximum(h - np.quantile(h, closed), 0 if closed else 0.1)
    c1, c2 = cell_links(h, (1.0, 1.0), "periodic" if periodic else "mirror")
    flow = solve_links(c1, c2)
    assert flow.iterations > 0
    exact = solve_links(c1, c2, solver="elimination").conductance
    assert_allclose(flow.conductance, exact, rtol=1e-6)


@pytest.mark.parametrize("periodic", [True, False])
def test_series_and_parallel(periodic):
    rng = np.random.default_rng(4)
    c1, c2 = links(8, 6, periodic)
    # equal links in each section: nothing crosses, sections in series
    section = 10 ** rng.uniform(-3, 3, 8)
    flow = solve_links(np.repeat(section[:, None], 6, axis=1), c2)
    assert_allclose(flow.conductance, 6 / np.sum(1 / section), rtol=1e-12)
    assert_allclose(flow.conductance, 6 / 8 * analytic.stripes_across(section), rtol=1e-12)
    # no links across: columns in parallel
    flow = solve_links(c1, 0 * c2)
    assert_allclose(flow.conductance, np.sum(1 / np.sum(1 / c1, axis=0)), rtol=1e-12)
    # links across without resistance: rows in series
    flow = solve_links(c1, np.full_like(c2, 1e30))
    assert_allclose(flow.conductance, 1 / np.sum(1 / c1.sum(axis=1)), rtol=1e-12)


@pytest.mark.parametrize("contrast", [1.0, 1e3, 1e12, 1e30, 1e60])
@pytest.mark.parametrize("shape", [(2, 2), (5, 5), (12, 7)])
def test_exact_duality(contrast, shape):
    """Between closed sides the planar dual has the inverse links, turned: the two rates multiply to 1."""
    c1, c2 = links(*shape, False, seed=5, contrast=contrast)
    flow, dual = solve_links(c1, c2), solve_links(1 / c1.T, 1 / c2.T)
    assert_allclose(flow.conductance * dual.conductance, 1.0, rtol=1e-12)


def test_large_periodic_map_of_log_symmetric_links():
    c1, c2 = links(320, 320, True, seed=7, contrast=1e4)
    exact = analytic.log_symmetric_links(np.concatenate([c1.ravel(), c2.ravel()]))
    # the first and the last links lead to straight edges, hence the slack of some 1/n
    assert_allclose(solve_links(c1, c2).conductance, exact, rtol=0.03)


@pytest.mark.parametrize("contrast", [1e6, 1e20, 1e60])
@pytest.mark.parametrize("where", [0, 3, 7])
@pytest.mark.parametrize("periodic", [True, False])
def test_constriction_of_any_contrast(contrast, where, periodic):
    """All rows wide but one: the rate is that of the row of narrow links between two equipotentials."""
    c1, c2 = links(8, 6, periodic, seed=8)
    c1[where] /= contrast
    flow = solve_links(c1, c2)
    assert_allclose(flow.conductance, c1[where].sum(), rtol=1e3 / contrast + 1e-13)
    assert flow.imbalance < 1e-12


@pytest.mark.parametrize("solver", ["elimination", "multigrid"])
def test_pockets_and_dead_ends_carry_nothing(solver):
    c1, c2 = np.zeros((6, 8)), np.zeros((5, 8))
    c1[:, 2] = 1.0
    c1[2:4, 6], c2[1:3, 5] = 1e6, 1e6  # a pocket
    c1[:3, 4] = 1e6  # a dead end on the inlet
    c2[2, 2] = 1e6  # one on the path
    flow = solve_links(c1, c2, solver=solver)
    assert_allclose(flow.conductance, 1 / 6, rtol=1e-12)


@pytest.mark.parametrize(
    ("c1", "c2", "options", "word"),
    [
        (np.full((3, 3), np.nan), np.ones((2, 3)), {}, "along"),
        (np.ones((3, 3)), np.full((2, 3), np.nan), {}, "across"),
        (-np.ones((3, 3)), np.ones((2, 3)), {}, "along"),
        (np.full((3, 3), np.inf), np.ones((2, 3)), {}, "along"),
        (np.ones((3, 3)), np.ones((2, 5)), {}, "across"),
        ([[1, 2], [3]], np.ones((1, 2)), {}, "along"),
        (np.full((2, 2), 1j), np.ones((1, 2)), {}, "along"),
        (np.ones((3, 3)), np.ones((2, 3)), {"rtol": 0}, "rtol"),
        (np.ones((3, 3)), np.ones((2, 3)), {"rtol": "fine", "solver": "multigrid"}, "rtol"),
        (np.ones((2, 2)), np.ones((1, 2)), {"solver": "cholesky"}, "solver.*elimination"),
    ],
)
def test_bad_input_is_named(c1, c2, options, word):
    with pytest.raises(InputError, match=word):
        solve_flow(Stencil.network(c1, c2, ring=True), **options)


@pytest.mark.parametrize("scale", [1e-310, 1e-200, 1e-60, 1e100, 1e300])
@pytest.mark.parametrize("solver", ["elimination", "multigrid", "auto"])
@pytest.mark.parametrize("n", [6, 70])
def test_any_unit_of_the_conductances(scale, solver, n):
    flow = solve_links(np.full((n, n), scale), np.full((n - 1, n), scale), solver=solver)
    assert_allclose(flow.conductance, scale, rtol=1e-9)


def test_contrasts_that_a_double_bears():
    """Chains in series, whose resistances add, at conductances down to 1e-150."""
    rng = np.random.default_rng(2)
    for _ in range(20):
        c1 = 10.0 ** rng.uniform(-150, 0, (9, 4))
        flow = solve_links(c1, np.zeros((8, 3)), solver="elimination")
        assert_allclose(flow.conductance, (1 / (1 / c1).sum(axis=0)).sum(), rtol=1e-12)


@pytest.mark.parametrize("width", [1e-2, 1e-3, 1e-5])
def test_islands_are_eliminated_behind_multigrid(width):
    """Two that hang on each other, in a slope of the pressure."""
    h = np.ones((48, 60))
    h[6:25, 6:15] = width
    h[8:15, 8:13] = h[17:23, 8:13] = 1
    c1, c2 = cell_links(h, (1.0, 1.0), "mirror")
    flow = solve_links(c1, c2, solver="multigrid", field_rtol=1e-6)
    exact = solve_links(c1, c2, solver="elimination")
    assert flow.iterations > 0
    assert_allclose(flow.conductance, exact.conductance, rtol=1e-9)
    assert_allclose(flow.potential, exact.potential, rtol=0, atol=1e-5)
    assert_allclose(flow.complement, exact.complement, rtol=0, atol=1e-5)


def filtered_gap(n, wave, contact, seed):
    """Gaps of Gaussian noise filtered over so many pixels, in contact on a fraction."""
    z = gaussian_filter(np.random.default_rng(seed).standard_normal((n, n)), wave, mode="wrap")
    h = np.clip(z - np.quantile(z, contact), 0, None)
    return h / h.max()


@pytest.mark.parametrize(("wave", "contact", "seed"), [(4, 0.3, 10), (1, 0.38, 1), (1.5, 0.42, 2)])
def test_a_part_of_the_error_that_few_iterations_do_not_meet_is_seen(wave, contact, seed):
    """A pool behind narrow links; near closing hundreds of iterations are needed."""
    links = cell_links(filtered_gap(256, wave, contact, seed), (1.0, 1.0), "mirror")
    exact = solve_links(*links, solver="elimination").conductance
    flow = solve_links(*links, solver="multigrid")
    assert_allclose(flow.conductance, exact, rtol=1e-6)
    assert flow.residual**2 < 1e-6


def test_a_hopeless_iteration_is_given_up_early():
    c1, c2 = links(70, 70, True, 5, contrast=1e12, closed=0.1)
    # the smaller the tolerance, the earlier it is clear that it cannot be reached
    with pytest.raises(NotConverged) as caught:
        solve_links(c1, c2, solver="multigrid", rtol=1e-12)
    iterations = int(re.search(r"after (\d+) iterations", str(caught.value))[1])
    assert iterations < MOST_MULTIGRID_ITERATIONS / 2


def test_multigrid_refuses_a_network_whose_paths_are_all_too_narrow():
    """A row of very narrow links divides the network; the links around one node are also narrow."""
    along, across = np.ones((40, 40)), np.ones((39, 39))
    along[20] = 1e-15
    along[8:10, 8] = across[8, 7:9] = 1e-9
    with pytest.raises(NotConverged, match="every path contains a link below 1e-13"):
        solve_links(along, across, solver="multigrid")
    flow = solve_links(along, across)
    assert flow.solver == "elimination"
    assert_allclose(flow.conductance, 40 * 1e-15, rtol=1e-10)


@pytest.mark.parametrize("sides", ["mirror", "periodic"])
def test_levels_shared_by_threads_solve_as_the_compiled_whole(sides, monkeypatch):
    """As those of large grids are: a small one is taken for large here."""
    links = cell_links(filtered_gap(160, 4, 0.1, 3), (1.0, 1.0), sides)
    whole = solve_links(*links, solver="multigrid", field_rtol=1e-6)
    monkeypatch.setattr("femseal.flow.solvers.multigrid.THREADED_NODES", 300)
    monkeypatch.setattr("femseal.base.compiled._POINTS", 900)
    shared = solve_links(*links, solver="multigrid", field_rtol=1e-6)
    assert shared.iterations == whole.iterations
    assert_allclose(shared.conductance, whole.conductance, rtol=1e-11)
    assert_allclose(shared.potential, whole.potential, rtol=0, atol=1e-6)


@pytest.mark.parametrize(("n1", "n2"), [(2**15 + 1, 2**15), (2**30 + 1, 1)])
def test_a_network_of_more_links_than_can_be_numbered_is_refused_before_any_work(n1, n2):
    # arrays of a single number, which take no memory
    along, across = (np.broadcast_to(1.0, (rows, n2)) for rows in (n1, n1 - 1))
    with pytest.raises(InputError, match=r"along: given shape .* at most 2147483647 links"):
        solve_flow(Stencil(along, across))


def test_long_and_narrow_networks_take_multigrid_where_it_is_faster():
    """Closed links and a flow along the long side make multigrid slow."""
    smooth = links(8, 6000, periodic=True, contrast=10)
    flow = solve_links(*smooth, solver="auto", rtol=1e-10)
    assert flow.solver == "multigrid"
    eliminated = solve_links(*smooth, solver="elimination")
    assert_allclose(flow.conductance, eliminated.conductance, rtol=1e-9)
    half_closed = links(8, 6000, periodic=True, contrast=10, closed=0.3)
    assert solve_links(*half_closed, solver="auto").solver == "elimination"
    along = links(6000, 8, periodic=True, contrast=10)
    assert solve_links(*along, solver="auto").solver == "elimination"
