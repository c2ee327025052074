"""Contact laws: hardening against closed forms, load cycles, limits, laws from outside."""

import itertools
from dataclasses import dataclass

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from plastic_contacts import (
    NIX_GAO,
    RTOL,
    STIFF,
    TABLE,
    D,
    E,
    H,
    solved_contact,
    yielding_face,
)
from small_cases import HARDENED as CASE
from small_cases import scene_of_law

import femseal as fs
from femseal.case import parse_case
from femseal.contact import (
    ContactLaw,
    HalfSpace,
    LinearHardening,
    PerfectlyPlastic,
    load_cycle,
)

PAIRS = list(itertools.product(("periodic", "mirror", "free"), repeat=2))
STIFFEST = LinearHardening(H, 1e9 * STIFF)


@pytest.mark.parametrize("boundary", ["periodic", "mirror"])
@pytest.mark.parametrize("slope", [1e-6, 1.0, 1e6])
def test_beyond_the_hardness_a_flat_face_yields_evenly(boundary, slope):
    """u = (p̄ − H)/h, closed form."""
    contact = solved_contact(np.zeros((8, 6)), LinearHardening(H, slope * STIFF), 1.5 * H, boundary)
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
    contact = solved_contact(-height * wave, LinearHardening(H, slope), 2 * H)
    assert_allclose(contact.pressure, 2 * H + first * wave, rtol=1e-8)
    assert_allclose(contact.plastic_deformation, (H + first * wave) / slope, rtol=1e-7)
    assert_allclose(contact.gap, 0, atol=1e-12 * height)


@pytest.mark.parametrize("boundary", PAIRS)
def test_no_slope_is_perfectly_plastic_and_an_endless_one_elastic(boundary):
    gap = yielding_face((24, 20))
    plain, flat, soft, elastic, stiff = (
        solved_contact(gap, law, 0.2 * H, boundary)
        for law in (H, *(LinearHardening(H, s * STIFF) for s in (0, 1e-7)), np.inf, STIFFEST)
    )
    for name in ("pressure", "gap", "plastic_deformation"):
        assert_array_equal(getattr(flat, name), getattr(plain, name))
    assert_allclose(soft.gap, plain.gap, rtol=0, atol=1e-5 * np.ptp(gap))
    assert_allclose(stiff.pressure, elastic.pressure, rtol=0, atol=1e-7 * elastic.pressure.max())


@pytest.mark.parametrize("boundary", ["periodic", "mirror"])
@pytest.mark.parametrize(
    "hardness", [H, np.where(yielding_face((24, 20), seed=3) > 1.5e-7, np.inf, H)]
)
@pytest.mark.parametrize("load", [2.0, 8.0])
def test_a_face_that_hardens_is_pressed_past_its_mean(boundary, hardness, load):
    """What yields lets the body follow; of faces that do not, the load has no bound at the mean."""
    gap, law = yielding_face((24, 20)), LinearHardening(hardness, 0.1 * STIFF)
    loaded = solved_contact(gap, law, load * H, boundary)
    assert loaded.approach > gap.mean()
    assert_allclose(loaded.mean_pressure, load * H, rtol=1e-12)


@pytest.mark.parametrize("boundary", PAIRS)
@pytest.mark.parametrize("slope", [1e-6, 1.0, 1e6])
@pytest.mark.parametrize("load", [0.02, 3.0])
def test_every_slope_converges_to_a_solution(boundary, slope, load):
    """Residual, load and law of a hardness of each point recomputed from the fields alone."""
    gap, line = yielding_face((32, 40), seed=1), slope * STIFF
    hardness = H * np.random.default_rng(6).uniform(0.5, 1.5, gap.shape)
    contact = solved_contact(gap, LinearHardening(hardness, line), load * H, boundary, rtol=1e-8)
    p, u = contact.pressure, contact.plastic_deformation
    assert_allclose(p.mean(), load * H, rtol=1e-10)
    c = contact.half_space.stiffness
    trial = p - c * (contact.half_space.displacement(p) + gap - contact.approach)
    beyond = np.maximum(trial - hardness, 0)
    y = np.maximum(trial, 0) - beyond * c / (line + c)
    assert np.linalg.norm(p - y) <= 1.1e-8 * np.linalg.norm(p)
    assert_allclose(np.maximum(p - hardness, 0), line * u, rtol=0, atol=1e-7 * p.max())
    assert not contact.gap[p > 0].any()


