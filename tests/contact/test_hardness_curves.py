"""Hardness that is a curve of the depth: tables, Nix–Gao, the softer of two faces; closed forms and a dense reference."""

import numpy as np
import pytest
from contact_checks import least_energy
from numpy.testing import assert_allclose, assert_array_equal
from plastic_contacts import NIX_GAO, RTOL, STIFF, TABLE, D, E, H, solved_contact, yielding_face
from scipy.interpolate import PchipInterpolator
from scipy.optimize import brentq, root

import femseal as fs
from femseal.contact import (
    HardnessTable,
    LinearHardening,
    NixGao,
    PerfectlyPlastic,
    load_cycle,
    softer_of,
)
from femseal.contact.linear_laws import contact_law
from femseal.contact.softer_body import SofterOf
from femseal.topography import self_affine

LAWS = [TABLE, NIX_GAO, SofterOf(LinearHardening(0.2 * H, 0.02 * STIFF), PerfectlyPlastic(0.4 * H))]
LINE = LinearHardening(0.3 * H, 0.5 * STIFF)


@pytest.mark.parametrize("law", [TABLE, HardnessTable([1e-8, 1e-7], [0.5 * H, H])])
def test_a_flat_face_yields_as_the_table_says(law):
    """Where every point carries the same pressure, H(u) is it: u by the inverse of the curve."""
    for fraction in (0.3, 0.95):
        mean = law.hardness[0] + fraction * (law.hardness[-1] - law.hardness[0])
        contact = solved_contact(np.zeros((8, 6)), law, mean)
        assert_allclose(contact.pressure, mean, rtol=1e-8)
        curve = PchipInterpolator(law.depth, law.hardness)
        assert_allclose(curve(contact.plastic_deformation), mean, rtol=1e-8)


def test_beyond_its_ends_a_table_is_constant():
    law = HardnessTable([1e-8, 2e-8], [H, 2 * H])
    assert_array_equal(law.yield_pressure(np.array([0.0, 1e-8, 2e-8, 1.0])), [H, H, 2 * H, 2 * H])
    assert_array_equal(law.hardening_modulus(np.array([0.0, 5e-9, 2e-8, 1.0])), 0.0)
    assert law.capacity == 2 * H
    with pytest.raises(fs.InputError, match=r"at most 8e\+09 Pa, the largest mean pressure"):
        solved_contact(np.zeros((4, 4)), law, 2.1 * H)


def by_root(k, gap, mean, law, start):
    """p, u of a law that rises, on a dense K: p = y(p − c g) and mean p by scipy's `root`, y by `brentq` at each point."""

    def depth(trial):
        def excess(u):
            return float(law.yield_pressure(u)) + STIFF * u - trial

        return brentq(excess, 0.0, trial / STIFF, xtol=1e-20) if excess(0.0) < 0 else 0.0

    def off(x):
        p = x[:-1] * H
        trial = p - STIFF * (k @ p + gap - x[-1] * D)
        yielded = np.maximum(trial, 0) - STIFF * np.array([depth(t) for t in trial])
        return np.r_[(p - yielded) / H, p.mean() / mean - 1]

    found = root(off, np.r_[start.pressure.ravel() / H, start.approach / D], tol=1e-13)
    assert np.abs(found.fun).max() < 1e-9, found.message
    p = found.x[:-1] * H
    return p, np.array([depth(t) for t in p - STIFF * (k @ p + gap - found.x[-1] * D)])


def by_minimiser(k, gap, mean, law):
    """p, u of a law that softens: the least energy under 0 ≤ p ≤ H_i, mean p given, H_i by the law at u."""
    most = np.full(gap.size, law.mean_hardness)
    for _ in range(200):
        p = least_energy(k, gap, mean, most)
        v, elastic = k @ p + gap, (p > 1e-9 * H) & (p < most - 1e-9 * H)
        u = np.where(p >= most - 1e-9 * H, np.maximum(v[elastic].mean() - v, 0), 0.0)
        former, most = most, law.yield_pressure(u)
        if np.abs(most - former).max() < 1e-9 * H:
            return p, u
    raise AssertionError("the reference did not settle")


@pytest.mark.parametrize("law", [*LAWS, LINE], ids=["table", "Nix–Gao", "softer", "line"])
def test_curves_equal_an_independent_solution_by_scipy(law, dense_operator):
    shape = (8, 6)
    half_space = fs.HalfSpace(shape, (D, D), E, ("mirror", "periodic"))
    gap = yielding_face(shape, 0.4, seed=5)
    for mean in (0.05 * H, 0.15 * H):
        start = solved_contact(gap, float(law.mean_hardness), mean, ("mirror", "periodic"))
        given = dense_operator(half_space), gap.ravel(), mean, law
        p, u = by_minimiser(*given) if law is NIX_GAO else by_root(*given, start)
        contact = solved_contact(gap, law, mean, ("mirror", "periodic"))
        assert_allclose(contact.pressure.ravel(), p, rtol=0, atol=1e-6 * p.max())
        assert_allclose(contact.plastic_deformation.ravel(), u, rtol=0, atol=1e-6 * u.max())
        assert u.max() > 0


