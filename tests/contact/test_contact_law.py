"""Contact laws: hardening against closed forms and a dense reference, load cycles, limits, laws from outside."""

import itertools
from dataclasses import dataclass, replace

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from small_cases import HARDENED as CASE
from small_cases import scene_of_law

import femseal as fs
from femseal.case.case import parse_case
from femseal.contact import (
    ContactLaw,
    HalfSpace,
    LinearHardening,
    PerfectlyPlastic,
    load_cycle,
    solve_contact,
)
from femseal.contact.descent import Descent
from femseal.contact.workspace import nested_grids
from femseal.topography import self_affine

E, H, D = 115e9, 4e9, 1e-6
#: E* over the pixel [Pa/m].
STIFF = E / D
PAIRS = list(itertools.product(("periodic", "mirror", "free"), repeat=2))
RTOL = 1e-9


def rough(shape, slope=0.25, seed=0):
    rng = np.random.default_rng(seed)
    q = np.hypot(np.fft.fftfreq(shape[0])[:, None], np.fft.fftfreq(shape[1])[None, :])
    amplitude = np.where((q > 0) & (q <= 1 / 6), np.maximum(q, 0.08) ** -1.8, 0.0)
    h = np.fft.ifft2(np.fft.fft2(rng.standard_normal(shape)) * amplitude).real
    return h * slope * D / np.sqrt(sum((np.diff(h, axis=a) ** 2).mean() for a in (0, 1)))


def solved(gap, law, pressure, boundary="periodic", **given):
    half_space = HalfSpace(gap.shape, (D, D), E, boundary)
    return solve_contact(
        gap, half_space, **{"pressure": pressure, "hardness": law, "rtol": RTOL} | given
    )


def minimum(k, gap, mean, hardness, slope):
    """Pressures that minimise ½pKp + hp + Σ (p − H)₊²/2h on a dense K, mean p given: sets of points, solved exactly.

    Checked against the conditions of the minimum, which is the only one.
    """
    n = gap.size
    touching, yields = gap < np.median(gap), np.zeros(n, bool)
    for _ in range(300):
        f = np.flatnonzero(touching)
        soft = np.where(yields, 1 / slope, 0.0)[f]
        matrix = np.block(
            [[k[np.ix_(f, f)] + np.diag(soft), -np.ones((f.size, 1))], [np.ones((1, f.size)), 0]]
        )
        scale = np.r_[np.full(f.size, STIFF), 1.0]
        right = np.r_[soft * hardness[f] - gap[f], mean * n]
        x = np.linalg.solve(matrix * scale[:, None], right * scale)
        p = np.zeros(n)
        p[f], delta = x[:-1], x[-1]
        g = k @ p + gap - delta
        # one point at a time is slow but never cycles for long; all at once is a semismooth Newton method
        new = np.where(touching, p > 0, g < 0)
        new_yields = new & (np.where(touching, p, 0) > hardness)
        if np.array_equal(new, touching) and np.array_equal(new_yields, yields):
            u = np.where(yields, (p - hardness) / slope, 0.0)
            assert_allclose(p.mean(), mean, rtol=1e-9)
            assert_allclose((g + u)[touching], 0, atol=1e-9 * np.ptp(gap))
            assert np.all(p >= 0)
            assert np.all(g[~touching] >= 0)
            return p, u
        touching, yields = new, new_yields
    raise AssertionError("the reference did not settle")


@pytest.mark.parametrize("boundary", PAIRS)
@pytest.mark.parametrize("slope", [0.03, 0.5, 20.0])
def test_equals_an_independent_minimum_on_a_dense_matrix(boundary, slope, dense_operator):
    shape = (12, 10)
    gap, half_space = rough(shape, 0.3, seed=5), HalfSpace((12, 10), (D, D), E, boundary)
    hardness = 0.3 * H * np.random.default_rng(6).uniform(0.5, 1.5, shape)
    slopes = slope * STIFF * np.random.default_rng(7).uniform(0.5, 1.5, shape)
    for mean in (0.05 * H, 0.5 * H):
        p, u = minimum(
            dense_operator(half_space), gap.ravel(), mean, hardness.ravel(), slopes.ravel()
        )
        contact = solve_contact(
            gap, half_space, pressure=mean, hardness=LinearHardening(hardness, slopes), rtol=1e-11
        )
        assert_allclose(contact.pressure.ravel(), p, rtol=0, atol=1e-7 * p.max())
        assert_allclose(contact.plastic_deformation.ravel(), u, rtol=0, atol=1e-7 * u.max())
        assert 0 < contact.plastic_fraction < 1 or mean > 0.3 * H