# --- load cycles ---


LAW = LinearHardening(0.5 * H, 0.05 * STIFF)
PEAK = 0.3 * H


@pytest.fixture(scope="module")
def gap():
    return yielding_face((48, 40))


@pytest.fixture(scope="module")
def cycle(gap):
    body = HalfSpace(gap.shape, (D, D), E, ("mirror", "periodic"))
    unloading = (0.02 * H, 0.1 * H, 0.2 * H)
    states = load_cycle(
        gap,
        body,
        hardness=LAW,
        rtol=RTOL,
        loading=(0.1 * H, 0.6 * H),
        unload_from=(PEAK,),
        unloading=unloading,
    )
    return {(s.pressure, s.unloaded_from): s.contact for s in states}


def test_a_cycle_of_a_face_that_hardens(gap, cycle):
    """Reloaded it follows the unloading curve up to the peak, and goes on as at first loading beyond it."""
    peak, down = cycle[PEAK, None], cycle[0.02 * H, PEAK]
    assert peak.plastic_fraction > 0.05
    assert peak.pressure.max() > 1.1 * LAW.hardness
    for start, pressure, expected in (
        (peak, PEAK, peak),
        (down, 0.1 * H, cycle[0.1 * H, PEAK]),
        (down, 0.2 * H, cycle[0.2 * H, PEAK]),
        (peak, 0.6 * H, cycle[0.6 * H, None]),
    ):
        left = start.plastic_deformation
        found = solved_contact(gap, LAW, pressure, ("mirror", "periodic"), deformation=left)
        assert_allclose(found.pressure, expected.pressure, rtol=0, atol=1e-6 * H)
        for name in ("gap", "plastic_deformation"):
            one, two = getattr(found, name), getattr(expected, name)
            assert_allclose(one, two, rtol=0, atol=1e-6 * np.ptp(gap))


# --- what a law answers ---


def test_projection_capacity_and_what_is_kept():
    law = LinearHardening(H, 3.0 * STIFF)
    trial = np.array([-1.0, 0.5, 1.0, 5.0]) * H
    pressure, deformation = law.admissible(trial, np.zeros(4), STIFF)
    assert_allclose(pressure, [0, 0.5 * H, H, H + 0.75 * 4 * H])
    assert_allclose(deformation, [0, 0, 0, H / STIFF], rtol=1e-12)
    assert_allclose(PerfectlyPlastic(H).admissible(trial, 0.0, STIFF)[0], np.clip(trial, 0, H))
    assert law.capacity == np.inf
    assert PerfectlyPlastic(H * np.array([[0.5, 1.5]])).capacity == H
    left = np.array([[0.0, 1e-6]])
    after = law.after(left)
    assert_allclose(after.yield_pressure(), H + law.slope * left)
    assert_allclose(after.after(left).yield_pressure(), H + 2 * law.slope * left)
    assert_allclose(after.less(0.1 * H).times(2).yield_pressure(), 2 * (0.9 * H + law.slope * left))
    harder = PerfectlyPlastic(H).times(1.03).after(np.ones((8, 8)))
    assert (harder.admissible(np.full(5, 2 * H), 0.0, 1.0)[0] == 1.03 * H).all()


