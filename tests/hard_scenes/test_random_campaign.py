"""Random contacts and flows of every size, load, hardness, contrast and boundary: what holds of all of them."""

import numpy as np
import pytest
from contact_checks import residual
from networks import mesh_of_pixels, open_paths
from numpy.testing import assert_allclose

from femseal import (
    HalfSpace,
    NotConverged,
    cell_permeability,
    load_cycle,
    permeability_tensor,
    solve_contact,
)

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
    i, j = np.indices(shape)
    z = rng.standard_normal(shape)
    if kind < 2:
        q = np.hypot(*np.ix_(*map(np.fft.fftfreq, shape)))
        waves = (q > 0) & (q < (0.15, 1)[kind])
        amplitude = np.where(waves, np.maximum(q, 0.05) ** -1.8, 0.0)
        z = np.fft.ifft2(np.fft.fft2(z) * amplitude).real
    elif kind == 3:
        z = rng.integers(0, 5, shape).astype(float)
    elif kind == 4:
        a, b = (rng.integers(n) for n in shape)
        z = 1.0 * ((abs(i - a) <= shape[0] / 6) & (abs(j - b) <= shape[1] / 6))
    elif kind == 5:
        z = np.cos(2 * np.pi * (rng.integers(4) * i / shape[0] + rng.integers(4) * j / shape[1]))
    elif kind == 6:
        z = 0.1 * z + 20 * (rng.random(shape) < 0.01)
    elif kind == 7 and rng.random() < 0.3:
        z = np.zeros(shape)
    z = z - z.mean()
    return z / z.std() if z.std() > 1e-9 else np.zeros(shape)


# --- contact ---


def check_state(state, gap0, left, hardness, rtol):
    """Equilibrium, bounds and complementarity of a state of a gap with the deformation left by a peak."""
    contact = state.contact
    p, gap, grown = contact.pressure, contact.gap, contact.plastic_deformation - left
    assert 0 <= p.min() <= p.max() <= hardness
    assert abs(p.mean() / state.pressure - 1) <= 1e-9
    assert gap.min() >= 0
    assert not gap[p > 0].any()
    assert grown.min() >= -1e-12 * np.max(left)
    assert not grown[p < hardness].any()
    assert residual(contact, gap0 + left, hardness=hardness) <= 2 * rtol


def turned(field, way):
    """A field read from the other end of an axis, or with its axes exchanged."""
    return field.T if way == 2 else np.flip(field, way)


def check_contact(seed):
    """One contact of slopes to 1, hardness 0.01 to 100 of E*h′ or none, loads from 1e-6 to 0.999 of it."""
    rng = np.random.default_rng([41, seed])
    shape, spacing, rtol = shape_of(rng), spacing_of(rng), 1e-7
    boundary = tuple(str(kind) for kind in rng.choice(["periodic", "mirror", "free"], 2))
    body = HalfSpace(shape, spacing, E, boundary)
    slope = 10 ** rng.uniform(-3, 0)
    gap0 = -slope * D * heights_of(rng, shape)
    hardness = E * slope * 10 ** rng.uniform(-2, 2) if rng.random() < 0.75 else np.inf
    shares = 10 ** rng.uniform(-6, 0), rng.uniform(0.001, 0.999), 1 - 10 ** rng.uniform(-3, -1)
    peak = rng.choice(shares) * min(hardness, 2 * E * slope)
    loads = [0.3 * peak, 0.8 * peak]
    near = 0.9999 * peak
    given = {"hardness": hardness, "rtol": rtol}
    states = load_cycle(
        gap0, body, loading=loads, unload_from=[peak], unloading=[near, loads[0]], **given
    )
    low, middle, high, near, back = (state.contact for state in states)
    left = high.plastic_deformation
    for n, state in enumerate(states):
        check_state(state, gap0, left if n > 2 else 0 * left, hardness, rtol)
    # the approach is the slope of a convex energy
    approaches = np.array([low.approach, middle.approach, high.approach])
    tiny = 1e-6 * (np.abs(np.diff(approaches)).max() + np.ptp(gap0) + 1e-9 * D)
    assert np.diff(approaches).min() >= -tiny
    # one that touches nowhere else is left as it was
    assert_allclose(near.pressure, high.pressure, rtol=0, atol=2e-2 * high.pressure.max())
    assert back.approach >= low.approach - tiny
    if np.isinf(hardness):
        assert not left.any()
        assert np.linalg.norm(back.pressure - low.pressure) <= 1e-3 * np.linalg.norm(low.pressure)
    # the same contact seen from another side, and in other units
    way = int(rng.integers(3))
    order = -1 if way == 2 else 1
    seen = HalfSpace(shape[::order], spacing[::order], E, boundary[::order])
    other = solve_contact(turned(gap0, way), seen, pressure=loads[1], **given)
    difference = turned(other.pressure, way) - middle.pressure
    assert np.linalg.norm(difference) <= 1e-3 * np.linalg.norm(middle.pressure)
    # search directions are in single precision, whose range ends at 1e-38: their displacements must be well above
    unit, stress = 2.0 ** rng.integers(-40, 40, 2)
    scaled = HalfSpace(shape, (unit * spacing[0], unit * spacing[1]), stress * E, boundary)
    given["hardness"] = stress * hardness
    found = solve_contact(unit * gap0, scaled, pressure=stress * loads[1], **given).pressure
    assert_allclose(found / stress, middle.pressure, rtol=1e-9, atol=1e-9 * middle.pressure.max())


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


