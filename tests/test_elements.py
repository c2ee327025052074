"""Windows as finite elements: against dense algebra, exact fractions, the flow on all pixels, and closed forms."""

from dataclasses import replace
from fractions import Fraction

import numpy as np
import pytest
from each import each
from numpy.testing import assert_allclose, assert_array_equal

from femseal import Liquid, Scene, cell_permeability, condition, read_topography, self_affine, two_scale
from femseal.base import threads
from femseal.base.errors import InputError, NotConverged
from femseal.elements import element_flow, element_mesh, face_potential, window_flow
from femseal.elements.superelement import WindowElement, WindowLinks, side_nodes, window_links
from femseal.flow.solvers.link_network import condense
from femseal.results.dataset import assemble
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


def resolved(gap):
    return cell_permeability(gap, PIXEL, sides="periodic", solver="elimination").value


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
        element, conductances = WindowElement.with_points(window, 4)
        between = np.zeros((len(conductances), element.counts.sum()))
        np.add.at(between, (np.arange(len(conductances))[:, None], element.node), element.weight)
        points, expected = (np.diag(c.sum(axis=1)) - c for c in (conductances, element.conductances))
        assert_allclose(between.T @ points @ between, expected, atol=1e-12)


class TestFlow:
    @each("cells", [(1, 1), (1, 3), (4, 1), (4, 6)])
    def test_with_a_node_at_every_pixel_it_is_the_flow_on_all_pixels(self, gap, cells):
        flow = element_flow(gap, partition(gap, cells), node_spacing=1)
        assert_allclose(flow.permeability, resolved(gap), rtol=1e-9)
        assert flow.percolates

    @each("cells", [(2, 3), (4, 6), (4, 1)])
    def test_bounds_fall_with_the_distance_of_nodes_and_the_iterations(self, gap, cells):
        exact = resolved(gap)
        found = [element_flow(gap, partition(gap, cells), node_spacing=n) for n in (1, 2, 4, 8)]
        nodes, k = np.array([(f.node_permeability, f.permeability) for f in found]).T
        assert np.all(np.diff(nodes) > 0)
        assert exact * (1 - 1e-9) < nodes[0] < nodes[-1] < 1.02 * exact
        assert_allclose(k, exact, rtol=1e-5)
        assert np.all(k < nodes + 1e-9 * exact)

    @each(("closed", "cells"), [(0.0, (2, 2)), (0.3, (2, 2)), (0.35, (4, 4))])
    def test_the_error_is_seldom_underestimated_where_gaps_are_random_over_five_decades(self, closed, cells):
        """Nodes alone are off by factors there; the estimate is at least half of the true error."""
        nodes, errors, low = [], [], 0
        for seed in range(20):
            rng = np.random.default_rng(seed)
            h = 10 ** (-5 * rng.random((48, 48))) * (rng.random((48, 48)) >= closed)
            flow = element_flow(h, partition(h, cells))
            exact = element_flow(h, partition(h, cells), node_spacing=1).permeability
            if exact:
                nodes.append(flow.node_permeability / exact - 1)
                errors.append(flow.permeability / exact - 1)
                low += errors[-1] > max(2 * flow.error, 1e-6)
        assert max(nodes) > 1 or closed
        assert max(errors) < 0.02
        assert low <= 1

    @each("cells", [(1, 1), (1, 3), (4, 1), (2, 2)])
    def test_potential_at_side_points_is_that_of_all_pixels(self, gap, cells):
        """Also where a window is its own neighbour."""
        sharp = element_flow(gap, partition(gap, cells), node_spacing=1)
        flow = element_flow(gap, partition(gap, cells))
        for name in ("row_potential", "column_potential"):
            assert_allclose(getattr(flow, name), getattr(sharp, name), atol=2e-3)
        assert_allclose(flow.dissipation, sharp.dissipation, rtol=0.01, atol=1e-3 * sharp.dissipation.max())

    def test_parallel_plates(self):
        flow = element_flow(np.full((32, 24), 2e-6), Partition((32, 24), (1e-6, 2e-6), (2, 3)))
        assert_allclose([flow.permeability, flow.node_permeability], (2e-6) ** 3 / 12, rtol=1e-12)
        assert_allclose(flow.row_potential, np.broadcast_to([[1.0], [0.5], [0.0]], (3, 24)), atol=1e-12)
        assert_allclose(flow.column_potential[:, 0], 1 - (np.arange(32) + 0.5) / 32, rtol=1e-12)
        assert_allclose(flow.dissipation, flow.dissipation.mean(), rtol=1e-12)
        assert flow.error == pytest.approx(0, abs=1e-12)

    def test_shares_of_the_pressure_drop_add_up(self, gap):
        flow = element_flow(gap, partition(gap, (4, 6)))
        assert_allclose(flow.dissipation.sum() * 64 / 96, flow.permeability, rtol=1e-12)
        assert flow.dissipation.min() > -1e-12 * flow.dissipation.max()

    @each("width", [1e-5, 1e-3])
    def test_one_narrow_way_is_found_whatever_the_contrast(self, width):
        rng = np.random.default_rng(2)
        h = 0.5 + rng.random((32, 48))
        h[10:14] = 0.0
        h[10:14, 21] = width
        exact = resolved(h)
        assert 0 < exact < width**3
        assert_allclose(element_flow(h, partition(h, (2, 3))).permeability, exact, rtol=1e-4)

    @each("seed", range(4))
    def test_a_node_at_every_pixel_is_exact_at_any_contrast(self, seed):
        rng = np.random.default_rng(seed)
        h = 10 ** (-5 * rng.random((32, 48))) * (rng.random((32, 48)) > 0.3)
        flow = element_flow(h, partition(h, (2, 3)), node_spacing=1)
        assert_allclose(flow.permeability, resolved(h), rtol=1e-10)

    def test_closing_is_exact(self, gap):
        h = gap.copy()
        h[11] = 0.0
        flow = element_flow(h, partition(gap, (4, 6)))
        assert (flow.permeability, flow.error, flow.percolates, flow.solver) == (0.0, 0.0, False, "none")
        h[11, 30:32] = 1e-12
        h[10, 30], h[12, 31] = 1e-12, 1e-12
        h[10, 31], h[12, 30] = 0.0, 0.0
        assert element_flow(h, partition(gap, (4, 6))).permeability > 0
        h[11, 31] = 0.0  # pixels that touch at a corner are not joined
        assert element_flow(h, partition(gap, (4, 6))).permeability == 0

    def test_a_face_without_gap(self):
        assert element_flow(np.zeros((16, 16)), Partition((16, 16), PIXEL, (2, 2))).permeability == 0

    def test_inlet_and_outlet_flow_have_to_agree(self, gap, monkeypatch):
        monkeypatch.setattr(element_mesh, "MAX_IMBALANCE", 1e-30)
        with pytest.raises(NotConverged, match="inlet and outlet"):
            element_flow(gap, partition(gap, (4, 6)))

    def test_bad_input(self, gap):
        with pytest.raises(InputError, match="gap"):
            element_flow(-gap, partition(gap, (4, 6)))
        with pytest.raises(InputError, match="shape"):
            element_flow(gap[1:], partition(gap, (4, 6)))
        with pytest.raises(InputError, match="node_spacing"):
            element_flow(gap, partition(gap, (4, 6)), node_spacing=0)