@pytest.mark.parametrize("boundary", ["periodic", "mirror"])
@pytest.mark.parametrize("slope", [1e-6, 1.0, 1e6])
def test_beyond_the_hardness_a_flat_face_yields_evenly(boundary, slope):
    """u = (p̄ − H)/h, closed form."""
    contact = solved(np.zeros((8, 6)), LinearHardening(H, slope * STIFF), 1.5 * H, boundary)
    assert_allclose(contact.pressure, 1.5 * H, rtol=1e-12)
    assert_allclose(contact.plastic_deformation, 0.5 * H / (slope * STIFF), rtol=1e-12)
    assert contact.plastic_fraction == 1


def test_a_wave_in_full_contact_yields_in_closed_form():
    """All points touch and yield: (2/E*q + 1/h) p₁ = a for the wave a cos(qx), p = p̄ + p₁ cos."""
    n, slope = 64, 0.4 * STIFF
    q = 2 * np.pi / (n * D)
    wave = np.cos(q * (np.arange(n) + 0.5) * D)[:, None] * np.ones(8)
    first = 0.5 * H
    height = first * (2 / (E * q) + 1 / slope)
    contact = solved(-height * wave, LinearHardening(H, slope), 2 * H)
    assert_allclose(contact.pressure, 2 * H + first * wave, rtol=1e-8)
    assert_allclose(contact.plastic_deformation, (H + first * wave) / slope, rtol=1e-7)
    assert_allclose(contact.gap, 0, atol=1e-12 * height)


@pytest.mark.parametrize("boundary", PAIRS)
def test_no_slope_is_perfectly_plastic_and_an_endless_one_elastic(boundary):
    gap = rough((24, 20))
    plain, flat = (solved(gap, law, 0.2 * H, boundary) for law in (H, LinearHardening(H, 0.0)))
    for name in ("pressure", "gap", "plastic_deformation"):
        assert_array_equal(getattr(flat, name), getattr(plain, name))
    assert (flat.approach, flat.fft_pairs) == (plain.approach, plain.fft_pairs)
    soft = solved(gap, LinearHardening(H, 1e-7 * STIFF), 0.2 * H, boundary)
    assert_allclose(soft.gap, plain.gap, rtol=0, atol=1e-5 * np.ptp(gap))
    elastic, stiff = (
        solved(gap, law, 0.2 * H, boundary) for law in (np.inf, LinearHardening(H, 1e9 * STIFF))
    )
    assert_allclose(stiff.pressure, elastic.pressure, rtol=0, atol=1e-7 * elastic.pressure.max())


@pytest.mark.parametrize("boundary", ["periodic", "mirror"])
@pytest.mark.parametrize("hardness", [H, np.where(rough((24, 20), seed=3) > 1.5e-7, np.inf, H)])
@pytest.mark.parametrize("load", [2.0, 8.0])
def test_a_face_that_hardens_is_pressed_past_its_mean_by_load_and_by_approach(
    boundary, hardness, load
):
    """What yields lets the body follow; of faces that do not, the load has no bound at the mean."""
    gap, law = rough((24, 20)), LinearHardening(hardness, 0.1 * STIFF)
    loaded = solved(gap, law, load * H, boundary)
    assert loaded.approach > gap.mean()
    moved = solved(gap, law, None, boundary, approach=loaded.approach)
    assert_allclose(moved.pressure, loaded.pressure, rtol=0, atol=1e-7 * loaded.pressure.max())
    with pytest.raises(fs.InputError, match=r"approach: given .* less than the mean of gap0"):
        solved(gap, np.inf, None, boundary, approach=loaded.approach)


