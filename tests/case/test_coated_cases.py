"""Coatings of a case, from the keys to leakage and warnings."""

import copy

import numpy as np
import pytest
from numpy.testing import assert_allclose

import femseal as fs
from femseal.base import InputError
from femseal.case import parse_case
from femseal.contact.law import contact_law
from femseal.preparation.preparation import prepare
from femseal.runs.case_description import solids_text
from femseal.runs.run_description import describe

CASE = {
    "title": "coated",
    "method": "deterministic",
    "seed": 1,
    "face": {
        "kind": "self-affine",
        "size": ["64 um", "64 um"],
        "points": [64, 64],
        "hurst": 0.8,
        "rms_slope": 0.1,
        "roll_off": "30 um",
    },
    "material": {"name": "steel 304/316, annealed"},
    "counter_material": {"name": "Inconel 718, aged"},
    "load": {"loading": ["20 MPa", "80 MPa"]},
    "fluid": {
        "kind": "liquid",
        "viscosity": "1 mPa s",
        "inlet_pressure": "1 bar",
        "outlet_pressure": "0 bar",
    },
}
SILVER = {"name": "silver, annealed", "thickness": "20 um"}


def case_of(material=None, counter=None, **others):
    data = copy.deepcopy(CASE) | others
    data["material"] |= {} if material is None else {"coating": material}
    data["counter_material"] |= {} if counter is None else {"coating": counter}
    return parse_case(data)


def test_a_coating_by_name_is_the_pair_of_bodies_and_its_law():
    case = case_of(SILVER)
    steel, silver = (fs.named_solid(n) for n in ("steel 304/316, annealed", "silver, annealed"))
    coated, inconel = case.modulus
    assert coated.thickness == 20e-6
    for body, solid in ((coated.substrate, steel), (coated.layer, silver)):
        assert (body.young, body.poisson, body.hardness) == (
            solid.young,
            solid.poisson,
            solid.hardness,
        )
    assert inconel.young == fs.named_solid("Inconel 718, aged").young
    hardness = case.law.yield_pressure(np.array([0.0, 19e-6, 30e-6, 1e-3]))
    # 25 HV and 160 HV, as contact pressures
    assert_allclose(hardness, 9.80665e6 / 0.9272 * np.array([25, 25, 160, 160]))
    assert "coating of 20 µm, silver" in solids_text(case)


def test_a_coating_by_its_properties_on_the_counter_face():
    coating = {"young": "80 GPa", "poisson": 0.35, "hardness": "150 MPa", "thickness": "5 um"}
    case = case_of(counter=coating)
    assert case.modulus[1].layer == fs.Solid(80e9, 0.35, hardness=150e6)
    assert case.softer == "counter_material"
    assert case.law.mean_hardness == 150e6


def test_without_a_coating_it_is_a_number():
    assert case_of().modulus == fs.contact_modulus(*case_of().solids)


@pytest.mark.parametrize(
    ("coating", "key", "expected"),
    [
        ({"name": "silver, annealed"}, "coating.thickness", ""),
        ({"name": "silverr", "thickness": "1 um"}, "coating.name", "silver, annealed"),
        ({"thickness": "1 um"}, "coating.young", ""),
        (SILVER | {"thickness": "0 um"}, "coating.thickness", "> 0"),
        (SILVER | {"thickness": "5 N"}, "coating.thickness", "m"),
        (SILVER | {"tickness": "5 um"}, "coating.tickness", "thickness"),
        ("silver, annealed", "coating", ""),
    ],
)
def test_wrong_coatings_name_their_key(coating, key, expected, tmp_path):
    from femseal.case.template import as_toml

    data = copy.deepcopy(CASE)
    data["material"]["coating"] = coating
    lines = [f"{name} = {as_toml(value)}" for name, value in data.items()]
    path = tmp_path / "case.toml"
    path.write_text("\n".join(lines), encoding="utf-8")
    with pytest.raises(InputError) as caught:
        fs.load_case(path)
    assert f"material.{key}" in str(caught.value)
    assert expected in str(caught.value)


def test_a_thick_coating_leaks_as_its_metal_and_a_thin_one_lies_between():
    def leakage(case):
        prepared = prepare(case)
        return fs.deterministic(prepared.scene).leakage

    bare = leakage(case_of())
    thick = leakage(case_of(SILVER | {"thickness": "10 mm"}))
    silver = case_of()
    data = copy.deepcopy(CASE)
    data["material"] = {"name": "silver, annealed"}
    silver = leakage(parse_case(data))
    assert_allclose(thick, silver, rtol=1e-3)
    plated = leakage(case_of(SILVER))
    assert np.all(plated < 0.8 * bare)


@pytest.mark.parametrize("method", ["two-scale", "stochastic"])
def test_every_study_takes_a_coating(method):
    data = copy.deepcopy(CASE) | {"method": method}
    data["cells"] = {"count": [2, 2]}
    if method == "stochastic":
        data["stochastic"] = {"length": "1 mm", "realisations": 3}
    data["material"]["coating"] = SILVER
    prepared = prepare(parse_case(data))
    result = prepared.solve(prepared.answer, map)
    assert np.all(np.asarray(result.leakage) > 0)


def test_warnings_of_a_coating_that_is_too_thin():
    thin = case_of(SILVER | {"thickness": "0.5 um"})
    scene = prepare(thin).scene
    assert any("may yield through" in line for line in describe(thin, prepare(thin)))
    texts = fs.deterministic(scene).warnings
    assert any("yields through" in text and "thicker coating" in text for text in texts)
    assert any("rms height" in text for text in texts)
    texts = fs.deterministic(prepare(case_of(SILVER)).scene).warnings
    assert not any("coating" in text for text in texts)
    assert prepare(case_of(SILVER)).estimate() is not None


def test_a_seat_with_a_form_takes_a_coating():
    data = copy.deepcopy(CASE)
    data["seat"] = {"kind": "crowned", "radius": "1 mm"}
    data["load"] = {"loading": ["20 MPa"]}
    data["material"]["coating"] = SILVER
    scene = prepare(parse_case(data)).scene
    assert fs.deterministic(scene).leakage[0] > 0


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