def means(gap, spacing):
    """Permeability of columns alone and of rows that are all mixed, which enclose that of the pixels."""
    k = gap**3 / 12
    with np.errstate(divide="ignore"):
        return float(np.mean(1 / np.mean(1 / k, axis=0))), float(
            1 / np.mean(1 / np.mean(k, axis=1))
        )


def check_flow(seed):
    """One cell of contrasts to 1e15, closed, open or between, along an axis, with mirrored or periodic sides."""
    rng = np.random.default_rng([42, seed])
    shape, spacing = shape_of(rng), spacing_of(rng)
    gap, sides = gap_of(rng, shape), str(rng.choice(["mirror", "periodic"]))
    rtol = float(rng.choice([1e-3, 1e-6, 1e-9]))
    given = {"sides": sides, "rtol": rtol}
    found = cell_permeability(gap, spacing, **given)
    assert found.percolates == (found.value > 0) == open_paths(gap, sides == "periodic")
    assert np.isfinite(found.value)
    p = found.fluid_pressure[np.isfinite(found.fluid_pressure)]
    assert np.all((p >= -(rtol**0.5)) & (p <= 1 + rtol**0.5))
    contrast = (gap.max() / np.min(gap, where=gap > 0, initial=np.inf)) ** 3
    stretched = contrast * (max(spacing) / min(spacing)) ** 2
    # the same cell from another side, along the other axis, moved, in other units, and by elimination
    unit, pixel = 2.0 ** rng.integers(-60, 60), 2.0 ** rng.integers(-100, 100)
    moved = np.roll(gap, int(rng.integers(shape[1])) if sides == "periodic" else 0, axis=1)
    scaled = unit * gap, (pixel * spacing[0], pixel * spacing[1])
    same = [
        cell_permeability(gap[::-1], spacing, **given),
        cell_permeability(gap[:, ::-1], spacing, **given),
        cell_permeability(gap.T, spacing[::-1], **given, axis=1),
        cell_permeability(gap, spacing, sides=sides, solver="elimination"),
        cell_permeability(moved, spacing, **given),
    ]
    assert_allclose([other.value for other in same], found.value, rtol=2 * rtol + 1e-9)
    value = cell_permeability(*scaled, **given).value
    assert_allclose(value, unit**3 * found.value, rtol=1e-12)
    # a tensor is symmetric, not negative and of any unit, or refused at high contrast
    try:
        tensor = permeability_tensor(gap, spacing)
    except NotConverged:
        assert stretched > 1e9
    else:
        assert np.array_equal(tensor, tensor.T)
        assert np.linalg.eigvalsh(tensor).min() >= -1e-14 * tensor.max()
        assert_allclose(permeability_tensor(*scaled), unit**3 * tensor, rtol=1e-12)
    # less gap, no more flow through pixels of constant gap; their bounds by elements lie between two means
    if stretched < 1e9:
        least, most = means(gap, spacing)
        mesh = mesh_of_pixels(gap, spacing)
        assert least * (1 - 1e-5) <= mesh.lower <= mesh.upper <= most * (1 + 1e-5)
        less = gap * rng.choice([0.0, 0.5, 1.0], gap.shape, p=[0.02, 0.08, 0.9])
        closer = mesh_of_pixels(less, spacing)
        assert closer.lower <= mesh.lower * (1 + 1e-5)
        assert closer.upper <= mesh.upper * (1 + 1e-5)


# --- both ---


def check_cycle(seed):
    """Gaps of a rough face along a cycle: less flow under more load, and no more than before after a peak."""
    rng = np.random.default_rng([43, seed])
    body = HalfSpace(tuple(int(n) for n in rng.choice([12, 16, 24, 29], 2)), (D, D), E, "periodic")
    slope = 10 ** rng.uniform(-2.5, -0.5)
    gap0 = -slope * D * heights_of(rng, body.shape)
    h = E * slope * 10 ** rng.uniform(-1.5, 1)
    loads = np.sort(rng.uniform(0.001, 0.5, 2)) * h
    given = {"loading": loads, "unload_from": [0.9 * h], "unloading": [loads[0]]}
    gaps = [state.contact.gap for state in load_cycle(gap0, body, hardness=h, rtol=1e-7, **given)]
    # the gap constant on each pixel: between pixels the cubic may rise where each pixel falls
    closed = 1e-3 * max(gap.max() for gap in gaps)
    flows = [
        mesh_of_pixels(np.where(gap < closed, 0.0, gap), (D, D)) if gap.max() > closed else None
        for gap in gaps
    ]
    cells = [cell_permeability(gap, (D, D), sides="periodic") for gap in gaps]
    for more, less in ((0, 1), (1, 2), (0, 3)):  # loading, to the peak, back at the first load
        if flows[less] is not None:
            assert flows[less].lower <= flows[more].upper, seed
        assert cells[more].percolates >= cells[less].percolates, seed


@pytest.mark.parametrize(
    ("check", "count"), [(check_contact, 50), (check_flow, 50), (check_cycle, 10)]
)
def test_random_scenes(check, count):
    for seed in range(count):
        check(seed)


@pytest.mark.slow
@pytest.mark.parametrize("check", [check_contact, check_flow, check_cycle])
@pytest.mark.parametrize("first", range(1000, 11000, 500))
def test_ten_thousand_of_each(check, first):
    for seed in range(first, first + 500):
        check(seed)
