"""Hardness that is a curve of the depth: tables, Nix–Gao, the softer of two faces; closed forms and a dense reference."""

import numpy as np
import pytest
from each import each
from numpy.testing import assert_allclose, assert_array_equal
from scipy.optimize import brentq, minimize, root
from small_cases import scene_of_law
from test_contact_law import RTOL, STIFF, D, E, H, rough, solved

import femseal as fs
from femseal.contact import (
    HardnessTable,
    LinearHardening,
    NixGao,
    PerfectlyPlastic,
    load_cycle,
    softer_of,
)
from femseal.contact.hardness_curves import SofterOf
from femseal.topography import self_affine

RISING = HardnessTable([0.0, 0.02 * D, 0.1 * D, 0.3 * D], [0.25 * H, 0.33 * H, 0.5 * H, 0.6 * H])
SOFT = NixGao(0.25 * H, 0.5 * D, 0.1 * D)
LAWS = [RISING, SOFT, SofterOf(LinearHardening(0.2 * H, 0.02 * STIFF), PerfectlyPlastic(0.4 * H))]


@each("law", [RISING, HardnessTable([1e-8, 1e-7], [0.5 * H, H])])
def test_a_flat_face_yields_as_the_table_says(law):
    """Where every point carries the same pressure, H(u) is it: u by the inverse of the curve."""
    for fraction in (0.3, 0.95):
        mean = law.hardness[0] + fraction * (law.hardness[-1] - law.hardness[0])
        depth = brentq(
            lambda u, mean=mean: float(law.yield_pressure(u)) - mean,
            law.depth[0],
            law.depth[-1],
            xtol=1e-18,
        )
        contact = solved(np.zeros((8, 6)), law, mean)
        assert_allclose(contact.pressure, mean, rtol=1e-8)
        assert_allclose(contact.plastic_deformation, depth, rtol=1e-6)


@pytest.mark.parametrize("boundary", ["periodic", ("free", "mirror")])
def test_a_table_of_a_straight_line_is_linear_hardening(boundary):
    gap, slope = rough((32, 32)), 0.1 * STIFF
    line = solved(gap, LinearHardening(0.25 * H, slope), 0.15 * H, boundary)
    depths = np.array([0.0, 0.1, 0.3, 1.0]) * 2 * line.plastic_deformation.max()
    table = solved(gap, HardnessTable(depths, 0.25 * H + slope * depths), 0.15 * H, boundary)
    assert_allclose(table.pressure, line.pressure, rtol=0, atol=1e-7 * line.pressure.max())
    assert_allclose(
        table.plastic_deformation, line.plastic_deformation, rtol=0, atol=1e-7 * np.ptp(gap)
    )
    assert line.plastic_fraction > 0.05


def test_beyond_its_ends_a_table_is_constant():
    law = HardnessTable([1e-8, 2e-8], [H, 2 * H])
    assert_array_equal(law.yield_pressure(np.array([0.0, 1e-8, 2e-8, 1.0])), [H, H, 2 * H, 2 * H])
    assert_array_equal(law.hardening_modulus(np.array([0.0, 5e-9, 2e-8, 1.0])), 0.0)
    assert law.capacity == 2 * H
    with pytest.raises(fs.InputError, match="at most the mean hardness"):
        solved(np.zeros((4, 4)), law, 2.1 * H)


def by_root(k, gap, mean, law, start):
    """p, u of a law that rises, on a dense K: p = y(p − c g) and mean p by scipy's `root`, y by `brentq` at each point."""

    def projected(trial):
        if trial <= law.yield_pressure(0.0):
            return max(trial, 0.0), 0.0
        depth = brentq(
            lambda u: float(law.yield_pressure(u)) + STIFF * u - trial,
            0.0,
            trial / STIFF,
            xtol=1e-20,
        )
        return float(law.yield_pressure(depth)), depth

    def both(x):
        p = x[:-1] * H
        return p, np.array([projected(z) for z in p - STIFF * (k @ p + gap - x[-1] * D)])

    def off(x):
        p, y = both(x)
        return np.r_[(p - y[:, 0]) / H, p.mean() / mean - 1]

    found = root(off, np.r_[start.pressure.ravel() / H, start.approach / D], tol=1e-13)
    assert np.abs(found.fun).max() < 1e-9, found.message
    p, y = both(found.x)
    return p, y[:, 1]