@pytest.mark.parametrize("boundary", PAIRS)
@pytest.mark.parametrize("slope", [1e-6, 1e-3, 1.0, 1e3, 1e6])
@pytest.mark.parametrize("load", [0.02, 0.7, 3.0])
def test_every_slope_converges_to_a_solution(boundary, slope, load):
    """Residual, load and law recomputed from the fields alone."""
    gap, line = rough((32, 40), seed=1), slope * STIFF
    contact = solved(gap, LinearHardening(H, line), load * H, boundary, rtol=1e-8)
    p, u = contact.pressure, contact.plastic_deformation
    assert_allclose(p.mean(), load * H, rtol=1e-10)
    c = contact.half_space.stiffness
    trial = p - c * (contact.half_space.displacement(p) + gap - contact.approach)
    y = np.where(trial < H, np.maximum(trial, 0), H + line / (line + c) * (trial - H))
    assert np.linalg.norm(p - y) <= 1.1e-8 * np.linalg.norm(p)
    assert_allclose(np.maximum(p - H, 0), line * u, rtol=0, atol=1e-7 * p.max())
    assert np.all(u[p < H] == 0)
    assert np.all(contact.gap[p > 0] == 0)


def test_a_harder_slope_yields_less_and_carries_more_pressure():
    gap = rough((48, 40))
    found = [
        solved(gap, LinearHardening(H, s * STIFF), 0.3 * H) for s in (0, 0.01, 0.1, 1, 10, 100)
    ]
    for name, sign in (("plastic_deformation", -1), ("pressure", 1)):
        highest = [getattr(c, name).max() for c in found]
        assert np.all(sign * np.diff(highest) > 0)
    assert np.all(np.diff([c.area_fraction for c in found]) < 0)


def test_steps_that_never_raise_the_energy_reach_the_same_solution():
    gap = rough((24, 20)) - rough((24, 20)).min()
    law = LinearHardening(0.5 * H, 0.3 * STIFF)
    reference = solved(gap, law, 0.2 * H)
    grid = nested_grids(HalfSpace(gap.shape, (D, D), E), 0, 1)[0]
    grid.start(np.full(gap.shape, 0.2 * H), np.array([np.inf]))
    descent = Descent(grid, gap.ravel(), law.tangent(gap.shape), 0.2 * H * gap.size, 0.0)
    descent.solve(RTOL, 2000)
    assert descent.residual <= RTOL
    assert_allclose(grid.pressure, reference.pressure, rtol=0, atol=1e-6 * H)


# --- load cycles ---


LAW = LinearHardening(0.5 * H, 0.05 * STIFF)
PEAK = 0.3 * H


@pytest.fixture(scope="module")
def gap():
    return rough((48, 40))


@pytest.fixture(scope="module")
def cycle(gap):
    half_space = HalfSpace(gap.shape, (D, D), E, ("mirror", "periodic"))
    loads = {
        "loading": (0.1 * H, 0.6 * H),
        "unload_from": (PEAK,),
        "unloading": (0.02 * H, 0.1 * H, 0.2 * H),
    }
    states = load_cycle(gap, half_space, hardness=LAW, rtol=RTOL, **loads)
    return {(s.pressure, s.unloaded_from): s.contact for s in states}