@pytest.mark.parametrize("width", [1e-8, 1e-10, 1e-12])
def test_a_step_in_the_table_is_solved_however_steep(width):
    """Law and complementarity recomputed from the fields."""
    law = HardnessTable([0, 1e-8, 1e-8 + width, 1e-6], [0.25 * H, 0.25 * H, H, H])
    gap = yielding_face((32, 32))
    contact = solved_contact(gap, law, 0.1 * H, rtol=1e-7)
    p, u = contact.pressure, contact.plastic_deformation
    assert_allclose(p.mean(), 0.1 * H, rtol=1e-9)
    g = contact.half_space.displacement(p) + gap - contact.approach
    assert_allclose((g + u)[p > 0], 0, atol=1e-5 * np.ptp(gap))
    # the curve between the depths a little less and a little more: u itself is known to its residual
    least, most = (law.yield_pressure(np.maximum(u + sign * 1e-13, 0)) for sign in (-1, 1))
    yields = u > 1e-12
    assert np.all((p >= least * (1 - 1e-5))[yields] & (p <= most * (1 + 1e-5))[yields])
    assert np.any(u > 1e-8 + width)
    assert np.any((p > 0.26 * H) & (p < 0.99 * H) & yields)


@pytest.mark.parametrize(
    ("depth", "hardness", "load"),
    [
        ([0, 0.27, 0.88, 1.36], [4.7, 7.0, 2.3, 4.3], 3e8),
        ([0, 0.066, 2.323], [4.95, 2.34, 6.37], 1e8),
    ],  # µm, GPa, Pa
)
def test_a_table_that_falls_between_rises_is_solved(depth, hardness, load):
    """Points turn back and forth between two tangents unless they go half way."""
    law = HardnessTable(1e-6 * np.array(depth), 1e9 * np.array(hardness))
    contact = on_its_curve(law, load, (32, 32), 210e9 / 2 / (1 - 0.3**2), 60e-6)
    assert contact.plastic_deformation.max() > 1e-6 * depth[1]  # beyond the first turn


def on_its_curve(law, load, shape, modulus, roll_off):
    """A contact of a rough face, whose law and complementarity are computed again from its fields."""
    face = self_affine(shape, (2e-4, 2e-4), hurst=0.8, rms_slope=0.2, roll_off=roll_off, rng=1)
    body = fs.HalfSpace(shape, face.spacing, modulus)
    contact = fs.solve_contact(face.gap(), body, pressure=load, hardness=law)
    p, u = contact.pressure, contact.plastic_deformation
    off = np.where(u > 0, np.abs(p - law.yield_pressure(u)), 0.0)
    assert off.max() < 1e-3 * p.max()
    assert np.linalg.norm(off) < 2e-6 * np.linalg.norm(p)
    assert_allclose(p.mean(), load, rtol=1e-9)
    assert p[u == 0].max() <= law.yield_pressure() * (1 + 1e-6)
    g = body.displacement(p) + face.gap() - contact.approach
    assert_allclose((g + u)[p > 0], 0, atol=1e-5 * np.ptp(face.heights))
    return contact


@pytest.mark.parametrize("law", LAWS, ids=["table", "Nix–Gao", "softer"])
def test_a_peak_is_kept_and_reloading_is_elastic(law):
    gap, body, peak = yielding_face((32, 32)), fs.HalfSpace((32, 32), (D, D), E, "mirror"), 0.15 * H
    loads = {"loading": (peak,), "unload_from": (peak,), "unloading": (0.02 * H, 0.1 * H)}
    top, *down = load_cycle(gap, body, hardness=law, rtol=RTOL, **loads)
    left = top.contact.plastic_deformation
    assert left.max() > 0
    for state in down:
        assert_allclose(state.contact.plastic_deformation, left, rtol=0, atol=1e-6 * np.ptp(gap))
        assert state.yielded_again == 0
    kept = down[0].contact.plastic_deformation
    again = solved_contact(gap, law, peak, "mirror", deformation=kept)
    assert_allclose(again.pressure, top.contact.pressure, rtol=0, atol=1e-6 * H)
    assert_allclose(again.gap, top.contact.gap, rtol=0, atol=1e-6 * np.ptp(gap))


