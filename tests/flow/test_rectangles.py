"""Flow over rectangles: the fast implementation against scikit-fem on the mesh, bounds, and closed forms."""

import logging
from itertools import pairwise

import numpy as np
import pytest
from numpy.testing import assert_allclose

from femseal import AnnularSeal, InputError, RectangularSeal
from femseal.flow.rectangles import Rectangles

SHAPES = ((1, 1), (1, 4), (2, 1), (3, 2), (5, 7), (16, 24))


def seals():
    """Strips and rings of several shapes, the rings with rows of different breadth in ln r."""
    for number, cells in enumerate(SHAPES):
        yield RectangularSeal((2e-3, 5e-3), cells)
        yield AnnularSeal(1e-3, 2.5e-3, cells, "outer" if number % 2 else "inner")


def random_map(rng, cells, sigma, closed=0.0, axes=2):
    """Permeability of the elements (n1, n2, 2) [m³], log-normal; a fraction of the elements is closed."""
    k = 1e-18 * np.exp(sigma * rng.standard_normal((*cells, axes))) * np.ones(2)
    return k * (rng.random((*cells, 1)) >= closed)


@pytest.mark.parametrize("sigma", [0.5, 2.0])
@pytest.mark.parametrize("closed", [0.0, 0.2])
def test_the_fast_path_is_the_assembly_of_the_mesh(sigma, closed):
    rng = np.random.default_rng([3, round(10 * sigma), round(10 * closed)])
    for seal in seals():
        k = random_map(rng, seal.cells, sigma, closed)
        plain = seal.flow(k, bounds=True, solver="direct")
        for solver in ("auto", "elimination", "multigrid"):
            fast = seal.flow(k, bounds=True, solver=solver)
            assert fast.percolates == plain.percolates
            found = fast.conductance, fast.upper
            assert_allclose(found, (plain.conductance, plain.upper), rtol=2e-8, atol=0)
            assert_allclose(fast.lower, plain.lower, rtol=1e-5, atol=0)
            if fast.percolates:
                assert_allclose(fast.potential, plain.potential, atol=1e-5)


def test_bounds_close_in_as_elements_are_divided():
    rng = np.random.default_rng(5)
    for sigma in (1.0, 3.0, 6.0):
        k = random_map(rng, (6, 8), sigma, 0.1)
        flows = [
            RectangularSeal((3.0, 4.0), (6 * n, 8 * n)).flow(
                np.repeat(np.repeat(k, n, axis=0), n, axis=1), bounds=True
            )
            for n in (1, 2, 4, 8)
        ]
        assert flows[0].lower > 0
        for coarse, fine in pairwise(flows):
            assert coarse.lower <= fine.lower * (1 + 1e-9)
            assert fine.upper <= coarse.upper * (1 + 1e-9)
        assert all(flow.lower <= flow.conductance <= flow.upper for flow in flows)


@pytest.mark.parametrize(
    ("sigma", "closed", "mean", "largest"),
    [(1, 0, 5e-3, 0.02), (3, 0, 0.02, 0.1), (3, 0.2, 0.04, 0.2)],
)
def test_random_elements_leak_what_divided_ones_do(sigma, closed, mean, largest):
    """The two bounds are off by factors; their mean in ln Q is not."""
    rng = np.random.default_rng([9, sigma, round(10 * closed)])
    errors, widths = [], []
    for _ in range(12):
        k = random_map(rng, (12, 12), sigma, closed, axes=1)
        coarse = RectangularSeal((1.0, 1.0), (12, 12)).flow(k, bounds=True)
        divided = np.repeat(np.repeat(k, 16, axis=0), 16, axis=1)
        fine = RectangularSeal((1.0, 1.0), (192, 192)).flow(divided)
        errors.append(np.log(coarse.conductance / fine.conductance))
        widths.append(np.log(coarse.upper / coarse.lower))
    assert abs(np.mean(errors)) < mean
    assert np.abs(errors).max() < largest < np.mean(widths)