class TestCycle:
    def alone(self, gap, pressure, deformation=None):
        return solved(gap, LAW, pressure, ("mirror", "periodic"), deformation=deformation)

    def equal(self, one, two, gap):
        assert_allclose(one.pressure, two.pressure, rtol=0, atol=1e-6 * H)
        for name in ("gap", "plastic_deformation"):
            assert_allclose(getattr(one, name), getattr(two, name), rtol=0, atol=1e-6 * np.ptp(gap))

    def test_at_the_peak_it_is_as_before(self, gap, cycle):
        peak = cycle[PEAK, None]
        assert peak.plastic_fraction > 0.05
        assert peak.pressure.max() > 1.1 * LAW.hardness
        self.equal(self.alone(gap, PEAK, peak.plastic_deformation), peak, gap)

    def test_reloading_follows_the_unloading_curve(self, gap, cycle):
        down = cycle[0.02 * H, PEAK]
        for p in (0.1 * H, 0.2 * H):
            self.equal(self.alone(gap, p, down.plastic_deformation), cycle[p, PEAK], gap)

    def test_nothing_yields_on_the_way_down(self, gap, cycle):
        left = cycle[PEAK, None].plastic_deformation
        for (_, peak), contact in cycle.items():
            if peak:
                assert_allclose(contact.plastic_deformation, left, rtol=0, atol=1e-6 * np.ptp(gap))

    def test_beyond_the_peak_the_first_loading_goes_on(self, gap, cycle):
        left = cycle[PEAK, None].plastic_deformation
        self.equal(self.alone(gap, 0.6 * H, left), cycle[0.6 * H, None], gap)

    def test_hardness_that_is_not_kept_would_yield_again(self, gap, cycle):
        """Without what it has gained, the peak is not reached elastically: the invariants above can fail."""
        left = cycle[PEAK, None].plastic_deformation
        lost = solved(gap + left, LAW, PEAK, ("mirror", "periodic"))
        assert lost.plastic_deformation.max() > 0.1 * left.max()


# --- what a law answers ---


def test_projection_tangent_capacity_and_what_is_kept():
    law = LinearHardening(H, 3.0 * STIFF)
    trial = np.array([-1.0, 0.5, 1.0, 5.0]) * H
    assert_allclose(law.project(trial, STIFF), [0, 0.5 * H, H, H + 0.75 * 4 * H])
    assert_allclose(
        law.deformation(np.array([H, 2 * H]), np.array([0.0, -H / (3 * STIFF)]), STIFF),
        [0, H / 3 / STIFF],
    )
    assert law.capacity == np.inf
    assert PerfectlyPlastic(H * np.array([[0.5, 1.5]])).capacity == H
    left = np.array([[0.0, 1e-6]])
    after = law.after(left)
    assert_allclose(after.yield_pressure(), H + law.slope * left)
    assert_allclose(after.after(left).yield_pressure(), H + 2 * law.slope * left)
    assert_allclose(after.less(0.1 * H).times(2).yield_pressure(), 2 * (0.9 * H + law.slope * left))
    assert PerfectlyPlastic(H).after(left) == PerfectlyPlastic(H)
    assert (law.is_perfect, law.is_elastic, law.is_uniform, after.is_uniform) == (
        False,
        False,
        True,
        False,
    )
    assert (
        str(LinearHardening(H, 2e15))
        == "elastic-plastic with hardness 4 GPa and hardening 2 GPa/µm"
    )


def test_laws_are_equal_by_their_parameters_and_have_keys_of_their_own():
    field = H * np.ones((2, 2))
    assert PerfectlyPlastic(field) == PerfectlyPlastic(field.copy())
    laws = [
        PerfectlyPlastic(H),
        PerfectlyPlastic(2 * H),
        PerfectlyPlastic(field),
        LinearHardening(H, 0.0),
    ]
    laws += [LinearHardening(H, 1e15), LinearHardening(H, 1e15).times(2), PerfectlyPlastic(np.inf)]
    assert len({law.key() for law in laws}) == len(set(laws)) == len(laws)


