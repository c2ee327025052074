"""Cell flow: closed forms with measured orders, contrast, open paths, invariants, threads, bad input."""

import numpy as np
import pytest
from gaps_of_cells import cut_by_plane, gap_between_pixels
from numpy.testing import assert_allclose
from scipy import ndimage
from scipy.sparse.linalg import spsolve
from skfem import Basis, BilinearForm, ElementQuad2, MeshQuad
from skfem.helpers import dot, grad

from femseal import analytic
from femseal.base import InputError, NotConverged
from femseal.flow import (
    cell_permeability,
    critical_constriction,
    permeability_tensor,
)
from femseal.flow.grid import gap_on_links
from femseal.flow.law import cubic_law
from femseal.flow.solvers import choice

D = 1e-6
SIDES = ("mirror", "periodic")


@BilinearForm
def energy_of_pressure(p, q, w):
    """∫ k ∇p·∇q."""
    return w.k * dot(grad(p), grad(q))


def k_of(gap, spacing=(D, D), **options):
    return cell_permeability(gap, spacing, **options).value


def order(errors):
    """Observed order over meshes refined by two each."""
    return np.log2(abs(errors[0] / errors[-1])) / (len(errors) - 1)


# --- closed forms ---


@pytest.mark.parametrize("shape", [(1, 1), (1, 9), (9, 1), (2, 7), (16, 12)])
@pytest.mark.parametrize("spacing", [(D, 30 * D), (7 * D, D)])
@pytest.mark.parametrize("axis", [0, 1])
@pytest.mark.parametrize("sides", SIDES)
def test_flat_gap_is_exact(shape, spacing, axis, sides):
    h = np.full(shape, 3.7e-7)
    k = cell_permeability(h, spacing, axis=axis, sides=sides, rtol=1e-12)
    assert_allclose(k.value, analytic.parallel_plates(3.7e-7), rtol=1e-11)
    assert k.percolates
    drop = 1 - (np.arange(shape[axis]) + 0.5) / shape[axis]
    expected = np.broadcast_to(drop[:, None] if axis == 0 else drop, shape)
    assert_allclose(k.fluid_pressure, expected, rtol=1e-12)


@pytest.mark.parametrize("axis", [0, 1])
def test_wavy_gap_along_the_ridges(axis):
    h0, ε, n = 1e-6, 0.6, 24
    x = (np.arange(n) + 0.5) / n
    h = np.broadcast_to(h0 * (1 + ε * np.cos(2 * np.pi * x)), (10, n))
    h = h if axis == 0 else h.T
    for sides in SIDES:
        # the mean of h³ over equidistant points is exact
        assert_allclose(
            k_of(h, (D, 2 * D), axis=axis, sides=sides), analytic.wavy_gap_along(h0, ε), rtol=1e-12
        )


@pytest.mark.parametrize("axis", [0, 1])
@pytest.mark.parametrize("ε", [0.3, 0.8])
def test_wavy_gap_across_the_ridges(axis, ε):
    h0 = 1e-6
    exact = analytic.wavy_gap_across(h0, ε)
    errors = []
    for n in (24, 48, 96):
        x = (np.arange(n) + 0.5) / n
        h = np.repeat(h0 * (1 + ε * np.cos(2 * np.pi * x))[:, None], 3, axis=1)
        errors.append(k_of(h if axis == 0 else h.T, axis=axis) / exact - 1)
    assert abs(errors[-1]) < 3e-4
    assert order(errors) >= 1.9


@pytest.mark.parametrize("axis", [0, 1])
def test_limit_of_refinement_is_that_of_quadratic_elements(axis):
    """Another discretisation altogether: Q2 by scikit-fem with the gap given at every quadrature point."""

    def gap(x, y):
        return D * (
            1
            + 0.5 * np.cos(np.pi * x) * np.cos(2 * np.pi * y)
            + 0.3 * np.cos(2 * np.pi * x) * np.cos(np.pi * y)
        )

    limits = []
    for n in (16, 32):
        mesh = MeshQuad.init_tensor(np.arange(n + 1.0) / n, np.arange(n + 1.0) / n)
        basis = Basis(mesh, ElementQuad2(), intorder=8)
        k = gap(*basis.global_coordinates().value) ** 3 / 12
        a = energy_of_pressure.assemble(basis, k=k).tocsr()
        x = basis.doflocs[axis]
        p = np.where(x == 0, 1.0, 0.0)
        unknown = (x > 0) & (x < 1)
        p[unknown] = spsolve(a[unknown][:, unknown].tocsc(), -(a[unknown] @ p))
        limits.append(float(p @ (a @ p)))
    limit = limits[-1]
    assert abs(limits[0] / limit - 1) < 1e-4
    errors = []
    for n in (32, 64, 128):
        x = (np.arange(n) + 0.5) / n
        errors.append(k_of(gap(x[:, None], x), (D / n, D / n), axis=axis) / limit - 1)
    assert abs(errors[-1]) < 1e-3
    assert 1.8 < order(errors) < 2.3