class TestInside:
    def test_back_substitution_is_the_field_on_all_pixels(self, gap):
        """With a node at every pixel both are the same."""
        cells = partition(gap, (4, 6))
        flow = element_flow(gap, cells, node_spacing=1)
        whole = cell_permeability(gap, PIXEL, sides="periodic", solver="elimination").fluid_pressure
        for i, j in ((0, 0), (2, 3), (3, 5)):
            found = window_flow(gap, cells, flow, i, j).potential
            assert_allclose(found, cells.cell(whole, i, j), atol=1e-9)

    def test_all_windows_together_are_the_face(self, gap):
        cells = partition(gap, (4, 6))
        found = face_potential(gap, cells, element_flow(gap, cells, node_spacing=1))
        whole = cell_permeability(gap, PIXEL, sides="periodic", solver="elimination").fluid_pressure
        assert_allclose(found, whole, atol=1e-9)

    def test_flow_balances_and_goes_in_where_it_goes_out(self, gap):
        cells = partition(gap, (4, 6))
        flow = element_flow(gap, cells)
        windows = [[window_flow(gap, cells, flow, i, j) for j in range(6)] for i in range(4)]
        for window in (windows[0][2], windows[2][5]):
            balance = -np.diff(window.flux1, axis=0) - np.diff(window.flux2, axis=1)
            assert np.abs(balance).max() < 1e-9 * np.abs(window.flux1).max()
        ends = [sum(w.flux1[end].sum() for w in windows[row]) for row, end in ((0, 0), (-1, -1))]
        assert_allclose(ends, flow.dissipation.sum(), rtol=1e-6)

    def test_nothing_flows_in_a_closed_window(self, gap):
        h = gap.copy()
        h[11] = 0.0
        cells = partition(gap, (4, 6))
        window = window_flow(h, cells, element_flow(h, cells), 1, 1)
        assert {*np.unique(window.potential[np.isfinite(window.potential)])} <= {0.0}
        assert not window.flux1.any()
        assert {*np.unique(window_flow(h, cells, element_flow(h, cells), 0, 1).potential[:11])} >= {1.0}
        with pytest.raises(InputError, match="window"):
            window_flow(h, cells, element_flow(h, cells), 4, 0)