def test_laws_are_equal_by_their_parameters():
    field = H * np.ones((2, 2))
    assert PerfectlyPlastic(field) == PerfectlyPlastic(field.copy())
    assert PerfectlyPlastic(field) != PerfectlyPlastic(2 * field)
    changed = LinearHardening(H, 1e15).after(field / 1e15).less(1e6)
    assert changed == LinearHardening(H, 1e15).after(field / 1e15).less(1e6)
    assert hash(changed) == hash(LinearHardening(H, 1e15).after(field / 1e15).less(1e6))
    assert changed != LinearHardening(H, 1e15).after(2 * field / 1e15).less(1e6)
    assert changed != LinearHardening(2 * H, 1e15).after(field / 1e15).less(1e6)
    assert PerfectlyPlastic(H) != H
    laws = [
        PerfectlyPlastic(H),
        PerfectlyPlastic(2 * H),
        PerfectlyPlastic(field),
        LinearHardening(H, 0.0),
    ]
    laws += [LinearHardening(H, 1e15), LinearHardening(H, 1e15).times(2), PerfectlyPlastic(np.inf)]
    assert len({*laws, *laws}) == len(laws)


def test_laws_whose_parameters_are_unknown_are_equal_only_to_themselves():
    class Undescribed(ContactLaw):
        """Its hardness is no field of a dataclass."""

        def __init__(self, hardness):
            self.hardness = hardness

    class Derived(LinearHardening):
        """Its offset is no field of the dataclass from which it is derived."""

        def __init__(self, offset):
            super().__init__(H, 1.0)
            object.__setattr__(self, "offset", offset)

    for kind in (Undescribed, Derived):
        law = kind(H)
        assert law == law
        assert len({law, law, kind(H), kind(2 * H)}) == 3


@pytest.mark.parametrize(
    ("law", "given", "words"),
    [
        (LinearHardening, (0.0, 1.0), r"hardness: given 0 Pa, expected numbers > 0 \[Pa\]"),
        (LinearHardening, (H, -1.0), r"slope: given -1 Pa/m, expected finite numbers >= 0"),
        (LinearHardening, (H, np.inf), "slope: given inf"),
        (LinearHardening, ("4 GPa", 1.0), "hardness: given '4 GPa', expected a number or an ar"),
        (PerfectlyPlastic, (np.nan,), "hardness: given nan"),
        (LinearHardening, (H * np.ones((3, 3)), 1.0), r"hardness: given shape \(3, 3\)"),
        (LinearHardening, (H, np.ones((2, 2))), r"hardness: given shape \(2, 2\)"),
    ],
)
def test_bad_laws_are_named(law, given, words):
    with pytest.raises(fs.InputError, match=words):
        solved_contact(np.zeros((4, 4)), law(*given), 1e8)


# --- laws from outside the package ---


@dataclass(frozen=True, eq=False)
class Bilinear(ContactLaw):
    """Two straight lines: slope `first` up to the depth `bend`, `second` beyond."""

    hardness: float
    first: float
    second: float
    bend: float

    def yield_pressure(self, deformation=0.0):
        beyond = np.maximum(np.asarray(deformation) - self.bend, 0.0)
        return self.hardness + self.first * (deformation - beyond) + self.second * beyond

    def hardening_modulus(self, deformation=0.0):
        return np.where(np.asarray(deformation) < self.bend, self.first, self.second)


@dataclass(frozen=True, eq=False)
class SofterBelow(ContactLaw):
    """A hard skin: hardness falls with the depth, H₀ (1 + 1/(1 + u/d))/2."""

    hardness: float
    depth: float

    def yield_pressure(self, deformation=0.0):
        return self.hardness / 2 * (1 + 1 / (1 + np.asarray(deformation) / self.depth))

    def hardening_modulus(self, deformation=0.0):
        return -self.hardness / 2 / self.depth / (1 + np.asarray(deformation) / self.depth) ** 2


OUTSIDE = [Bilinear(0.3 * H, 0.2 * STIFF, 0.02 * STIFF, 0.01 * D), SofterBelow(0.5 * H, 0.5 * D)]
STUDIED = [*OUTSIDE, TABLE, NIX_GAO]