@pytest.mark.parametrize("ratio", [0.1, 0.5, 0.9])
def test_flow_along_westergaard_grooves(ratio):
    λ, Δ = 1e-3, 1e-6
    exact = (2 * Δ) ** 3 / 12 * analytic.wave_groove_flow(ratio)
    errors = []
    for n in (50, 100, 200, 400):
        x = (np.arange(n) + 0.5) * λ / n
        h = np.broadcast_to(analytic.wave_gap(x, ratio, Δ, λ), (4, n))
        errors.append(k_of(h, (λ / n, λ / n), sides="periodic") / exact - 1)
        assert k_of(h, axis=1) == 0
    assert abs(errors[-1]) < 1e-4
    assert order(errors) >= 1.9


def series(h, d1, d2, width):
    """k of a column of pixels by the documented link: half links at the ends, cubic mid-link gap, limiter."""
    padded = np.concatenate([h[1::-1], h, h[:-3:-1]])
    resistance = 0.0
    for i in range(1, padded.size - 2):
        a, b = padded[i], padded[i + 1]
        middle = gap_between_pixels(padded[i - 1], a, b, padded[i + 2])
        length = d1 / 2 if i in (1, padded.size - 3) else d1
        resistance += 12 * length / (middle**3 * d2 * width)
    return h.size * d1 / (width * d2) / resistance


