"""Random and large cells: solvers against elimination, bounds against finer ones of another kind, any unit."""

import numpy as np
import pytest
import scipy.sparse as sp
from networks import cell_links, solve_links
from numpy.testing import assert_allclose
from scipy.sparse.csgraph import connected_components
from scipy.sparse.linalg import spsolve

from femseal import (
    AnnularSeal,
    InputError,
    NotConverged,
    RectangularSeal,
    cell_permeability,
    permeability_tensor,
    self_affine,
)
from femseal.flow.percolation import nodes_reached

D = 1e-6
KINDS = ("cut by a plane", "white noise", "log-normal", "one channel", "stretched pixels")


def hard_links(seed):
    """A cell of 24 to 200 pixels a side that is nearly closed, rough at the pixel, of extreme contrast or stretched."""
    rng = np.random.default_rng([11, seed])
    kind = KINDS[seed % len(KINDS)]
    shape = tuple(int(n) for n in rng.integers(24, 200, 2))
    roll_off = max(9 * D, min(shape) * D / rng.uniform(1, 6))
    size = (shape[0] * D, shape[1] * D)
    z = self_affine(
        shape, size, hurst=0.8, rms_slope=0.2, roll_off=roll_off, cut_off=8 * D, rng=seed
    ).heights
    spacing = (D, D)
    if kind == "white noise":
        z = rng.standard_normal(shape)
        h = np.maximum(np.quantile(z, 1 - rng.uniform(0, 0.42)) - z, 0)
    elif kind == "log-normal":
        h = np.exp(rng.uniform(0.5, 6) * z / z.std())
        h[h < np.quantile(h, rng.uniform(0, 0.4))] = 0
    elif kind == "one channel":
        h = np.maximum(np.quantile(z, 1 - rng.uniform(0.3, 0.6)) - z, 0)
        column = rng.integers(shape[1])
        h[:, column] = np.maximum(h[:, column], h.max() * 10 ** -rng.uniform(0, 5))
    else:
        h = np.maximum(np.quantile(z, 1 - rng.uniform(0, 0.5)) - z, 0)
        if kind == "stretched pixels":
            spacing = (D, D * 10 ** rng.uniform(-1, 1))
    return cell_links(h / h.max(), spacing, ("mirror", "periodic")[seed // len(KINDS) % 2])


@pytest.mark.slow
@pytest.mark.parametrize("block", range(10))
def test_random_cells_whatever_the_solver_chosen(block):
    for seed in range(100 * block, 100 * (block + 1)):
        c1, c2 = hard_links(seed)
        exact = solve_links(c1, c2, solver="elimination")
        for rtol in (1e-3, 1e-6):
            chosen = solve_links(c1, c2, rtol=rtol)
            assert chosen.percolates == exact.percolates
            assert_allclose(
                chosen.conductance,
                exact.conductance,
                rtol=rtol,
                err_msg=f"seed {seed}, {KINDS[seed % len(KINDS)]}",
            )
        balanced = solve_links(c1, c2, field_rtol=1e-6)
        assert_allclose(balanced.conductance, exact.conductance, rtol=1e-6)
        assert max(balanced.imbalance, exact.imbalance) <= 1e-5


@pytest.mark.slow
@pytest.mark.parametrize("share", [0.05, 0.35])
def test_4096_pixels_a_side(share):
    n = 4096
    z = self_affine(
        (n, n), (n * D, n * D), hurst=0.8, rms_slope=0.2, roll_off=n * D / 4, cut_off=8 * D, rng=1
    ).heights
    h = np.maximum(np.quantile(z[::8, ::8], 1 - share) - z, 0)
    k = cell_permeability(h, (D, D), sides="periodic", field_rtol=1e-6)
    assert 0 < k.iterations < 200
    assert_allclose(cell_permeability(h, (D, D), sides="periodic").value, k.value, rtol=1e-6)
    # in every section the same flow
    c1, _ = cell_links(h, (D, D), "periodic")
    p = np.nan_to_num(k.fluid_pressure)
    sections = (c1[1:-1] * (p[:-1] - p[1:])).sum(axis=1)
    assert_allclose(sections, k.value, rtol=1e-4)


# --- thousands of random cells against elimination ---


def random_cell(seed):
    """1 to 128 pixels a side, of ten kinds with gaps from 1 down to 1e-12 of the largest: network of links."""
    rng = np.random.default_rng([77, seed])
    shape = n1, n2 = tuple(
        int(
            rng.choice(
                [rng.integers(1, 12), rng.integers(8, 64), rng.integers(32, 129)],
                p=[0.15, 0.45, 0.4],
            )
        )
        for _ in range(2)
    )
    sides, spacing = ("mirror", "periodic")[int(rng.integers(2))], (D, D)

    def face():
        roll_off, cut_off, seed = (
            128 * D / rng.uniform(1, 6),
            rng.choice([4, 8, 16]) * D,
            int(rng.integers(1 << 30)),
        )
        surface = self_affine(
            (128, 128),
            (128 * D, 128 * D),
            hurst=0.8,
            rms_slope=0.2,
            roll_off=roll_off,
            cut_off=cut_off,
            rng=seed,
        )
        return surface.heights[:n1, :n2]

    def cut(z, least, most):
        return np.maximum(np.quantile(z, 1 - rng.uniform(least, most)) - z, 0)

    def blocks(side, *values):
        return np.kron(
            rng.random((n1 // side + 1, n2 // side + 1)) < rng.uniform(*values),
            np.ones((side, side)),
        )

    kind = seed % 10
    if kind == 0:  # cut by a plane
        h = cut(face(), 0, 0.55)
    elif kind == 1:
        h = cut(rng.standard_normal(shape), 0, 0.42)
    elif kind == 2:  # log-normal
        z = face()
        h = np.exp(rng.uniform(0.5, 11) * z / (z.std() or 1))
        h[h < np.quantile(h, rng.uniform(0, 0.4))] = 0
    elif kind == 3:  # one channel
        h = cut(face(), 0.3, 0.6)
        column = rng.integers(n2)
        h[:, column] = np.maximum(h[:, column], (h.max() or 1) * 10 ** -rng.uniform(0, 5))
    elif kind == 4:  # stretched pixels
        h = cut(face(), 0, 0.5)
        spacing = (D, D * 10 ** rng.uniform(-1.5, 1.5))
    elif kind == 5:  # a film over contact
        h = cut(face(), 0.1, 0.7)
        h = np.maximum(h / (h.max() or 1), 10 ** -rng.uniform(1, 5))
    elif kind == 6:  # fragments
        h = blocks(rng.integers(1, 8), 0.55, 0.95)[:n1, :n2]
        h = h * np.exp(rng.uniform(0, 3) * rng.standard_normal(shape))
    elif kind == 7:  # nearly closed
        z = face()
        closed, opened = z.min(), z.max()
        for _ in range(18):
            level = (closed + opened) / 2
            flow = nodes_reached(
                *cell_links(np.maximum(level - z, 0) / (z.std() or 1), spacing, sides)
            )
            closed, opened = (closed, level) if flow[0].max() == 3 else (level, opened)
        h = np.maximum(opened - z, 0)
    elif kind == 8:  # two gaps
        side = rng.integers(1, 10)
        wide = blocks(side, 0.3, 0.7)[:n1, :n2] > 0
        h = np.where(wide, 1.0, 10.0 ** -rng.uniform(0, 5)) * np.exp(
            0.3 * rng.standard_normal(shape)
        )
    else:  # grooves across the flow
        h = np.abs(rng.standard_normal((n1, 1))) * np.ones((1, n2)) * 10 ** -rng.uniform(0, 4)
        h = np.where(rng.random(shape) < 0.05, 1.0, h)
        h[rng.random(shape) < rng.uniform(0, 0.3)] = 0
    return cell_links(h / h.max() if h.max() > 0 else h + 1, spacing, sides)


def check_random_cell(seed, rtol):
    c1, c2 = random_cell(seed)
    exact, found = solve_links(c1, c2, solver="elimination"), solve_links(c1, c2, rtol=rtol)
    assert found.percolates == exact.percolates
    assert_allclose(found.conductance, exact.conductance, rtol=rtol, err_msg=f"seed {seed}")
    assert (
        abs(found.conductance - exact.conductance)
        <= max(found.residual**2, 1e-13) * exact.conductance
    ), seed
    return found


@pytest.mark.parametrize("seed", [10272, 10392, 10572, 10605, 10028])
def test_links_lost_in_sums_that_carry_flow(seed):
    """Most of the flow is through links beside which multigrid cannot see 1e-4 to 1e-2 of it."""
    for rtol in (1e-3, 1e-6, 1e-9):
        check_random_cell(seed, rtol)
    c1, c2 = random_cell(seed)
    exact = solve_links(c1, c2, solver="elimination").conductance
    loose = solve_links(c1, c2, rtol=0.02, solver="multigrid")
    assert 1e-4 < loose.residual**2 <= 0.02
    assert_allclose(loose.conductance, exact, rtol=1e-6)
    with pytest.raises(NotConverged, match=r"too narrow for multigrid|inlet and outlet differ"):
        solve_links(c1, c2, rtol=1e-9, solver="multigrid")


@pytest.mark.slow
@pytest.mark.parametrize("first", range(0, 10000, 1000))
def test_ten_thousand_random_cells(first):
    used = {check_random_cell(seed, 1e-6).solver for seed in range(first, first + 1000)}
    assert used == {"multigrid", "elimination", "none"}


@pytest.mark.slow
@pytest.mark.parametrize("rtol", [1e-3, 1e-9])
def test_random_cells_at_other_tolerances(rtol):
    for seed in range(10000, 12000):
        check_random_cell(seed, rtol)


# --- bounds, tensor and units of small random cells ---


def small_cell(seed):
    """1 × 1 to 24 × 24 pixels to 1:30: noise, one channel, few heights, cut by a plane, log-normal, checkers."""
    rng = np.random.default_rng([20, seed])
    shape = n1, n2 = tuple(int(n) for n in rng.integers(1, (13, 13, 25)[seed % 3], 2))
    kind = rng.integers(7)
    if kind == 0:
        h = rng.random(shape)
    elif kind == 1:
        h, j = np.zeros(shape), rng.integers(n2)
        for i in range(n1):
            h[i, j] = rng.random() + 0.01
            if rng.random() < 0.4:
                j = min(max(j + rng.integers(-1, 2), 0), n2 - 1)
                h[i, j] = rng.random() + 0.01
    elif kind == 2:
        h = rng.integers(0, rng.integers(2, 6), shape).astype(float)
    elif kind == 3:
        h = np.maximum(rng.standard_normal(shape) + rng.uniform(-0.5, 1), 0)
    elif kind == 4:
        h = np.exp(rng.uniform(0.5, 5) * rng.standard_normal(shape))
    elif kind == 5:
        h = np.where(np.indices(shape).sum(0) % 2, 1.0, rng.random() * rng.integers(0, 2))
    else:
        h = (rng.random(shape) < rng.uniform(0.5, 1)).astype(float)
    spacing = (
        (D, D * float(np.exp(rng.uniform(-1, 1) * np.log(30)))) if rng.random() < 0.5 else (D, D)
    )
    return D * h, spacing, ("mirror", "periodic")[rng.integers(2)]


_ALONG = np.array([[2, 1, -2, -1], [1, 2, -1, -2], [-2, -1, 2, 1], [-1, -2, 1, 2]]) / 6
_ACROSS = _ALONG[np.ix_([0, 2, 1, 3], [0, 2, 1, 3])]


def q1_energy(k, spacing, columns, given, values):
    """Least energy of Q1 elements on pixel corners: `columns` numbers their columns, `given` nodes have `values`."""
    n1 = len(k)
    node = np.arange(n1 + 1)[:, None] * (columns.max() + 1) + columns
    corners = np.stack([node[:-1, :-1], node[:-1, 1:], node[1:, :-1], node[1:, 1:]], axis=-1)[k > 0]
    local = _ALONG * spacing[1] / spacing[0] + _ACROSS * spacing[0] / spacing[1]
    entries = k[k > 0][:, None, None] * local
    size = int(node.max()) + 1
    rows, cols = np.repeat(corners, 4, axis=1).ravel(), np.tile(corners, (1, 4)).ravel()
    matrix = sp.coo_array((entries.ravel(), (rows, cols)), shape=(size, size)).tocsr()
    p = np.zeros(size)
    p[given] = values
    label = connected_components(matrix, directed=False)[1]
    linked = np.isin(label, label[given[values > 0]]) & np.isin(label, label[given[values == 0]])
    linked[given] = False
    free = np.flatnonzero(linked)
    if free.size:
        inner = matrix[free][:, free]
        scale = 1 / np.sqrt(inner.diagonal())
        scaled = sp.csc_array(sp.diags_array(scale) @ inner @ sp.diags_array(scale))
        p[free] = np.clip(scale * spsolve(scaled, -scale * (matrix[free] @ p)), 0, 1)
    drop = p[corners] - p[corners[:, :1]]
    # elements that both ends do not reach carry nothing
    return float(
        np.einsum("ea,eab,eb->e", drop, entries, drop)[
            (linked[corners] | np.isin(corners, given)).any(1)
        ].sum()
    )


def finer_bounds(gap, spacing, sides, parts=2):
    """Bounds on pixels cut into parts² of the energies of a pressure, and of a stream function across if all is open."""
    k = np.kron((gap / gap.max()) ** 3 / 12, np.ones((parts, parts)))
    n1, n2 = k.shape
    columns = np.arange(n2 + 1) % n2 if sides == "periodic" else np.arange(n2 + 1)
    m = int(columns.max()) + 1
    ends = np.r_[np.arange(m), n1 * m + np.arange(m)]
    shape_factor = gap.max() ** 3 * n1 * spacing[0] / (n2 * spacing[1])
    upper = q1_energy(k, spacing, columns, ends, np.repeat([1.0, 0.0], m))
    lower = 0.0
    if sides == "mirror" and k.min() > 0:
        sidelong = np.arange(n1 + 1) * (n2 + 1)
        lower = 1 / q1_energy(
            1 / k, spacing, columns, np.r_[sidelong, sidelong + n2], np.repeat([0.0, 1.0], n1 + 1)
        )
    return shape_factor * lower, shape_factor * upper


def check_small_cell(seed):
    gap, spacing, sides = small_cell(seed)
    found = cell_permeability(gap, spacing, sides=sides, bounds=True)
    assert 0 <= found.lower <= found.upper
    tensor = None
    try:
        tensor = permeability_tensor(gap, spacing)
    except NotConverged:
        assert gap.max() > 1e4 * gap[gap > 0].min()
    else:
        assert np.array_equal(tensor, tensor.T)
        assert np.linalg.eigvalsh(tensor).min() >= -1e-14 * tensor.max()
    if gap.max() > 0:
        lower, upper = finer_bounds(gap, spacing, sides)
        assert found.lower <= upper * (1 + 1e-9), seed
        assert found.upper >= lower * (1 - 1e-9), seed
    # other units, powers of two, change no digit
    rng = np.random.default_rng([21, seed])
    unit, pixel = 2.0 ** rng.integers(-160, 160), 2.0 ** rng.integers(-500, 500)
    spacing = spacing[0] * pixel, spacing[1] * pixel
    other = cell_permeability(unit * gap, spacing, sides=sides, bounds=True)
    expected = unit**3 * np.array([found.value, found.lower, found.upper])
    assert_allclose(
        [other.value, other.lower, other.upper], expected, rtol=1e-13, err_msg=str(seed)
    )
    if tensor is not None:
        assert_allclose(
            permeability_tensor(unit * gap, spacing),
            unit**3 * tensor,
            rtol=1e-13,
            err_msg=str(seed),
        )


def test_bounds_tensor_and_units_of_small_cells():
    for seed in range(40):
        check_small_cell(seed)


@pytest.mark.slow
@pytest.mark.parametrize("first", range(1000, 5000, 500))
def test_bounds_tensor_and_units_of_thousands_of_small_cells(first):
    for seed in range(first, first + 500):
        check_small_cell(seed)


@pytest.mark.parametrize(
    ("gap", "spacing", "words"),
    [
        (1e70, (D, D), ["gap", "1e+70"]),
        (1e-70, (D, D), ["gap", "1e-70"]),
        ([D, 1e-60 * D], (D, D), ["gap", "1e-66"]),
        (D, (1e40, 1e-40), ["spacing", "1e+40"]),
    ],
)
@pytest.mark.parametrize("function", [cell_permeability, permeability_tensor])
def test_what_double_precision_cannot_bear_is_refused_by_name(function, gap, spacing, words):
    h = np.ones((4, 4))
    h[1] = np.linspace(0, 1, 4) > 0.5
    h = np.where(h > 0, np.max(gap), np.min(gap) if np.ndim(gap) else 0.0)
    with pytest.raises(InputError) as caught:
        function(h, spacing)
    assert all(word in str(caught.value) for word in words)


# --- bounds of structured seals ---


def effective_link(stencil):
    """Conductance between the ends by star-mesh elimination of one node after the other in long double."""
    n1, n2 = stencil.along.shape
    inner = (n1 - 1) * n2
    number = np.concatenate([np.full(n2, inner), np.arange(inner), np.full(n2, inner + 1)])
    links = np.zeros((inner + 2, inner + 2), np.longdouble)
    for c, a, b, _ in stencil.conductances():
        i, j = number[a.ravel()], number[b.ravel()]
        np.add.at(links, (i, j), c.ravel())
        np.add.at(links, (j, i), c.ravel())
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
    seal = (
        AnnularSeal(length, length * (1 + ratio), cells)
        if seed % 2
        else RectangularSeal((length, ratio), cells)
    )
    spread, closed = rng.uniform(0, 15) * (rng.random() < 0.8), rng.choice([0, 0.1, 0.3])
    unit = 10.0 ** rng.integers(-60, 30)
    k = [
        unit * np.exp(spread * rng.standard_normal(s)) * (rng.random(s) > closed)
        for s in ((n1, n2), (n1 - 1, n2))
    ]
    flow = seal.flow(tuple(k), bounds=True)
    exact = effective_link(seal.stencil(tuple(k)))
    assert flow.lower <= exact <= flow.upper, seed
    assert flow.lower <= flow.conductance <= flow.upper, seed
    assert flow.upper - flow.lower <= 1e-4 * flow.upper, seed


def test_bounds_of_structured_seals_hold_to_the_last_digit():
    for seed in range(60):
        check_seal(seed)


@pytest.mark.slow
@pytest.mark.parametrize("first", range(1000, 5000, 1000))
def test_bounds_of_thousands_of_structured_seals(first):
    for seed in range(first, first + 1000):
        check_seal(seed)
