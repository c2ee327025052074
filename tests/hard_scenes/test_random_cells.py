"""Random and large cells: solvers against elimination, bounds against finer ones of another kind, any unit."""

import numpy as np
import pytest
from networks import cell_links, solve_links
from numpy.testing import assert_allclose

from femseal import (
    AnnularSeal,
    InputError,
    NotConverged,
    RectangularSeal,
    cell_permeability,
    permeability_tensor,
    self_affine,
)

D = 1e-6


@pytest.mark.slow
@pytest.mark.parametrize("share", [0.05, 0.35])
def test_4096_pixels_a_side(share):
    n = 4096
    z = face(1, n, n / 4, 8)
    h = np.maximum(np.quantile(z[::8, ::8], 1 - share) - z, 0)
    k = cell_permeability(h, (D, D), sides="periodic", field_rtol=1e-6)
    assert 0 < k.iterations < 200
    assert_allclose(cell_permeability(h, (D, D), sides="periodic").value, k.value, rtol=1e-6)
    # in every section the same flow
    c1, _ = cell_links(h, (D, D), "periodic")
    p = np.nan_to_num(k.fluid_pressure)
    sections = (c1[1:-1] * (p[:-1] - p[1:])).sum(axis=1)
    assert_allclose(sections, k.value, rtol=1e-4)


def face(seed, n=128, roll_off=128, cut_off=8):
    waves = {"roll_off": roll_off * D, "cut_off": cut_off * D, "rng": seed}
    return self_affine((n, n), (n * D, n * D), hurst=0.8, rms_slope=0.2, **waves).heights


# --- thousands of random cells against elimination ---