@pytest.mark.parametrize("smallest", [5e-8, 1e-8, 4e-9])
def test_a_law_that_falls_faster_than_the_pixels_are_stiff_is_solved(smallest):
    """Points that go through the steep part leave what they carried to others."""
    law = NixGao(1e9, 1e-6, smallest)
    contact = on_its_curve(law, 5e8, (48, 48), 115e9, 7e-5)
    assert -law.hardening_modulus(smallest) > 1.5 * contact.half_space.stiffness
    assert contact.plastic_deformation.max() > 10 * smallest


# --- two faces ---


def test_the_softer_face_yields_and_where_curves_cross_the_softer_at_each_depth():
    soft, hard = PerfectlyPlastic(0.3 * H), PerfectlyPlastic(H)
    assert softer_of(hard, soft) is soft
    assert softer_of(soft) is soft
    rising = LinearHardening(0.3 * H, STIFF)
    both = softer_of(hard, rising)
    depth = np.array([0.0, 0.5, 2.0]) * 0.7 * H / STIFF
    assert_allclose(both.yield_pressure(depth), [0.3 * H, 0.65 * H, H])
    assert_allclose(both.hardening_modulus(depth), [STIFF, STIFF, 0.0])
    assert both.capacity == H
    gap = yielding_face((32, 32))
    contact = solved_contact(gap, both, 0.15 * H)
    assert_allclose(contact.pressure.max(), H)
    assert solved_contact(gap, rising, 0.15 * H).pressure.max() > 1.5 * H


@pytest.mark.parametrize(
    ("law", "given", "words"),
    [
        (HardnessTable, ([0.0], [H]), "hardness table: given 1 value of depth and 1 of hardness"),
        (HardnessTable, ([0.0, 1e-6], [H]), "2 values of depth and 1 of hardness"),
        (HardnessTable, ([0.0, 1e-6, 1e-6], [H] * 3), "depth: .* expected rising depths >= 0"),
        (HardnessTable, ([-1e-9, 1e-6], [H, H]), "expected rising depths >= 0"),
        (HardnessTable, ([0.0, 1e-6], [H, 0.0]), "hardness: given 0 Pa, expected numbers > 0"),
        (HardnessTable, ([0.0, np.nan], [H, H]), "depth: given 1 point not finite"),
        (HardnessTable, (["a", "b"], [H, H]), "depth: given"),
        (NixGao, (0.0, 1e-6), "hardness: given 0.0"),
        (NixGao, (H, -1e-6), "depth: given -1e-06"),
        (NixGao, (H, 1e-6, 0.0), "smallest_depth: given 0.0"),
    ],
)
def test_bad_curves_are_named(law, given, words):
    with pytest.raises(fs.InputError, match=words):
        law(*given)


def test_a_point_yields_at_the_substrate_once_the_coating_is_through():
    face = fs.self_affine((48, 48), (48e-6, 48e-6), hurst=0.8, rms_slope=0.2, rng=3, roll_off=2e-5)
    body = fs.Coated(
        fs.Solid(200e9, 0.3, hardness=600e6), fs.Solid(80e9, 0.37, hardness=150e6), 2e-7
    )
    half_space = fs.HalfSpace(face.shape, face.spacing, (body, None))
    law = fs.CoatedLaw.of(body)
    gap0 = face.heights.max() - face.heights
    contact = fs.solve_contact(gap0, half_space, pressure=8e7, hardness=law, rtol=1e-5)
    u, p = contact.plastic_deformation, contact.pressure
    # a residual of 1e-5 of the pressures, whose slope in the passage is steep
    assert_allclose(p[u > 0], law.yield_pressure(u[u > 0]), rtol=1e-2)
    through = u > 1.1 * body.thickness
    assert through.any()
    assert_allclose(p[through], 600e6, rtol=1e-4)


class Counted(fs.CoatedLaw):
    """A law that counts the points at which it is evaluated."""

    def __init__(self, *given):
        super().__init__(*given)
        object.__setattr__(self, "points", [])

    def yield_pressure(self, deformation=0.0):
        self.points.append(np.size(deformation))
        return super().yield_pressure(deformation)