@pytest.mark.parametrize("contrast", [1.0, 1e3, 1e12, 1e20])
def test_a_large_checkerboard_leaks_the_geometric_mean(contrast):
    """Up to its ends, which are no lines of equal pressure in a board without end."""
    board = np.indices((40, 60)).sum(axis=0) % 2
    k = np.where(board, contrast, 1.0)
    flow = RectangularSeal((40.0, 60.0), (40, 60)).flow(k, bounds=True)
    assert_allclose(flow.conductance, np.sqrt(contrast) * 60 / 40, rtol=0.03)
    assert flow.lower <= flow.conductance <= flow.upper


def test_elements_that_share_a_corner_alone_are_sealed():
    board = np.indices((4, 6)).sum(axis=0) % 2
    for solver in ("auto", "direct"):
        flow = RectangularSeal((1.0, 1.0), (4, 6)).flow(1.0 * board, bounds=True, solver=solver)
        assert (flow.conductance, flow.lower, flow.percolates) == (0.0, 0.0, False)


@pytest.mark.parametrize("contrast", [1e10, 1e20])
def test_a_narrow_way_keeps_its_digits(contrast):
    """All elements wide but those of one row."""
    k = np.exp(np.random.default_rng(2).standard_normal((5, 9))) * contrast
    k[2] = 1.0
    flow = RectangularSeal((5.0, 9.0), (5, 9)).flow(k, bounds=True)
    assert_allclose([flow.conductance, flow.lower, flow.upper], 9.0, rtol=1e2 / contrast + 1e-8)


def test_elements_closed_along_one_axis_carry_flow_along_the_other():
    seal = RectangularSeal((4.0, 6.0), (4, 6))
    k = np.zeros((4, 6, 2))
    k[..., 1] = 1.0
    assert seal.flow(k, bounds=True).upper == 0.0
    k[:, 2, 0] = 3.0
    assert_allclose(seal.flow(k).conductance, 3.0 / 4, rtol=1e-12)


def test_tensors():
    rng = np.random.default_rng(4)
    seal = RectangularSeal((4.0, 5.0), (4, 5))
    k = random_map(rng, (4, 5), 1.0)
    diagonal = np.einsum("ijc,cd->ijcd", k, np.eye(2)).reshape(20, 2, 2)
    assert_allclose(seal.flow(diagonal).conductance, seal.flow(k).conductance, rtol=1e-12)
    assert_allclose(seal.flow(k.reshape(20, 2)).conductance, seal.flow(k).conductance, rtol=1e-12)
    uniform = np.broadcast_to([[2.0, 0.7], [0.7, 1.0]], (20, 2, 2))
    assert_allclose(seal.flow(uniform).conductance, 2.0 * 5 / 4, rtol=1e-7)


@pytest.mark.parametrize(
    ("permeability", "message"),
    [
        ((np.ones((4, 5)), np.ones((3, 5))), "a pair of arrays, as of links, expected one array"),
        (np.ones((5, 4)), r"shape \(5, 4\), expected a number or shape \(20,\) or \(4, 5\)"),
        (-np.ones((4, 5)), "-1, expected numbers >= 0"),
        (np.full((4, 5, 2), np.nan), "40 values not finite"),
        (np.full((20, 2, 2), [[1.0, 0.5], [0.0, 1.0]]), "a tensor that is not symmetric"),
    ],
)
def test_a_bad_permeability_is_named(permeability, message):
    with pytest.raises(InputError, match="^permeability: given " + message):
        RectangularSeal((4.0, 5.0), (4, 5)).flow(permeability)


def test_other_meshes_still_warn_of_copies(caplog):
    """scikit-fem warns of a copy; a seal makes one on purpose, without a change of the logging of others."""
    log = logging.getLogger("skfem.mesh.mesh")
    lines = np.linspace(0.0, 1.0, 41)
    with caplog.at_level(logging.WARNING, "skfem"):
        Rectangles(lines, columns=40, period=1.0).mesh  # noqa: B018
        assert not caplog.records
        log.warning("Transforming over 1000 vertices to C_CONTIGUOUS.")
        assert len(caplog.records) == 1
