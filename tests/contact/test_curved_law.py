"""Contacts with curved laws: cubic pieces, agreement with the law, with the sequence of tangents, and their cost."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

import femseal as fs
from femseal.contact import (
    ContactLaw,
    HardnessTable,
    LinearHardening,
    NixGao,
    PerfectlyPlastic,
    curved_law,
)
from femseal.contact.softer_body import SofterOf
from femseal.topography import self_affine

H, D = 1e9, 1e-6
COATING = fs.CoatedLaw(PerfectlyPlastic(0.2 * H), PerfectlyPlastic(1.2 * H), 0.5e-6)
HARD_COATING = fs.CoatedLaw(PerfectlyPlastic(2 * H), PerfectlyPlastic(H), 1e-6)
RISING = HardnessTable([1e-8, 3e-7, 6e-7], [0.5 * H, H, 1.5 * H])
SOFTENING = NixGao(H, 5e-7, 2e-7)
CROSSING = SofterOf(LinearHardening(0.3 * H, 1e15), PerfectlyPlastic(0.8 * H))
LAWS = {
    "coating": COATING,
    "hard coating": HARD_COATING,
    "rising": RISING,
    "softening": SOFTENING,
    "crossing": CROSSING,
    "coating of curves": fs.CoatedLaw(NixGao(0.2 * H, 2e-7, 2e-7), RISING, 3e-7),
}


def surface(n=96, seed=4):
    face = self_affine((n, n), (n * D, n * D), hurst=0.8, rms_slope=0.2, roll_off=3e-5, rng=seed)
    return face.gap(), fs.HalfSpace(face.shape, face.spacing, 1e11)


@pytest.mark.parametrize("name", LAWS)
def test_cubic_pieces_are_the_curve(name):
    law = LAWS[name]
    u = np.r_[0.0, np.geomspace(1e-12, 1e-4, 4001)]
    pieces = law.pieces
    assert_allclose(pieces.hardness(u), law.yield_pressure(u), rtol=1e-10)
    falls = -law.hardening_modulus(np.linspace(0, 2e-6, 100_001)).min()
    assert_allclose(pieces.steepest_fall, max(falls, 0), rtol=0.01, atol=1e-3 * 1e11 / D)
    assert pieces.has_constant_end == isinstance(law, (HardnessTable, SofterOf, fs.CoatedLaw))


def test_the_end_of_a_coating_is_one_piece_and_its_passage_few():
    assert COATING.pieces.depth.size < 40
    assert_allclose(COATING.pieces.depth[-1], 1.1 * COATING.thickness)


def assert_follows(contact, law, gap, earlier=0.0, fluid=0.0, rtol=2e-6):
    """Recompute law and complementarity from the fields."""
    p, u = contact.pressure, contact.plastic_deformation
    grown = u > earlier + 1e-13
    limit = law.yield_pressure(u) - fluid
    off = np.where(grown, p - limit, np.maximum(p - limit, 0))
    assert np.linalg.norm(off) < rtol * np.linalg.norm(p)
    body = contact.half_space
    g = body.displacement(p + fluid) + gap - contact.approach
    open_gap = np.where(p > 0, 0, contact.gap)
    assert_allclose(g + u, open_gap, rtol=0, atol=1e-5 * np.ptp(gap))
    return grown


@pytest.mark.parametrize("name", LAWS)
def test_loading_unloading_and_fluid_follow_the_law(name, monkeypatch):
    """Without the sequence of tangents, which would hide a failure."""
    monkeypatch.setattr(curved_law, "solve_by_tangents", None)
    law = LAWS[name]
    gap, body = surface()
    top = fs.solve_contact(gap, body, pressure=0.3 * H, hardness=law)
    assert assert_follows(top, law, gap).mean() > 0.1
    assert top.plastic_deformation.max() > 3 * law.bends[1:].min(initial=2e-7)
    left = top.plastic_deformation
    down = fs.solve_contact(gap, body, pressure=0.05 * H, hardness=law, deformation=left)
    assert_follows(down, law, gap, earlier=left)
    again = fs.solve_contact(gap, body, pressure=0.4 * H, hardness=law, deformation=left)
    assert_follows(again, law, gap, earlier=left)
    whole = fs.solve_contact(gap, body, pressure=0.4 * H, hardness=law)
    assert_allclose(again.mean_gap, whole.mean_gap, rtol=1e-4)
    p_f = 0.02 * H * (1 + np.sin(np.linspace(0, 6, gap.size)).reshape(gap.shape))
    wet = fs.solve_contact(gap, body, pressure=0.3 * H, hardness=law, fluid_pressure=p_f)
    assert_follows(wet, law, gap, fluid=p_f)
    assert_allclose((wet.pressure + p_f).mean(), 0.3 * H, rtol=1e-9)


@pytest.mark.parametrize("name", ["coating", "rising", "crossing", "hard coating"])
def test_the_sequence_of_tangents_finds_the_same_contact(name, monkeypatch):
    """Newton's method outside of the active sets, with the law in numpy, instead of inside with compiled pieces."""
    law = LAWS[name]
    gap, body = surface()
    given = {"pressure": 0.25 * H, "hardness": law, "rtol": 1e-9}
    contact = fs.solve_contact(gap, body, **given)
    monkeypatch.setattr(curved_law, "_STEEPEST_FALL", -1.0)
    other = fs.solve_contact(gap, body, **given)
    difference = np.linalg.norm(contact.pressure - other.pressure)
    assert difference < 1e-8 * np.linalg.norm(other.pressure)
    depth = other.plastic_deformation
    assert_allclose(contact.plastic_deformation, depth, rtol=0, atol=1e-7 * depth.max())
    assert_allclose(contact.gap, other.gap, rtol=0, atol=1e-8 * np.ptp(gap))


