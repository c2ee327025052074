"""Random contacts and flows of every size, load, hardness, contrast and boundary: what holds of all of them."""

import numpy as np
import pytest
from networks import mesh_of_pixels
from numpy.testing import assert_allclose
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from femseal import HalfSpace, cell_permeability, load_cycle, solve_contact

D, E = 1e-6, 115e9
#: Sides in pixels: one, few, primes, powers of two, others.
SIDES = (1, 2, 3, 5, 8, 12, 13, 16, 17, 24, 29, 31, 32, 37)


def shape_of(rng):
    """Sides of a grid, one in eight of a single row or column."""
    n1, n2 = (int(n) for n in rng.choice(SIDES, 2))
    return [(n1, n2), (1, n2), (n1, 1)][rng.choice(3, p=[0.875, 0.0625, 0.0625])]


def spacing_of(rng):
    """Pixels, one in four oblong up to 1 : 30."""
    return D, D * (float(np.exp(rng.uniform(-1, 1) * np.log(30))) if rng.random() < 0.25 else 1.0)


def heights_of(rng, shape):
    """Heights of mean 0 and deviation 1, or all 0: smooth, rough, white, steps, a plateau, grooves, spikes, flat."""
    kind = rng.integers(8)
    q = np.hypot(np.fft.fftfreq(shape[0])[:, None], np.fft.fftfreq(shape[1]))
    z = rng.standard_normal(shape)
    if kind in (0, 1):
        amplitude = np.where(
            (q > 0) & (q < (0.15 if kind == 0 else 1)), np.maximum(q, 0.05) ** -1.8, 0.0
        )
        z = np.fft.ifft2(np.fft.fft2(z) * amplitude).real
    elif kind == 3:
        z = rng.integers(0, 5, shape).astype(float)
    elif kind == 4:
        z = np.zeros(shape)
        i, j = (rng.integers(n) for n in shape)
        z[i : i + 1 + shape[0] // 3, j : j + 1 + shape[1] // 3] = 1
    elif kind == 5:
        i, j = np.indices(shape)
        z = np.cos(2 * np.pi * (rng.integers(4) * i / shape[0] + rng.integers(4) * j / shape[1]))
    elif kind == 6:
        z = 0.1 * z + 20 * (rng.random(shape) < 0.01)
    elif kind == 7 and rng.random() < 0.3:
        z = np.zeros(shape)
    z = z - z.mean()
    return z / z.std() if z.std() > 1e-9 else np.zeros(shape)


# --- contact ---


def residual(contact, gap0, hardness):
    """‖p − clip(p − c(v − δ), 0, H)‖/‖p‖."""
    p, half_space = contact.pressure, contact.half_space
    spacing = [d for n, d in zip(half_space.shape, half_space.spacing, strict=True) if n > 1]
    c = (
        np.pi
        * E
        / (4 * np.prod(spacing or [min(half_space.spacing)]) ** (1 / max(len(spacing), 1)))
    )
    raw = half_space.displacement(p) + gap0 - contact.approach
    return np.linalg.norm(p - np.clip(p - c * raw, 0, hardness)) / np.linalg.norm(p)


def check_state(contact, gap0, pressure, hardness, rtol):
    """Equilibrium, bounds and complementarity of a state; `gap0` with the deformation left by a peak."""
    p, gap = contact.pressure, contact.gap
    assert 0 <= p.min() <= p.max() <= hardness
    assert abs(p.mean() / pressure - 1) <= 1e-9
    assert gap.min() >= 0
    assert not gap[p > 0].any()
    assert contact.plastic_deformation.min() >= 0
    assert residual(contact, gap0, hardness) <= 2 * rtol


def turned(field, way):
    """A field read from the other end of an axis, or with its axes exchanged."""
    return field.T if way == 2 else np.flip(field, way)


def check_contact(seed):
    """One contact of slopes to 1, hardness 0.01 to 100 of E*h′ or none, loads from 1e-6 to 0.999 of it."""
    rng = np.random.default_rng([41, seed])
    shape, spacing, rtol = shape_of(rng), spacing_of(rng), 1e-7
    boundary = tuple(str(kind) for kind in rng.choice(["periodic", "mirror", "free"], 2))
    half_space = HalfSpace(shape, spacing, E, boundary)
    slope = 10 ** rng.uniform(-3, 0)
    gap0 = -slope * D * heights_of(rng, shape)
    hardness = E * slope * 10 ** rng.uniform(-2, 2) if rng.random() < 0.75 else np.inf
    top = hardness if np.isfinite(hardness) else 2 * E * slope
    share = float(
        rng.choice(
            [10 ** rng.uniform(-6, 0), rng.uniform(0.001, 0.999), 1 - 10 ** rng.uniform(-3, -1)]
        )
    )
    loads = [share * top * part for part in (0.3, 0.8)]
    peak = share * top
    states = load_cycle(
        gap0,
        half_space,
        loading=loads,
        hardness=hardness,
        unload_from=[peak],
        unloading=[peak * 0.9999, loads[0]],
        rtol=rtol,
    )
    low, middle, high, near, back = (state.contact for state in states)
    left = high.plastic_deformation
    for contact, load, before in zip(
        (low, middle, high, near, back),
        (*loads, peak, peak * 0.9999, loads[0]),
        (0, 0, 0, left, left),
        strict=True,
    ):
        check_state(contact, gap0 + before, load, hardness, rtol)
        grown = contact.plastic_deformation - before
        assert grown.min() >= -1e-12 * (1e-300 + left.max())
        assert not grown[contact.pressure < hardness].any()
    # the approach is the slope of a convex energy
    depth = (
        np.abs(np.diff([c.approach for c in (low, middle, high)])).max() + np.ptp(gap0) + 1e-9 * D
    )
    assert low.approach <= middle.approach + 1e-6 * depth
    assert middle.approach <= high.approach + 1e-6 * depth
    # one that touches nowhere else is left as it was
    assert_allclose(near.pressure, high.pressure, rtol=0, atol=2e-2 * high.pressure.max())
    if np.isinf(hardness):
        assert not left.any()
        assert np.linalg.norm(back.pressure - low.pressure) <= 1e-3 * np.linalg.norm(low.pressure)
    else:
        assert back.approach >= low.approach - 1e-6 * depth
    check_other_views(rng, gap0, half_space, middle, loads[1], hardness, rtol)


def check_other_views(rng, gap0, half_space, contact, pressure, hardness, rtol):
    """The same contact seen from another side, and in other units."""
    way = int(rng.integers(3))
    seen = half_space
    if way == 2:
        seen = HalfSpace(
            half_space.shape[::-1], half_space.spacing[::-1], E, half_space.boundary[::-1]
        )
    other = solve_contact(turned(gap0, way), seen, pressure=pressure, hardness=hardness, rtol=rtol)
    difference = turned(other.pressure, way) - contact.pressure
    assert np.linalg.norm(difference) <= 1e-3 * np.linalg.norm(contact.pressure)
    unit, stress = 2.0 ** rng.integers(-60, 60), 2.0 ** rng.integers(-60, 60)
    scaled = HalfSpace(
        half_space.shape,
        tuple(unit * d for d in half_space.spacing),
        stress * E,
        half_space.boundary,
    )
    other = solve_contact(
        unit * gap0, scaled, pressure=stress * pressure, hardness=stress * hardness, rtol=rtol
    )
    assert_allclose(
        other.pressure / stress, contact.pressure, rtol=1e-9, atol=1e-9 * contact.pressure.max()
    )


# --- flow ---


def gap_of(rng, shape):
    """A gap [m]: cut by a plane, log-normal to 1e15 in its cube, of few heights, open or closed, one channel, flat."""
    z, kind = heights_of(rng, shape), rng.integers(6)
    if kind == 0:
        h = np.maximum(np.quantile(z, 1 - rng.uniform(0, 0.6)) - z, 0)
    elif kind == 1:
        h = np.exp(rng.uniform(0, 4) * z)
        h = np.where(rng.random(shape) < rng.choice([0, 0.2]), 0, np.maximum(h, 1e-5 * h.max()))
    elif kind == 2:
        h = rng.integers(0, 4, shape).astype(float)
    elif kind == 3:
        h = (rng.random(shape) < rng.uniform(0.4, 1)) * 1.0
    elif kind == 4:
        h = np.zeros(shape)
        h[:, rng.integers(shape[1])] = rng.uniform(0.1, 1, shape[0])
        h[rng.integers(shape[0])] *= rng.choice([0.0, 1e-5, 1.0])
    else:
        h = np.full(shape, rng.uniform(0.1, 10))
    return D * h


def is_open(gap, sides):
    """Whether open pixels join both ends of x1 over common sides: by components of a graph."""
    node = np.arange(gap.size).reshape(gap.shape)
    pairs = [(node[:-1], node[1:]), (node[:, :-1], node[:, 1:])]
    if sides == "periodic":
        pairs.append((node[:, -1], node[:, 0]))
    a, b = (np.concatenate([pair[end].ravel() for pair in pairs]) for end in (0, 1))
    both = (gap.ravel()[a] > 0) & (gap.ravel()[b] > 0)
    graph = coo_array((np.ones(both.sum()), (a[both], b[both])), shape=(gap.size, gap.size))
    part = np.where(gap > 0, connected_components(graph, directed=False)[1].reshape(gap.shape), -1)
    return bool((set(part[0].tolist()) & set(part[-1].tolist())) - {-1})


def means(gap, spacing):
    """Permeability of columns alone and of rows that are all mixed, which enclose that of the pixels."""
    k = gap**3 / 12
    with np.errstate(divide="ignore"):
        return float(np.mean(1 / np.mean(1 / k, axis=0))), float(
            1 / np.mean(1 / np.mean(k, axis=1))
        )


def least_open(gap):
    """The smallest gap that is not closed."""
    return np.min(gap, where=gap > 0, initial=np.inf)


def check_flow(seed):
    """One cell of contrasts to 1e15, closed, open or between, along an axis, with mirrored or periodic sides."""
    rng = np.random.default_rng([42, seed])
    shape, spacing = shape_of(rng), spacing_of(rng)
    gap, sides = gap_of(rng, shape), str(rng.choice(["mirror", "periodic"]))
    rtol = float(rng.choice([1e-3, 1e-6, 1e-9]))
    found = cell_permeability(gap, spacing, sides=sides, bounds=True, rtol=rtol)
    assert found.percolates == (found.value > 0) == is_open(gap, sides)
    assert np.isfinite([found.value, found.lower, found.upper]).all()
    assert (found.lower > 0) == found.percolates
    p = found.fluid_pressure[np.isfinite(found.fluid_pressure)]
    assert not p.size or (p.min() >= -(rtol**0.5) and p.max() <= 1 + rtol**0.5)
    # the gap constant on each pixel: bounds, those of a mesh and means in order
    least, most = means(gap, spacing)
    assert found.lower <= found.upper <= most * (1 + 1e-9)
    oblong = max(spacing) / min(spacing)
    if sides == "mirror" and (gap.max() / least_open(gap)) ** 3 * oblong**2 < 1e9:
        mesh = mesh_of_pixels(gap, spacing)
        assert found.lower <= mesh.lower * (1 + 1e-5)
        assert least * (1 - 1e-5) <= mesh.lower <= mesh.upper <= found.upper * (1 + 1e-5)
    # the same cell from another side, along the other axis, in other units, and by elimination
    same = [
        cell_permeability(gap[::-1], spacing, sides=sides, rtol=rtol),
        cell_permeability(gap[:, ::-1], spacing, sides=sides, rtol=rtol),
        cell_permeability(gap.T, spacing[::-1], sides=sides, rtol=rtol, axis=1),
        cell_permeability(gap, spacing, sides=sides, solver="elimination"),
    ]
    if sides == "periodic":
        same.append(
            cell_permeability(
                np.roll(gap, int(rng.integers(shape[1])), axis=1), spacing, sides=sides, rtol=rtol
            )
        )
    assert_allclose([other.value for other in same], found.value, rtol=2 * rtol + 1e-9)
    unit, pixel = 2.0 ** rng.integers(-60, 60), 2.0 ** rng.integers(-100, 100)
    scaled = cell_permeability(
        unit * gap, (pixel * spacing[0], pixel * spacing[1]), sides=sides, rtol=rtol
    )
    assert_allclose(scaled.value, unit**3 * found.value, rtol=1e-12)
    # less gap, no more flow
    less = gap * rng.choice([0.0, 0.5, 1.0], gap.shape, p=[0.02, 0.08, 0.9])
    closed = cell_permeability(less, spacing, sides=sides, bounds=True)
    assert closed.lower <= found.upper
    # any pressure gives an upper bound; at higher contrasts no solver finds the one that gives the lowest
    if gap.max() ** 3 <= 1e12 * least_open(less) ** 3:
        assert closed.upper <= found.upper * (1 + 1e-9)
    assert not closed.percolates or found.percolates


# --- both ---


def check_cycle(seed):
    """Gaps of a rough face along a cycle: less flow under more load, and no more than before after a peak."""
    rng = np.random.default_rng([43, seed])
    shape = tuple(int(n) for n in rng.choice([12, 16, 24, 29], 2))
    half_space = HalfSpace(shape, (D, D), E, "periodic")
    slope = 10 ** rng.uniform(-2.5, -0.5)
    gap0 = -slope * D * heights_of(rng, shape)
    hardness = E * slope * 10 ** rng.uniform(-1.5, 1)
    loads = np.sort(rng.uniform(0.001, 0.5, 2)) * hardness
    cycle = load_cycle(
        gap0,
        half_space,
        loading=loads,
        hardness=hardness,
        unload_from=[0.9 * hardness],
        unloading=[loads[0]],
        rtol=1e-7,
    )
    # not the values themselves: between pixels they take a cubic of the gap, which may rise where each pixel falls
    low, high, peak, back = (
        cell_permeability(state.contact.gap, (D, D), sides="periodic", bounds=True)
        for state in cycle
    )
    for more, less in ((low, high), (high, peak), (low, back)):
        assert less.lower <= more.upper, seed
        assert more.percolates >= less.percolates, seed


def test_random_contacts():
    for seed in range(50):
        check_contact(seed)


def test_random_flows():
    for seed in range(50):
        check_flow(seed)


def test_random_cycles():
    for seed in range(10):
        check_cycle(seed)


@pytest.mark.slow
@pytest.mark.parametrize("check", [check_contact, check_flow, check_cycle])
@pytest.mark.parametrize("first", range(1000, 11000, 500))
def test_ten_thousand_of_each(check, first):
    for seed in range(first, first + 500):
        check(seed)