def by_minimiser(k, gap, mean, law):
    """p, u of a law that softens: the energy under 0 ≤ p ≤ H_i, mean p given, by scipy's SLSQP, H_i by the law at u."""
    n = gap.size
    matrix, heights, p, most = (
        k * H / D,
        gap / D,
        np.full(n, mean / H),
        np.full(n, law.mean_hardness / H),
    )
    load = {"type": "eq", "fun": lambda p: p.mean() - mean / H, "jac": lambda p: np.full(n, 1 / n)}
    for _ in range(200):
        given = {
            "bounds": [(0, h) for h in most],
            "constraints": load,
            "options": {"ftol": 1e-15, "maxiter": 500},
        }
        energy = lambda p: (0.5 * p @ matrix @ p + heights @ p, matrix @ p + heights)  # noqa: E731
        p = minimize(energy, p, jac=True, method="SLSQP", **given).x
        v, elastic = matrix @ p + heights, (p > 1e-9) & (p < most - 1e-9)
        u = np.where(p >= most - 1e-9, np.maximum(v[elastic].mean() - v, 0), 0.0) * D
        former, most = most, law.yield_pressure(u) / H
        if np.abs(most - former).max() < 1e-9:
            assert np.ptp(v[elastic]) < 1e-5
            return p * H, u
    raise AssertionError("the reference did not settle")


@pytest.mark.parametrize("law", LAWS, ids=["table", "Nix–Gao", "softer"])
def test_curves_equal_an_independent_solution_by_scipy(law, dense_operator):
    shape = (8, 6)
    half_space = fs.HalfSpace(shape, (D, D), E, ("mirror", "periodic"))
    gap = rough(shape, 0.4, seed=5)
    for mean in (0.05 * H, 0.15 * H):
        start = solved(gap, float(law.mean_hardness), mean, ("mirror", "periodic"))
        given = dense_operator(half_space), gap.ravel(), mean, law
        p, u = by_minimiser(*given) if law is SOFT else by_root(*given, start)
        contact = solved(gap, law, mean, ("mirror", "periodic"))
        assert_allclose(contact.pressure.ravel(), p, rtol=0, atol=1e-6 * p.max())
        assert_allclose(contact.plastic_deformation.ravel(), u, rtol=0, atol=1e-6 * u.max())
        assert u.max() > 0


@pytest.mark.parametrize("width", [1e-8, 1e-10, 1e-12])
def test_a_step_in_the_table_is_solved_however_steep(width):
    """Law and complementarity recomputed from the fields."""
    law = HardnessTable([0, 1e-8, 1e-8 + width, 1e-6], [0.25 * H, 0.25 * H, H, H])
    gap = rough((32, 32))
    contact = solved(gap, law, 0.1 * H, rtol=1e-7)
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


@each(
    ("depth", "hardness", "load"),
    [
        ([0, 0.27, 0.88, 1.36], [4.7, 7.0, 2.3, 4.3], 3e8),
        ([0, 0.066, 2.323], [4.95, 2.34, 6.37], 1e8),
    ],  # µm, GPa, Pa
)
def test_a_table_that_falls_between_rises_is_solved(depth, hardness, load):
    """Points turn back and forth between two tangents unless they go half way; the law again from the fields."""
    face = self_affine((32, 32), (2e-4, 2e-4), hurst=0.8, rms_slope=0.2, roll_off=60e-6, rng=1)
    body = fs.HalfSpace(face.shape, face.spacing, 210e9 / 2 / (1 - 0.3**2))
    law = HardnessTable(1e-6 * np.array(depth), 1e9 * np.array(hardness))
    contact = fs.solve_contact(face.gap(), body, pressure=load, hardness=law)
    p, u = contact.pressure, contact.plastic_deformation
    yields = u > 0
    assert u.max() > 1e-6 * depth[1]  # beyond the first turn of the table
    assert_allclose(p[yields], law.yield_pressure(u[yields]), rtol=1e-5)
    assert_allclose(p.mean(), load, rtol=1e-9)
    assert_array_equal(contact.gap[p > 0], 0)
    assert p[~yields].max() <= law.yield_pressure() * (1 + 1e-6)


@pytest.mark.parametrize("law", LAWS, ids=["table", "Nix–Gao", "softer"])
def test_a_peak_is_kept_and_reloading_is_elastic(law):
    gap, body = rough((32, 32)), fs.HalfSpace((32, 32), (D, D), E, "mirror")
    peak = 0.15 * H
    loads = {"loading": (0.02 * H,), "unload_from": (peak,), "unloading": (0.1 * H, 0.02 * H)}
    states = load_cycle(gap, body, hardness=law, rtol=RTOL, **loads)
    found = {(s.pressure, s.unloaded_from): s for s in states}
    top, down = found[peak, None].contact, found[0.02 * H, peak].contact
    left = top.plastic_deformation
    assert left.max() > 0
    for state in states[-2:]:
        assert_allclose(state.contact.plastic_deformation, left, rtol=0, atol=1e-6 * np.ptp(gap))
        assert state.yielded_again == 0
    again = solved(gap, law, peak, "mirror", deformation=down.plastic_deformation)
    assert_allclose(again.pressure, top.pressure, rtol=0, atol=1e-6 * H)
    assert_allclose(again.gap, top.gap, rtol=0, atol=1e-6 * np.ptp(gap))