@pytest.mark.parametrize("ratio", [0.5, 0.2, 0.1, 1e-2, 1e-6])
def test_plates_in_series(ratio):
    """Gap of two plates that jumps between two pixels: the error is less than a tenth of a pixel of the lower one."""
    for n in (64, 256):
        h = np.full((n, 3), D)
        h[n // 2 :] *= ratio
        exact = cubic_law(D) * 2 / (1 + ratio**-3)
        assert k_of(h) == pytest.approx(exact, rel=(0.8 if ratio == 0.5 else 0.1) / n)
        assert k_of(h[::-1]) == pytest.approx(k_of(h), rel=1e-12)


@pytest.mark.parametrize("pixel", [0, 1, 2, 3])
@pytest.mark.parametrize(
    "gaps", [(1.0, 1.0, 1.2, 1.1), (2.0, 1.0, 1.0, 2.0), (0.2, 0.1, 3.0, 5.0), (0.0, 0.3, 1.0, 0.9)]
)
def test_gap_between_pixels_is_continuous(pixel, gaps):
    """A pixel that changes by 1 % changes the gap between pixels by less; it opens with the two beside it."""
    steps = np.logspace(-6, 2, 1850)
    between = []
    for step in steps:
        column = np.array(gaps)
        column[pixel] = step
        between.append(gap_on_links(column[:, None], False, False)[0][2, 0])
    change = np.diff(between)
    assert np.all(abs(change) <= 0.008 * np.maximum(steps[1:], max(gaps)))
    assert np.all(change >= 0) if pixel in (1, 2) else np.all(change <= 1e-15)


def test_permeability_is_continuous_in_each_pixel():
    """One pixel of a channel rises from 3 to 10 times its neighbours in steps of 0.25 %."""
    h = np.tile([1.0, 1.1, 0.9, 1.0, 1.0, 1.0, 1.2, 1.1], (3, 1)).T * D
    k = []
    for pixel in np.geomspace(3, 10, 483):
        h[4] = pixel * D
        k.append(k_of(h))
    assert np.all(abs(np.diff(k)) < 0.005 * k[0])


@pytest.mark.parametrize("breadth", [1, 2, 5])
@pytest.mark.parametrize("sides", SIDES)
def test_barrier_of_a_vanishing_gap_seals(breadth, sides):
    """k of a closed row of pixels whose gap is not exactly 0 tends to 0 as its gap does, and never falls where that rises."""
    barrier = D * np.array([0.0, *np.logspace(-40, 0, 121)])
    found = []
    for b in barrier:
        h = np.full((32, 6), D)
        h[15 : 15 + breadth] = b
        found.append(k_of(h, sides=sides))
    found = np.array(found) / cubic_law(D)
    assert found[0] == 0
    assert found[-1] == pytest.approx(1)
    assert np.all(np.diff(found) > 0)
    # the links of a barrier are at most four times as high as its pixels, and so let through at most 64 times as much
    assert np.all(found[1:] <= 1.001 * 64 * 32 / 2 * (barrier[1:] / D) ** 3)


@pytest.mark.parametrize("contrast", [1.0, 1e3, 1e9, 1e15])
def test_channels_behind_walls_at_any_contrast(contrast):
    """Each is its links in series, all are in parallel."""
    smooth = 1 + 0.5 * np.sin(np.arange(11.0))
    a, b = smooth.copy(), np.exp(3 * np.random.default_rng(0).standard_normal(11))
    a[[2, 7, 8]] /= contrast
    field = D * np.stack([0 * a, a, 0 * a, b, 0 * a, smooth], axis=1)
    exact = D**3 / 6 * sum(series(h, D, 3 * D, 1) for h in (a, b, smooth))
    for turned, spacing, axis in ((field, (D, 3 * D), 0), (field.T, (3 * D, D), 1)):
        assert_allclose(k_of(turned, spacing, axis=axis), exact, rtol=1e-12)
    field = np.pad(field, ((0, 0), (0, 1)))
    assert_allclose(k_of(field, (D, 3 * D), sides="periodic"), exact * 6 / 7, rtol=1e-12)


@pytest.mark.parametrize("ratio", [1.5, 4.0])
def test_checkerboard(ratio):
    """Squares about the centre of the cell; its edges are lines of symmetry of the board."""
    exact = analytic.checkerboard(*analytic.parallel_plates([D, ratio * D]))
    board = D * np.array([[1, ratio], [ratio, 1]])
    errors = [k_of(np.kron(board, np.ones((m, m)))) / exact - 1 for m in (4, 8, 16, 32, 64)]
    # the flow is singular at the centre, p ~ r^α, which limits the order to 2α
    α = 4 / np.pi * np.arctan(ratio**-1.5)
    assert abs(np.log2(errors[-2] / errors[-1]) - min(1, 2 * α)) < 0.1
    if ratio < 2:
        a, b, c = errors[-3:]
        assert abs(c - (c - b) ** 2 / (c - 2 * b + a)) < 1e-3


@pytest.mark.parametrize("shape", [(20, 24), (17, 13), (5, 1)])
@pytest.mark.parametrize("share", [0.0, 0.4])
def test_mirror_equals_the_periodic_even_extension(shape, share):
    h = cut_by_plane((40, 40), share, seed=1)[: shape[0], 5 : 5 + shape[1]]
    asked = {"rtol": 1e-11, "field_rtol": 1e-11}
    a = cell_permeability(h, (D, D), **asked)
    b = cell_permeability(np.hstack([h, h[:, ::-1]]), (D, D), sides="periodic", **asked)
    assert_allclose(a.value, b.value, rtol=1e-11)
    half = b.fluid_pressure[:, : shape[1]]
    assert_allclose(a.fluid_pressure[h > 0], half[h > 0], rtol=0, atol=1e-10)


# --- percolation ---


def test_corner_contact_is_closed():
    h = np.zeros((6, 6))
    h[:3, :3], h[3:, 3:] = D, D
    for sides in SIDES:
        k = cell_permeability(h, (D, D), sides=sides)
        assert k.value == 0
        assert not k.percolates


@pytest.mark.parametrize("sides", SIDES)
def test_pockets_and_dead_ends_change_nothing(sides):
    h = np.full((20, 20), D)
    h[8:13, 8:13] = h[:, :4] = h[:, 5:7] = 0
    before = cell_permeability(h, (D, D), sides=sides)
    h[10, 10] = 1e3 * D
    h[4, 2:4] = h[2:7, 2] = D  # a branch that forks
    after = cell_permeability(h, (D, D), sides=sides)
    assert_allclose(after.value, before.value, rtol=1e-12)
    old = np.isfinite(before.fluid_pressure)
    assert_allclose(after.fluid_pressure[old], before.fluid_pressure[old], rtol=1e-12)
    assert_allclose(after.fluid_pressure[2:7, 2], before.fluid_pressure[4, 4], rtol=1e-12)
    old[4, 2:4] = old[2:7, 2] = True
    assert np.array_equal(np.isfinite(after.fluid_pressure), old)


@pytest.mark.parametrize("axis", [0, 1])
def test_fluid_stands_at_the_pressure_of_the_end_that_reaches_it(axis):
    h = np.full((9, 7), D)
    h[4] = 0  # closed
    h[6, 2:5] = h[8, 2:5] = h[7, [2, 4]] = 0  # a pocket
    k = cell_permeability(h.T if axis else h, (D, D), axis=axis)
    assert k.value == 0
    expected = np.where(h > 0, 0.0, np.nan)
    expected[:4] = 1
    expected[7, 3] = np.nan
    assert np.array_equal(
        k.fluid_pressure.T if axis else k.fluid_pressure, expected, equal_nan=True
    )


# --- bad input ---


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"gap": np.full((3, 3), np.nan)}, ["gap", "9 "]),
        ({"gap": np.full((3, 3), -1e-9)}, ["gap", "-1e-09", ">= 0"]),
        ({"gap": np.ones((2, 3, 4))}, ["gap", "(2, 3, 4)"]),
        ({"gap": np.ones((0, 3))}, ["gap"]),
        ({"gap": "gap"}, ["gap"]),
        ({"spacing": (D, 0.0)}, ["spacing", "> 0"]),
        ({"spacing": ("1 um", D)}, ["spacing"]),
        ({"axis": 2}, ["axis", "2", "0 (x1) or 1 (x2)"]),
        ({"sides": "free"}, ["sides", "free", "mirror, periodic"]),
        ({"rtol": 0}, ["rtol"]),
        ({"solver": "cholesky"}, ["solver", "multigrid", "elimination", "amg"]),
    ],
)
def test_bad_input_is_named(change, words):
    given = {"gap": np.ones((3, 3)), "spacing": (D, D)}
    asked = [cell_permeability]
    asked += [permeability_tensor] * (change.keys() <= given.keys())
    asked += [critical_constriction] * (change.keys() <= {"axis", "sides"})
    for function in asked:
        with pytest.raises(InputError) as caught:
            function(**given | change)
        assert all(word in str(caught.value) for word in words), str(caught.value)