@pytest.fixture(scope="module")
def scene():
    surface = self_affine((64, 96), (64e-6, 96e-6), hurst=0.8, rms_slope=0.2, roll_off=32e-6, cut_off=8e-6, rng=1)
    return Scene(
        surface=surface,
        modulus=115e9,
        hardness=4e9,
        fluid=Liquid(1e-3),
        inlet_pressure=1e6,
        outlet_pressure=0.0,
        loading=(1e8, 1e9),
        unload_from=(1e9,),
        unloading=(1e8,),
    )


class TestStudy:
    def test_is_the_flow_through_the_stitched_gap(self, scene):
        result, exact = (two_scale(scene, (4, 6), flow=flow) for flow in ("elements", "resolved"))
        ratio = result.leakage / exact.leakage
        assert np.all(np.abs(ratio - 1) < 1e-5)
        assert_allclose(result.drop_fraction.sum(axis=(1, 2)), 1.0)
        assert np.all(result.element_error < 1e-3)
        assert result.solvers.by_solver()["elimination"] >= 3
        assert exact.element_error is exact.drop_fraction is result.k1 is None
        inside, expected = result.fluid_pressure, exact.fluid_pressure
        assert_array_equal(np.isnan(inside), np.isnan(expected))
        assert np.nanmean(np.abs(inside - expected)) < 1e-4 * scene.inlet_pressure
        data = assemble(scene, two_scale=result).dataset
        assert data["element_error"].dims == ("step",)
        assert data["window_drop_fraction"].dims == ("step", "cell1", "cell2")

    def test_needs_links_between_pixels(self, scene):
        with pytest.raises(InputError, match="gauss"):
            two_scale(replace(scene, discretisation="gauss"), (4, 6))


@pytest.mark.slow
def test_measured_face(instrument_file):
    """Where links are off by hundreds, elements are the flow on all pixels."""
    surface, _ = condition(read_topography(instrument_file("plu-1.plu")), shape=(768, 576))
    hardness = 0.14 * 115e9 * surface.rms_slope
    scene = Scene(
        surface=surface,
        modulus=115e9,
        hardness=hardness,
        fluid=Liquid(1e-3),
        inlet_pressure=1e7,
        outlet_pressure=0.0,
        loading=tuple(hardness * p for p in (0.004, 0.01, 0.04)),
    )
    result, exact = (two_scale(scene, (16, 16), flow=flow) for flow in ("elements", "resolved"))
    ratio = result.leakage / exact.leakage
    assert np.all(np.abs(ratio - 1) < 1e-4)


def test_threads_change_no_bits_of_a_flow_through_elements():
    gap = np.maximum(np.random.default_rng(2).standard_normal((48, 60)) + 0.7, 0.0) * 1e-6
    found = []
    for count in (1, 2, 3):
        with threads.using(count):
            flow = element_flow(gap, Partition(gap.shape, (1e-6, 1e-6), (3, 3)))
        found.append((flow.permeability, flow.row_potential.tobytes(), flow.dissipation.tobytes()))
    assert flow.percolates
    assert len(set(found)) == 1