@each("smallest", [5e-8, 1e-8, 4e-9])
def test_a_law_that_falls_faster_than_the_pixels_are_stiff_is_solved(smallest):
    """Points that go through the steep part leave what they carried to others; the law again from the fields."""
    face = self_affine(
        (48, 48), (2e-4, 2e-4), hurst=0.8, rms_slope=0.2, roll_off=7e-5, cut_off=2e-5, rng=1
    )
    body = fs.HalfSpace(face.shape, face.spacing, 115e9)
    law = NixGao(1e9, 1e-6, smallest)
    assert -law.hardening_modulus(smallest) > 1.5 * body.stiffness
    contact = fs.solve_contact(face.gap(), body, pressure=5e8, hardness=law)
    p, u = contact.pressure, contact.plastic_deformation
    yields = u > 0
    assert u.max() > 10 * smallest
    assert_allclose(p[yields], law.yield_pressure(u[yields]), rtol=1e-3)
    assert np.linalg.norm((p - law.yield_pressure(u))[yields]) < 2e-6 * np.linalg.norm(p)
    assert_allclose(p.mean(), 5e8, rtol=1e-9)
    assert p[~yields].max() <= law.yield_pressure() * (1 + 1e-6)
    g = body.displacement(p) + face.gap() - contact.approach
    assert_allclose((g + u)[p > 0], 0, atol=1e-5 * np.ptp(face.heights))
    left = law.deformation(p, contact.raw_gap, body.stiffness)
    assert_allclose(left, u, rtol=0, atol=1e-6 * u.max())


@pytest.mark.parametrize("law", [RISING, SOFT], ids=["table", "Nix–Gao"])
def test_curves_run_through_every_study(law):
    scene = scene_of_law(law, 5e8)
    whole = fs.deterministic(scene)
    assert whole.plastic_fraction[1] > 0.01
    assert whole.mean_gap[1] < whole.mean_gap[2] < whole.mean_gap[0]
    pieces = fs.two_scale(scene, (3, 4))
    assert not pieces.failures
    assert_allclose(pieces.pieces.mean_gap.mean(axis=(1, 2)), whole.mean_gap, rtol=1e-6)
    assert_allclose(
        np.einsum("sij->s", pieces.pieces.plastic_fraction) / 12, whole.plastic_fraction, rtol=1e-6
    )
    for breadth in (None, 96e-6):  # at the loads of the scene, and along a ladder
        drawn = fs.stochastic(
            scene, (3, 4), fs.Sampling(length=2e-4, realisations=3, seed=1, breadth=breadth)
        )
        assert not drawn.failures
        assert np.isfinite(drawn.leakage).all()


def test_a_curve_is_told_from_others_by_its_key():
    laws = [
        *LAWS,
        NixGao(0.25 * H, 0.4 * D),
        HardnessTable(RISING.depth, 1.01 * RISING.hardness),
        RISING.times(2),
    ]
    assert len({law.key() for law in laws}) == len(laws)
    assert HardnessTable(list(RISING.depth), list(RISING.hardness)).key() == RISING.key()


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
    gap = rough((32, 32))
    contact = solved(gap, both, 0.15 * H)
    assert_allclose(contact.pressure.max(), H)
    assert solved(gap, rising, 0.15 * H).pressure.max() > 1.5 * H


@each(
    ("make", "words"),
    [
        (
            lambda: HardnessTable([0.0], [H]),
            "hardness table: given 1 value of depth and 1 of hardness, expected as many of both",
        ),
        (lambda: HardnessTable([0.0, 1e-6], [H]), "2 values of depth and 1 of hardness"),
        (
            lambda: HardnessTable([0.0, 1e-6, 1e-6], [H, H, H]),
            "depth: given 0 m, 1 µm, 1 µm, expected depths >= 0 that",
        ),
        (lambda: HardnessTable([-1e-9, 1e-6], [H, H]), "expected depths >= 0 that rise"),
        (
            lambda: HardnessTable([0.0, 1e-6], [H, 0.0]),
            "hardness: given 0 Pa, expected numbers > 0",
        ),
        (lambda: HardnessTable([0.0, np.nan], [H, H]), "depth: given 1 point not finite"),
        (lambda: HardnessTable(["a", "b"], [H, H]), "depth: given"),
        (lambda: NixGao(0.0, 1e-6), "hardness: given 0.0"),
        (lambda: NixGao(H, -1e-6), "depth: given -1e-06"),
        (lambda: NixGao(H, 1e-6, 0.0), "smallest_depth: given 0.0"),
    ],
)
def test_bad_curves_are_named(make, words):
    with pytest.raises(fs.InputError, match=words):
        make()