def random_cell(seed):
    """1 to 128 pixels a side with gaps from 1 down to 1e-12 of the largest: log-normal, a film over contact, two gaps."""
    rng = np.random.default_rng([77, seed])
    small, medium, large = (1, 12), (8, 64), (32, 129)
    shape = n1, n2 = tuple(
        int(
            rng.choice(
                [rng.integers(*side) for side in (small, medium, large)], p=[0.15, 0.45, 0.4]
            )
        )
        for _ in range(2)
    )
    sides, kind = ("mirror", "periodic")[int(rng.integers(2))], seed % 10
    if kind in (2, 5):
        roll_off, cut_off = 128 / rng.uniform(1, 6), rng.choice([4, 8, 16])
        z = face(int(rng.integers(1 << 30)), 128, roll_off, cut_off)[:n1, :n2]
    if kind == 2:
        h = np.exp(rng.uniform(0.5, 11) * z / (z.std() or 1))
        h[h < np.quantile(h, rng.uniform(0, 0.4))] = 0
    elif kind == 5:
        h = np.maximum(np.quantile(z, 1 - rng.uniform(0.1, 0.7)) - z, 0)
        h = np.maximum(h / (h.max() or 1), 10 ** -rng.uniform(1, 5))
    else:
        side = rng.integers(1, 10)
        wide = rng.random((n1 // side + 1, n2 // side + 1)) < rng.uniform(0.3, 0.7)
        wide = np.kron(wide, np.ones((side, side)))[:n1, :n2] > 0
        h = np.where(wide, 1.0, 10.0 ** -rng.uniform(0, 5))
        h = h * np.exp(0.3 * rng.standard_normal(shape))
    return cell_links(h / h.max() if h.max() > 0 else h + 1, (D, D), sides)


#: Cells whose error multigrid tells too small, though it is below what was asked for: an open defect.
TOLD_TOO_LITTLE = {(400, 1e-6)}


def check_random_cell(seed, rtol):
    c1, c2 = random_cell(seed)
    exact, found = solve_links(c1, c2, solver="elimination"), solve_links(c1, c2, rtol=rtol)
    assert found.percolates == exact.percolates
    assert_allclose(found.conductance, exact.conductance, rtol=rtol, err_msg=f"seed {seed}")
    error = abs(found.conductance - exact.conductance)
    # the error that is told is an estimate where few iterations were needed
    told = error <= max(found.residual**2, 0.1 * rtol, 1e-13) * exact.conductance
    assert told or (seed, rtol) in TOLD_TOO_LITTLE, seed
    return found


@pytest.mark.parametrize("seed", [10272, 10392, 10572, 10442, 10028])
def test_links_lost_in_sums_that_carry_flow(seed):
    """Most of the flow is through links beside which multigrid cannot see 1e-4 to 1e-2 of it."""
    for rtol in (1e-3, 1e-6, 1e-9):
        check_random_cell(seed, rtol)
    c1, c2 = random_cell(seed)
    exact = solve_links(c1, c2, solver="elimination").conductance
    loose = solve_links(c1, c2, rtol=0.02, solver="multigrid")
    assert 1e-4 < loose.residual**2 <= 0.02
    # the iteration itself leaves a smaller error than the lost links
    assert_allclose(loose.conductance, exact, rtol=1e-4)
    with pytest.raises(NotConverged, match=r"too narrow for multigrid|inlet and outlet differ"):
        solve_links(c1, c2, rtol=1e-9, solver="multigrid")


@pytest.mark.parametrize("rtol", [1e-3, 1e-6, 1e-9])
@pytest.mark.parametrize("seeds", [range(100), pytest.param(range(10000), marks=pytest.mark.slow)])
def test_random_cells(seeds, rtol):
    used = {check_random_cell(seed, rtol).solver for seed in seeds}
    assert used <= {"multigrid", "elimination", "none"}


# --- bounds, tensor and units of small random cells ---


@pytest.mark.parametrize(
    ("gaps", "spacing", "words"),
    [
        ((0, 1e70), (D, D), ["gap", "1e+70"]),
        ((0, 1e-70), (D, D), ["gap", "1e-70"]),
        ((1e-60 * D, D), (D, D), ["gap", "1e-66"]),
        ((0, D), (1e40, 1e-40), ["spacing", "1e+40"]),
    ],
)
@pytest.mark.parametrize("function", [cell_permeability, permeability_tensor])
def test_what_double_precision_cannot_bear_is_refused_by_name(function, gaps, spacing, words):
    h = np.where(np.arange(4) == 1, *gaps[::-1]) * np.ones((4, 4))
    with pytest.raises(InputError) as caught:
        function(h, spacing)
    assert all(word in str(caught.value) for word in words)


# --- bounds of structured seals ---


def effective_link(stencil):
    """Conductance between the ends by star-mesh elimination of one node after the other in long double."""
    n1, n2 = stencil.along.shape
    inner = (n1 - 1) * n2
    number = np.r_[np.full(n2, inner), np.arange(inner), np.full(n2, inner + 1)]
    links = np.zeros((inner + 2, inner + 2), np.longdouble)
    node = np.arange(number.size).reshape(n1 + 1, n2)
    beside = np.roll(node, -1, axis=1)
    m2 = stencil.across.shape[1]
    for c, a, b in (
        (stencil.along, node[:-1], node[1:]),
        (stencil.across, node[1:-1, :m2], beside[1:-1, :m2]),
    ):
        np.add.at(links, (number[a.ravel()], number[b.ravel()]), c.ravel())
    links += links.T
    np.fill_diagonal(links, 0)
    for i in range(inner):
        later = links[i, i + 1 :].copy()
        if later.any():
            links[i + 1 :, i + 1 :] += np.outer(later, later / later.sum())
            np.fill_diagonal(links, 0)
    return links[inner, inner + 1]


def check_seal(seed):
    rng = np.random.default_rng([22, seed])
    cells = n1, n2 = tuple(int(n) for n in rng.integers(1, 11, 2))
    length, ratio = np.exp(rng.uniform(-8, 0)), np.exp(rng.uniform(-7, 1))
    ring = AnnularSeal(length, length * (1 + ratio), cells)
    seal = ring if seed % 2 else RectangularSeal((length, ratio), cells)
    spread, closed = rng.uniform(0, 15) * (rng.random() < 0.8), rng.choice([0, 0.1, 0.3])
    unit = 10.0 ** rng.integers(-60, 30)
    k1, k2 = (
        unit * np.exp(spread * rng.standard_normal((n1, n2))) * (rng.random((n1, n2)) > closed)
        for _ in range(2)
    )
    flow = seal.flow(np.stack([k1, k2], axis=-1), bounds=True)
    rectangles = seal.rectangles
    most = effective_link(rectangles.corner_network(k1, k2))
    least = effective_link(rectangles.centre_network(k1, k2))
    if least == 0:
        assert flow.lower == flow.conductance == 0, seed
        return
    assert least * (1 - 1e-4) <= flow.lower <= min(least, flow.conductance), seed
    assert max(most, flow.conductance) <= flow.upper <= most * (1 + 1e-4), seed
    assert_allclose(flow.conductance**2, least * most, rtol=1e-7)


def test_bounds_of_structured_seals_hold_to_the_last_digit():
    # the last seeds have permeabilities that differ by a factor of 1e50
    for seed in (*range(60), 1232, 1353):
        check_seal(seed)


@pytest.mark.slow
@pytest.mark.parametrize("first", range(1000, 5000, 1000))
def test_bounds_of_thousands_of_structured_seals(first):
    for seed in range(first, first + 1000):
        check_seal(seed)