@pytest.mark.parametrize(("thickness", "most"), [(20e-6, 0.02), (5e-7, 20.0)])
def test_a_coating_costs_no_evaluation_at_points_that_stay_in_it(thickness, most):
    face = fs.self_affine((64, 64), (64e-6, 64e-6), hurst=0.8, rms_slope=0.1, rng=3, roll_off=2e-5)
    body = fs.Coated(*(fs.named_solid(n) for n in ("Inconel 718, aged", "silver, annealed")), 2e-5)
    half_space = fs.HalfSpace(face.shape, face.spacing, (body, None))
    gap0 = face.heights.max() - face.heights
    plain, steel = (contact_law(solid.hardness) for solid in (body.layer, body.substrate))
    law = Counted(plain, steel, thickness)
    assert law.pieces.has_constant_end
    law.points.clear()
    contact = fs.solve_contact(gap0, half_space, pressure=1.4e8, hardness=law)
    assert contact.plastic_fraction > 0.4
    assert sum(law.points) < most * gap0.size
    if contact.plastic_deformation.max() < thickness:
        metal = fs.solve_contact(gap0, half_space, pressure=1.4e8, hardness=plain)
        np.testing.assert_array_equal(contact.pressure, metal.pressure)
        assert contact.fft_pairs == metal.fft_pairs
    else:
        u, p = contact.plastic_deformation, contact.pressure
        assert (u > thickness).any()
        assert_allclose(p[u > 0], law.yield_pressure(u[u > 0]), rtol=1e-3)


def test_unloading_from_a_coating_is_that_of_its_metal_until_it_is_through():
    face = fs.self_affine((48, 48), (48e-6, 48e-6), hurst=0.8, rms_slope=0.2, rng=3, roll_off=2e-5)
    solids = fs.Solid(200e9, 0.3, hardness=600e6), fs.Solid(80e9, 0.37, hardness=150e6)
    gap0 = face.heights.max() - face.heights
    for thickness in (1e-5, 3e-7):
        body = fs.Coated(*solids, thickness)
        half_space = fs.HalfSpace(face.shape, face.spacing, (body, None))
        law = fs.CoatedLaw.of(body)

        def solve(pressure, **given):
            return fs.solve_contact(gap0, half_space, pressure=pressure, **given)  # noqa: B023

        peak = solve(8e7, hardness=law)
        yielded = peak.plastic_deformation
        # at the load of the peak the state of the peak returns, whether or not the coating is through
        again = solve(8e7, hardness=law, deformation=yielded)
        assert_allclose(again.gap, peak.gap, rtol=0, atol=1e-6 * np.ptp(gap0))
        if yielded.max() < thickness:
            half, metal = (solve(4e7, hardness=h, deformation=yielded) for h in (law, 150e6))
            assert_allclose(half.gap, metal.gap, rtol=0, atol=1e-9 * np.ptp(gap0))


@pytest.mark.parametrize("thickness", [2e-7, 2e-6, 2e-5])
@pytest.mark.parametrize("pressure", [150e6, 200e6, 590e6])
def test_a_pressure_above_the_hardness_of_the_coating_presses_all_of_it_aside(thickness, pressure):
    solids = fs.Solid(200e9, 0.3, hardness=600e6), fs.Solid(80e9, 0.37, hardness=150e6)
    body = fs.Coated(*solids, thickness)
    law = fs.CoatedLaw.of(body)
    # a flat surface yields evenly to the depth at which H(u) is the pressure
    half_space = fs.HalfSpace((8, 8), (1e-6, 1e-6), (body, None))
    flat = fs.solve_contact(np.zeros((8, 8)), half_space, pressure=pressure, hardness=law)
    if pressure > 150e6:
        assert_allclose(law.yield_pressure(flat.plastic_deformation), pressure, rtol=1e-5)
    face = fs.self_affine((48, 48), (48e-6, 48e-6), hurst=0.8, rms_slope=0.1, rng=3, roll_off=2e-5)
    half_space = fs.HalfSpace(face.shape, face.spacing, (body, None))
    gap0 = face.heights.max() - face.heights
    contact = fs.solve_contact(gap0, half_space, pressure=pressure, hardness=law)
    u, p = contact.plastic_deformation, contact.pressure
    assert_allclose(p.mean(), pressure, rtol=1e-9)
    assert u.max() > thickness
    assert_allclose(p[u > 0], law.yield_pressure(u[u > 0]), rtol=1e-4)
    gap = gap0 + half_space.displacement(p)
    offset = np.ptp(gap + u - contact.gap)
    assert offset < 1e-5 * np.ptp(gap0)


def test_the_slope_of_the_law_is_its_derivative():
    law = fs.CoatedLaw(fs.LinearHardening(150e6, 1e12), fs.NixGao(6e8, 1e-6), 20e-6)
    u = np.linspace(1e-6, 30e-6, 40) + 1e-9
    step = 1e-11
    expected = (law.yield_pressure(u + step) - law.yield_pressure(u - step)) / (2 * step)
    assert_allclose(law.hardening_modulus(u), expected, rtol=1e-3, atol=1e9)
