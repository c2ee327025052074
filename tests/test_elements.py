"""Windows as finite elements: against dense algebra and exact fractions."""

from fractions import Fraction

import numpy as np
import pytest
from each import each
from femseal.elements.superelement import WindowElement, WindowLinks, side_nodes, window_links
from numpy.testing import assert_allclose, assert_array_equal

from femseal import self_affine
from femseal.flow.solvers.link_network import condense
from femseal.windows import Partition

PIXEL = (1e-6, 1e-6)


def links(w1, w2, seed=0, decades=3.0, closed=0.0):
    rng = np.random.default_rng(seed)
    c1, c2 = (10 ** (-decades * rng.random(shape)) for shape in ((w1 + 1, w2), (w1, w2 + 1)))
    return c1 * (rng.random(c1.shape) >= closed), c2 * (rng.random(c2.shape) >= closed)


def joined(c1, c2):
    """Both ends of every link of a window, side points after all nodes, and its conductance."""
    w1, w2 = c2.shape[0], c1.shape[1]
    node = np.arange(w1 * w2).reshape(w1, w2)
    above, below, left, right = np.split(w1 * w2 + np.arange(2 * (w1 + w2)), [w2, 2 * w2, 2 * w2 + w1])
    rows, columns = np.vstack([above, node, below]), np.column_stack([left, node, right])
    a = np.r_[rows[:-1].ravel(), columns[:, :-1].ravel()]
    b = np.r_[rows[1:].ravel(), columns[:, 1:].ravel()]
    return a, b, np.r_[c1.ravel(), c2.ravel()]


def schur_complement(c1, c2):
    """The Laplacian of a window without its inner nodes, by dense algebra."""
    a, b, c = joined(c1, c2)
    nodes, size = c1.shape[1] * c2.shape[0], b.max() + 1
    full = np.zeros((size, size))
    for i, j, here in zip(a, b, c, strict=True):
        full[[i, j, i, j], [i, j, j, i]] += [here, here, -here, -here]
    used = np.flatnonzero(full.diagonal()[:nodes])
    inner, mixed = full[np.ix_(used, used)], full[np.ix_(used, range(nodes, size))]
    return full[nodes:, nodes:] - mixed.T @ np.linalg.lstsq(inner, mixed, rcond=None)[0]


@pytest.fixture(scope="module")
def gap():
    """A rough gap of 64 × 96 pixels with a tenth of it in contact."""
    heights = self_affine(
        (64, 96), (64e-6, 96e-6), hurst=0.8, rms_slope=0.2, roll_off=40e-6, cut_off=8e-6, rng=3
    ).heights
    return np.maximum(np.quantile(heights, 0.9) - heights, 0.0)


def partition(gap, cells):
    return Partition(gap.shape, PIXEL, cells)


class TestCondensation:
    @each("shape", [(1, 1), (1, 5), (8, 8), (9, 14), (24, 20)])
    @each("closed", [0.0, 0.3])
    def test_is_the_schur_complement(self, shape, closed):
        c1, c2 = links(*shape, seed=sum(shape), closed=closed)
        conductances, _ = condense(c1, c2)
        operator = np.diag(conductances.sum(axis=1)) - conductances
        assert_allclose(operator, schur_complement(c1, c2), atol=1e-13)
        assert_array_equal(conductances, conductances.T)
        assert conductances.min() >= 0

    def test_every_couple_is_exact_at_any_contrast(self):
        c1, c2 = links(4, 3, seed=5, decades=15, closed=0.1)
        a, b, c = joined(c1, c2)
        size, nodes = b.max() + 1, 12
        exact = [[Fraction(0)] * size for _ in range(size)]
        for i, j, here in zip(a, b, c, strict=True):
            exact[i][j] = exact[j][i] = Fraction(here)
        for n in range(nodes):
            total = sum(exact[n][n + 1 :])
            for i in range(n + 1, size):
                for j in range(n + 1, size):
                    if i != j and total:
                        exact[i][j] += exact[n][i] * exact[n][j] / total
        expected = [[float(v) for v in row[nodes:]] for row in exact[nodes:]]
        assert_allclose(condense(c1, c2)[0], expected, rtol=1e-13)

    @each("seed", range(4))
    def test_only_joined_side_points_are_coupled(self, seed):
        c1, c2 = links(10, 12, seed=seed, closed=0.45)
        conductances, component = condense(c1, c2)
        same = component[:, None] == component
        np.fill_diagonal(same, False)
        assert_array_equal(conductances > 0, same)
        assert component.base is None  # windows keep nothing of their inner points


class TestSideNodes:
    @each("n", [8, 9, 16, 33, 64])
    @each("spacing", [1, 4, 8])
    def test_a_wide_side_has_nodes_at_both_corners_and_none_too_far(self, n, spacing):
        node, weight, place = side_nodes(np.ones(n), np.ones(n - 1), spacing)
        assert_array_equal(place, np.flatnonzero(weight.max(axis=1) == 1))
        assert (place[0], place[-1]) == (0, n - 1)
        assert np.diff(place).max() <= spacing
        assert_allclose((weight * place[node]).sum(axis=1), np.arange(n))

    def test_segments_share_no_node(self):
        crossing = np.array([0.0, 1, 1, 1, 0, 0, 2, 0, 1, 1])
        node, weight, _ = side_nodes(crossing, np.ones(9), 8)
        assert_array_equal(node[:, 0] < 0, crossing == 0)
        assert {*node[1:4].ravel()}.isdisjoint({*node[6:].ravel()})
        assert_allclose(weight.sum(axis=1), crossing > 0)

    def test_between_nodes_pressure_drops_where_the_side_is_narrow(self):
        along = np.array([1.0, 1, 1, 1e-15, 1, 1, 1])
        _, weight, _ = side_nodes(np.ones(8), along, 8)
        assert_allclose(weight[:4, 1], np.arange(4) * 1e-15, rtol=1e-9)
        assert_allclose(weight[4:7, 0], np.arange(3, 0, -1) * 1e-15, rtol=1e-9)


class TestElement:
    def test_rows_sum_to_zero_and_energy_is_never_negative(self, gap):
        for window in window_links(gap, partition(gap, (2, 3)), 1):
            conductances = WindowElement.of(window, 8).conductances
            assert_array_equal(conductances, conductances.T)
            matrix = np.diag(conductances.sum(axis=1)) - conductances
            assert np.linalg.eigvalsh(matrix).min() > -1e-12 * matrix.max()

    def test_a_wider_spacing_is_an_interpolation_of_all_points(self):
        along, across = links(16, 16, decades=0.0)
        window = WindowLinks(along, across, np.ones((2, 15)), np.ones((2, 15)), (False, False))
        element, (conductances, _) = WindowElement.of(window, 4), condense(along, across)
        between = np.zeros((len(conductances), element.counts.sum()))
        np.add.at(between, (np.arange(len(conductances))[:, None], element.node), element.weight)
        points, expected = (np.diag(c.sum(axis=1)) - c for c in (conductances, element.conductances))
        assert_allclose(between.T @ points @ between, expected, atol=1e-12)