# --- threads ---


def test_threads_share_large_cells_and_change_no_bits():
    gap = cut_by_plane((660, 610), 0.2, seed=3)
    given = {"sides": "periodic", "solver": "multigrid", "field_rtol": 1e-5}
    found = [cell_permeability(gap, (D, D), **given, threads=count) for count in (1, 2, 3)]
    assert len({(k.value, k.residual, k.fluid_pressure.tobytes()) for k in found}) == 1
    exact = cell_permeability(gap, (D, D), sides="periodic", solver="elimination")
    assert_allclose(found[0].value, exact.value, rtol=1e-6)


def test_a_removed_argument_is_answered_with_what_to_do():
    with pytest.raises(InputError, match="removed; compare several grids"):
        cell_permeability(np.full((4, 4), D), (D, D), bounds=True)


def gap_on_long_pixels(seed, n=64):
    """Smoothed noise, 5 to 42 % of it in contact."""
    sigma = ((3, 3), (3, 12), (4, 1.5))[seed % 3]
    noise = ndimage.gaussian_filter(
        np.random.default_rng(seed).standard_normal((n, n)), sigma, mode="wrap"
    )
    contact = (0.05, 0.2, 0.35, 0.42)[seed // 3 % 4]
    return np.maximum(noise - np.quantile(noise, contact), 0.0)


@pytest.mark.parametrize("ratio", [28.0, 1 / 28])
def test_multigrid_on_long_pixels_gives_way_to_elimination(ratio):
    for seed in range(24):
        gap = gap_on_long_pixels(seed)
        flow = cell_permeability(gap, (ratio, 1.0), solver="multigrid", rtol=1e-2)
        assert flow.solver in ("elimination", "none")
        exact = cell_permeability(gap, (ratio, 1.0), solver="elimination").value
        assert_allclose(flow.value, exact, rtol=1e-9)
    square = cell_permeability(gap_on_long_pixels(0), (1.0, 1.0), solver="multigrid")
    assert square.solver == "multigrid"


@pytest.mark.parametrize("ratio", [28.0, 1 / 28])
def test_multigrid_on_long_pixels_of_a_large_grid_has_the_error_asked_for_or_fails(ratio):
    """As if the grid had too many nodes for elimination."""
    solved = 0
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(choice, "ELIMINATED_NODES", 0)
        for seed in range(24):
            gap = gap_on_long_pixels(seed)
            try:
                flow = cell_permeability(gap, (ratio, 1.0), solver="multigrid", rtol=1e-2)
            except NotConverged:
                continue
            exact = cell_permeability(gap, (ratio, 1.0), solver="elimination").value
            assert_allclose(flow.value, exact, rtol=1e-2)
            solved += 1
    assert solved > 12