@dataclass(frozen=True, eq=False)
class OfPoints(ContactLaw):
    """A law whose parameter is an array, which cannot be divided between points."""

    softer: ContactLaw
    factor: np.ndarray

    def yield_pressure(self, deformation=0.0):
        return self.factor * self.softer.yield_pressure(deformation)

    def hardening_modulus(self, deformation=0.0):
        return self.factor * self.softer.hardening_modulus(deformation)


@pytest.mark.parametrize("law", STUDIED, ids=lambda law: type(law).__name__)
def test_a_law_for_all_points_together_is_that_of_each_point(law):
    gap = yielding_face((24, 24))
    each_point = OfPoints(law, np.ones(gap.shape))
    assert each_point.of_points(gap > 0) is None
    for given in ({}, {"deformation": np.where(gap < gap.mean(), 0.05 * D, 0.0)}):
        contact = solved_contact(gap, law, 0.1 * H, **given)
        again = solved_contact(gap, each_point, 0.1 * H, **given)
        assert_allclose(again.pressure, contact.pressure, rtol=0, atol=1e-6 * H)
        assert_allclose(again.gap, contact.gap, rtol=0, atol=1e-7 * np.ptp(gap))


@pytest.mark.parametrize("law", OUTSIDE, ids=lambda law: type(law).__name__)
@pytest.mark.parametrize("boundary", ["periodic", ("free", "mirror")])
def test_a_curved_law_is_solved_by_its_tangents(law, boundary):
    gap = yielding_face((32, 32))
    contact = solved_contact(gap, law, 0.15 * H, boundary, rtol=1e-7)
    p, u = contact.pressure, contact.plastic_deformation
    assert contact.plastic_fraction > 0.05
    assert u.max() > getattr(law, "bend", 0.0)
    assert_allclose(p[u > 0], law.yield_pressure(u)[u > 0], rtol=1e-5)
    assert np.all(p <= law.yield_pressure(u) * (1 + 1e-5))
    # complementarity: contact is closed but for what yields
    g = contact.half_space.displacement(p) + gap
    g -= np.average(g + u, weights=p)
    assert_allclose((g + u)[p > 0], 0, atol=1e-4 * np.ptp(gap))


@pytest.mark.parametrize(
    "law",
    [pytest.param(law, marks=() if law is TABLE else pytest.mark.slow) for law in STUDIED],
    ids=lambda law: type(law).__name__,
)
def test_a_law_runs_through_every_study(law):
    scene = scene_of_law(law, 6e8)
    whole = fs.deterministic(scene)
    assert np.all(whole.plastic_fraction[1] > 0.01)
    assert whole.mean_gap[1] < whole.mean_gap[2] < whole.mean_gap[0]
    assert whole.leakage[2] < whole.leakage[0]
    cells = fs.two_scale(scene, (3, 4))
    assert_allclose(cells.cells.mean_gap.mean(axis=(1, 2)), whole.mean_gap, rtol=1e-6)
    found = cells.cells.plastic_fraction.mean(axis=(1, 2))
    assert_allclose(found, whole.plastic_fraction, rtol=1e-6)
    for breadth in (None, 96e-6):  # at the loads of the scene, and along a ladder
        sampling = fs.Sampling(length=2e-4, realisations=3, seed=1, breadth=breadth)
        drawn = fs.stochastic(scene, (3, 4), sampling)
        assert not drawn.failures
        assert np.isfinite(drawn.leakage).all()


# --- cases ---


def test_a_case_with_hardening():
    case = parse_case(CASE)
    assert case.law == LinearHardening(2e9, 2e15)
    beyond = parse_case(CASE | {"load": {"loading": ["2.5 GPa"]}})
    assert beyond.load.highest == 2.5e9 > beyond.law.mean_hardness
    plain = parse_case(CASE | {"material": {"young": "210 GPa", "hardness": "2 GPa"}})
    hardened, flat = (fs.run(c).deterministic.mean_gap for c in (case, plain))
    assert np.all(hardened > flat)