def test_fluid_pressure_on_a_periodic_face_takes_its_part_of_the_load():
    """Constant p_f: t = p + p_f lies as the dry face under p̄ − p_f, whose points yield p_f earlier."""
    gap, p_f = rough((32, 32)), 0.05 * H
    for law in (
        PerfectlyPlastic(np.inf),
        PerfectlyPlastic(0.4 * H),
        LinearHardening(0.4 * H, 0.1 * STIFF),
    ):
        dry = solved(gap, replace(law, hardness=law.hardness - p_f), 0.2 * H - p_f)
        wet = solved(gap, law.less(p_f), 0.2 * H - p_f)
        assert_array_equal(wet.gap, dry.gap)


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: LinearHardening(0.0, 1.0), r"hardness: given 0 Pa, expected numbers > 0 \[Pa\]"),
        (
            lambda: LinearHardening(H, -1.0),
            r"slope: given -1 Pa/m, expected finite numbers >= 0 \[Pa/m\]",
        ),
        (lambda: LinearHardening(H, np.inf), "slope: given inf"),
        (
            lambda: LinearHardening("4 GPa", 1.0),
            "hardness: given '4 GPa', expected a number or an array",
        ),
        (lambda: PerfectlyPlastic(np.nan), "hardness: given nan"),
        (
            lambda: solved(np.zeros((4, 4)), LinearHardening(H * np.ones((3, 3)), 1.0), H),
            r"hardness: given shape \(3, 3\)",
        ),
        (
            lambda: solved(np.zeros((4, 4)), LinearHardening(H, np.ones((2, 2))), H),
            r"hardness: given shape \(2, 2\)",
        ),
    ],
)
def test_bad_laws_are_named(make, words):
    with pytest.raises(fs.InputError, match=words):
        make()


# --- laws from outside the package ---


@dataclass(frozen=True, eq=False)
class Bilinear(ContactLaw):
    """Two straight lines: slope `first` up to the depth `bend`, `second` beyond."""

    hardness: float
    first: float
    second: float
    bend: float

    def yield_pressure(self, deformation=0.0):
        u = np.asarray(deformation, dtype=float)
        return (
            self.hardness
            + self.first * np.minimum(u, self.bend)
            + self.second * np.maximum(u - self.bend, 0.0)
        )

    def hardening_modulus(self, deformation=0.0):
        return np.where(np.asarray(deformation) < self.bend, self.first, self.second)


@dataclass(frozen=True, eq=False)
class SofterBelow(ContactLaw):
    """A hard skin: hardness falls with the depth, H₀ (1 + 1/(1 + u/d))/2."""

    hardness: float
    depth: float

    def yield_pressure(self, deformation=0.0):
        return self.hardness / 2 * (1 + 1 / (1 + np.asarray(deformation, dtype=float) / self.depth))

    def hardening_modulus(self, deformation=0.0):
        return (
            -self.hardness
            / 2
            / self.depth
            / (1 + np.asarray(deformation, dtype=float) / self.depth) ** 2
        )


OUTSIDE = [Bilinear(0.3 * H, 0.2 * STIFF, 0.02 * STIFF, 0.01 * D), SofterBelow(0.5 * H, 0.5 * D)]


@pytest.mark.parametrize("law", OUTSIDE, ids=lambda law: type(law).__name__)
@pytest.mark.parametrize("boundary", ["periodic", ("free", "mirror")])
def test_a_curved_law_is_solved_by_its_tangents(law, boundary):
    gap = rough((32, 32))
    contact = solved(gap, law, 0.15 * H, boundary, rtol=1e-7)
    p, u = contact.pressure, contact.plastic_deformation
    assert contact.plastic_fraction > 0.05
    assert u.max() > getattr(law, "bend", 0.0)
    assert_allclose(p[u > 0], law.yield_pressure(u)[u > 0], rtol=1e-5)
    assert np.all(p <= law.yield_pressure(u) * (1 + 1e-5))
    # complementarity: contact is closed but for what yields
    g = contact.half_space.displacement(p) + gap
    g -= np.average(g + u, weights=p)
    assert_allclose((g + u)[p > 0], 0, atol=1e-4 * np.ptp(gap))


def test_a_bent_law_is_the_straight_one_where_it_does_not_bend():
    gap = rough((32, 32))
    straight = solved(gap, LinearHardening(H, 0.2 * STIFF), 0.2 * H)
    for law in (
        Bilinear(H, 0.2 * STIFF, 0.2 * STIFF, 0.01 * D),
        Bilinear(H, 0.2 * STIFF, STIFF, D),
    ):
        assert_allclose(
            solved(gap, law, 0.2 * H).gap, straight.gap, rtol=0, atol=1e-12 * np.ptp(gap)
        )