@pytest.mark.parametrize("name", LAWS)
def test_a_curved_law_takes_about_as_many_products_as_a_constant_hardness(name):
    law = LAWS[name]
    gap, body = surface(256)
    plain = fs.solve_contact(gap, body, pressure=0.2 * H, hardness=H)
    curved = fs.solve_contact(gap, body, pressure=0.2 * H, hardness=law)
    assert curved.fft_pairs <= 2.5 * plain.fft_pairs


@pytest.mark.parametrize("boundary", ["mirror", ("free", "periodic"), "free"])
def test_boundaries_and_loads_up_to_the_hardness_of_the_substrate(boundary, monkeypatch):
    gap, _ = surface(64)
    body = fs.HalfSpace(gap.shape, (D, D), 1e11, boundary)
    monkeypatch.setattr(curved_law, "solve_by_tangents", None)
    for load in (0.02, 0.19, 0.21, 0.9, 1.15):
        contact = fs.solve_contact(gap, body, pressure=load * H, hardness=COATING)
        assert_follows(contact, COATING, gap)
        assert_allclose(contact.mean_pressure, load * H, rtol=1e-9)


def test_threads_do_not_change_a_curved_contact():
    gap, body = surface(736)
    given = {"pressure": 0.2 * H, "hardness": COATING}
    one, two = (fs.solve_contact(gap, body, threads=n, **given) for n in (1, 2))
    assert np.array_equal(one.pressure, two.pressure)
    assert np.array_equal(one.plastic_deformation, two.plastic_deformation)


def test_a_contact_that_no_point_yields_through_is_that_of_the_coating_alone():
    gap, body = surface()
    thick = fs.CoatedLaw(PerfectlyPlastic(0.2 * H), PerfectlyPlastic(H), 1e-4)
    contact = fs.solve_contact(gap, body, pressure=0.05 * H, hardness=thick)
    plain = fs.solve_contact(gap, body, pressure=0.05 * H, hardness=0.2 * H)
    assert contact.fft_pairs == plain.fft_pairs
    assert_allclose(contact.pressure, plain.pressure, rtol=0, atol=1e-5 * 0.2 * H)


class Vanishing(ContactLaw):
    """A hardness that decays to nothing with the depth."""

    def yield_pressure(self, u=0.0):
        return H * np.exp(-np.asarray(u) / 10e-6)

    def hardening_modulus(self, u=0.0):
        return -self.yield_pressure(u) / 10e-6


class Rounded(Vanishing):
    """A hardness with the noise of single precision, which no cubic describes to eleven digits."""

    def yield_pressure(self, u=0.0):
        return np.float64(np.float32(super().yield_pressure(u)))


def test_a_hardness_that_decays_to_nothing_has_few_pieces():
    law = Vanishing()
    u = np.geomspace(1e-9, 1e-4, 100)
    assert law.pieces.depth.size < 2000
    assert_allclose(law.pieces.hardness(u), law.yield_pressure(u), rtol=1e-9)


def test_a_hardness_with_noise_is_solved_by_its_tangents():
    law = Rounded()
    assert law.pieces is None
    gap, body = surface(48)
    contact = fs.solve_contact(gap, body, pressure=0.1 * H, hardness=law, rtol=1e-6)
    assert_follows(contact, law, gap)