@pytest.mark.parametrize("law", OUTSIDE, ids=lambda law: type(law).__name__)
def test_a_law_from_outside_runs_through_every_study(law):
    scene = scene_of_law(law, 6e8)
    whole = fs.deterministic(scene)
    assert np.all(whole.plastic_fraction[1] > 0.01)
    assert whole.mean_gap[1] < whole.mean_gap[2] < whole.mean_gap[0]
    assert whole.leakage[2] < whole.leakage[0]
    pieces = fs.two_scale(scene, (3, 4))
    assert not pieces.failures
    assert_allclose(pieces.pieces.mean_gap.mean(axis=(1, 2)), whole.mean_gap, rtol=1e-6)
    drawn = fs.stochastic(scene, (3, 4), fs.Sampling(length=2e-4, realisations=3, seed=1))
    assert not drawn.failures
    assert np.isfinite(drawn.leakage).all()


def test_hardness_of_every_place_is_for_whole_faces():
    surface = self_affine(
        (48, 64), (48e-6, 64e-6), hurst=0.8, rms_slope=0.25, roll_off=24e-6, cut_off=8e-6, rng=1
    )
    field = LinearHardening(np.where(np.arange(64) < 32, 1.0, 40.0) * np.full((48, 1), 1e9), 1e15)
    scene = fs.Scene(surface, E, field, fs.Liquid(1e-3), 1e6, 0.0, (3e8,), rtol=1e-4)
    found = fs.two_scale(scene, (3, 4)).pieces
    assert found.plastic_fraction[0, :, :2].mean() > 2 * found.plastic_fraction[0, :, 2:].mean()


# --- cases ---


def test_a_case_with_hardening():
    case = parse_case(CASE)
    assert case.law == LinearHardening(2e9, 2e15)
    results = fs.run(case)
    assert (
        results.dataset.attrs["contact_law"]
        == "elastic-plastic with hardness 2 GPa and hardening 2 GPa/µm"
    )
    plain = fs.run(parse_case(CASE | {"material": {"young": "210 GPa", "hardness": "2 GPa"}}))
    assert np.all(results.deterministic.mean_gap > plain.deterministic.mean_gap)


def test_the_law_of_a_case_is_that_of_the_softer_solid():
    hard, soft = (
        {"young": "210 GPa", "yield_stress": "2 GPa"},
        {"young": "120 GPa", "hardness": "600 MPa"},
    )
    for one, two in ((hard, soft), (soft, hard), ({"young": "210 GPa"}, soft)):
        assert parse_case(
            CASE | {"material": one, "counter_material": two}
        ).law == PerfectlyPlastic(6e8)
    assert parse_case(CASE | {"material": {"young": "210 GPa"}}).law.is_elastic


@pytest.mark.parametrize(
    ("material", "words"),
    [
        (
            {"hardness": "2 GPa", "hardening": "-2 GPa/um"},
            "material.hardening: given '-2 GPa/um', expected a stress per",
        ),
        ({"hardness": "2 GPa", "hardening": "2 GPa"}, "material.hardening: given '2 GPa'"),
        ({"hardening": "2 GPa/um"}, "hardening with a yield_stress or a hardness"),
    ],
)
def test_a_bad_hardening_is_refused(material, words):
    with pytest.raises(fs.InputError, match=words):
        parse_case(CASE | {"material": {"young": "210 GPa", **material}})


def test_a_load_beyond_the_hardness_is_for_a_law_that_hardens():
    load = {"load": {"loading": ["2.5 GPa"]}}
    assert parse_case(CASE | load).load.highest == 2.5e9
    with pytest.raises(fs.InputError, match="below the hardness"):
        parse_case(CASE | load | {"material": {"young": "210 GPa", "hardness": "2 GPa"}})


def test_a_perfectly_plastic_metal_that_is_harder_is_perfectly_plastic():
    """It keeps no deformation, so that any of the points can be projected."""
    harder = PerfectlyPlastic(H).times(1.03).after(np.ones((8, 8)))
    assert harder.is_uniform
    assert (harder.project(np.full(5, 2 * H), 1.0) == 1.03 * H).all()
