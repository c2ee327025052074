"""Flow laws: closed forms and derivatives, a liquid that slips in every study, a law from outside, fixed points."""

from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np
import pytest
from numpy.testing import assert_allclose
from small_cases import scene_of_fluid

import femseal as fs
from femseal.analytic import parallel_plates
from femseal.base.fixed_point import fixed_point
from femseal.flow import SlipLength
from femseal.flow.law import CUBIC_LAW, FlowLaw, law_of
from femseal.flow.permeability_table import tabulated
from femseal.flow.pressure_drop import PressureDrop
from femseal.preparation.preparation import prepare
from femseal.runs.forecast import describe
from femseal.store.digest import digest as shared_digest
from femseal.studies.other_fluid import FluidState, drop_ratio

HELIUM = fs.IdealGas(viscosity=19.6e-6, molar_mass=4.0026e-3, temperature=293.15)
WATER = fs.Liquid(1e-3)
SLIP = 50e-9
SLIPPERY = fs.Liquid(1e-3, slip_length=SLIP)
SPACING = (1e-6, 1e-6)


@dataclass(frozen=True)
class Swelling(FlowLaw):
    """A law from outside: the pressure takes away from the flow, K = (h³/12)/(1 + p/P)."""

    depends_on_pressure: ClassVar[bool] = True
    pressure: float

    def factor(self, gap, pressure=0.0):
        return np.broadcast_arrays(1 / (1 + np.asarray(pressure) / self.pressure), gap)[0]


@dataclass(frozen=True)
class SwellingLiquid:
    """A fluid from outside, with that law; its density and viscosity are constant."""

    stiffness: float
    reference_density: ClassVar[float] = 1000.0

    @property
    def law(self):
        return Swelling(self.stiffness)

    def potential(self, pressure):
        return 1e6 * np.asarray(pressure, dtype=float)

    def pressure(self, potential):
        return 1e-6 * np.asarray(potential, dtype=float)


LAWS = [CUBIC_LAW, SlipLength(SLIP), HELIUM.law, Swelling(1e6)]


@pytest.mark.parametrize("law", LAWS, ids=lambda law: type(law).__name__)
def test_derivatives_and_inverse(law):
    gap, p = np.geomspace(1e-9, 1e-4, 40), 1.3e5
    near = 1e-6 * gap
    slope = np.log(law.permeability(gap + near, p) / law.permeability(gap - near, p)) / np.log(
        (1 + 1e-6) / (1 - 1e-6)
    )
    assert_allclose(law.exponent(gap, p), slope, rtol=1e-6)
    rise = (law.permeability(gap, p + 1.0) - law.permeability(gap, p - 1.0)) / 2.0
    assert_allclose(law.pressure_derivative(gap, p), rise, rtol=1e-5)
    assert_allclose([law.gap(k, p) for k in law.permeability(gap, p)], gap, rtol=1e-12)
    assert_allclose(
        parallel_plates(law.equivalent_gap(gap, p)), law.permeability(gap, p), rtol=1e-12
    )


@pytest.mark.parametrize("law", LAWS[:-1], ids=lambda law: type(law).__name__)
def test_a_law_without_a_length_is_homogeneous(law):
    """K(s h) = s³ K(h) holds of the laws that say so, and of others if their own length grows with the gap."""
    gap, p = np.geomspace(1e-9, 1e-4, 40), 1.3e5
    same = np.allclose(
        law.permeability(3 * gap, p), 27 * law.permeability(gap, p), rtol=1e-9, atol=0
    )
    assert same == law.homogeneous == (law == CUBIC_LAW)
    if not law.homogeneous:
        longer = replace(law, **{law.length: 3 * getattr(law, law.length)})
        assert_allclose(
            longer.permeability(3 * gap, p), 27 * law.permeability(gap, p), rtol=1e-9, atol=0
        )


def test_limits_of_the_slip_length():
    """Plug flow of narrow gaps, b h²/2; without slip the cubic law, to the last bit."""
    gap = np.geomspace(1e-13, 1e-11, 5)
    assert_allclose(SlipLength(1e-6).permeability(gap), 1e-6 * gap**2 / 2, rtol=1e-5)
    gap = np.abs(np.random.default_rng(0).standard_normal(1000)) * 1e-6
    assert (SlipLength(0.0).permeability(gap) == CUBIC_LAW.permeability(gap)).all()
    assert SlipLength(SLIP).permeability(0.0) == 0
    assert law_of(WATER) == law_of(replace(HELIUM, slip=False)) == law_of(object()) == CUBIC_LAW


def rough_gap(n=24):
    heights = fs.self_affine(
        (n, n), (n * 1e-6, n * 1e-6), hurst=0.8, rms_slope=0.2, cut_off=8e-6, rng=3
    ).heights
    gap = np.maximum(heights + 0.7 * heights.std(), 0.0)
    assert 0.1 < (gap == 0).mean() < 0.4
    return gap


def test_cells_of_a_liquid_that_slips():
    plates = fs.cell_permeability(np.full((8, 6), 2e-7), SPACING, law=SLIPPERY.law)
    assert_allclose(plates.value, (2e-7) ** 3 / 12 * (1 + 6 * SLIP / 2e-7), rtol=1e-10)
    gap = rough_gap()
    slip, cubic, none = (
        fs.cell_permeability(gap, SPACING, law=law, bounds=True)
        for law in (SLIPPERY.law, CUBIC_LAW, SlipLength(0.0))
    )
    assert none.value == cubic.value
    assert slip.value > 1.05 * cubic.value
    # pixels of constant gap: the factor of each, so that both bounds rise by less than that of the narrowest
    assert slip.lower > cubic.lower
    assert slip.upper > cubic.upper
    assert slip.lower <= slip.upper


def test_waves_across_and_along_a_liquid_that_slips():
    """The harmonic and the arithmetic mean of K(h), of order 2."""
    errors = []
    for n in (32, 64, 128):
        gap = 1e-6 * (1 + 0.6 * np.cos(2 * np.pi * (np.arange(n) + 0.5) / n))
        fine = 1e-6 * (1 + 0.6 * np.cos(2 * np.pi * (np.arange(4096) + 0.5) / 4096))
        k = SLIPPERY.law.permeability(fine)
        found = [
            fs.cell_permeability(
                np.repeat(gap[:, None], 4, axis=1), (1 / n, 0.3), axis=axis, law=SLIPPERY.law
            ).value
            for axis in (0, 1)
        ]
        errors.append(np.abs(np.array(found) / [1 / np.mean(1 / k), np.mean(k)] - 1))
    errors = np.array(errors)
    assert errors[-1].max() < 1e-6
    assert errors[-1, 0] < 0.1 * errors[0, 0]
    tensor = fs.permeability_tensor(
        np.repeat(gap[:, None], 4, axis=1), (1 / n, 0.3), law=SLIPPERY.law
    )
    assert_allclose(np.diag(tensor), found, rtol=5e-3)


@pytest.fixture(scope="module")
def scene():
    return scene_of_fluid(SLIPPERY, 0.0)


def test_all_studies_of_a_liquid_that_slips(scene):
    """Each study is as near to the deterministic one as it is without slip; a slip length of 0 changes no bit."""
    cubic = replace(scene, fluid=WATER)
    whole, plain = fs.deterministic(scene), fs.deterministic(cubic)
    assert (whole.leakage > 1.05 * plain.leakage).all()
    assert (
        fs.deterministic(replace(scene, fluid=fs.Liquid(1e-3, slip_length=0.0))).leakage
        == plain.leakage
    ).all()
    found, still = (fs.two_scale(s, (2, 4)) for s in (scene, cubic))
    assert (found.leakage == whole.leakage).all()
    assert (found.k1 > 1.05 * still.k1).all()


@pytest.mark.parametrize("breadth", [None, 96e-6])
def test_drawn_seals_of_a_liquid_that_slips(scene, breadth):
    """The same draws leak more, by about as much as the face: at the loads of the scene, and along a ladder."""
    sampling = fs.Sampling(length=0.5e-3, realisations=3, seed=1, breadth=breadth)
    cubic = replace(scene, fluid=WATER)
    found, still = (fs.stochastic(s, (2, 4), sampling) for s in (scene, cubic))
    whole, plain = (fs.deterministic(s).leakage for s in (scene, cubic))
    ratio = found.leakage / still.leakage
    assert (ratio > 1).all()
    assert_allclose(np.log(np.median(ratio, axis=0)) / np.log(whole / plain), 1, atol=0.6)


def strip_case(fluid, seal="", method="deterministic", more=""):
    return (
        f'title = "slip"\nmethod = "{method}"\nseed = 1\n[face]\nkind = "self-affine"\npoints = [64, 64]\n'
        'size = ["64 um", "64 um"]\nhurst = 0.8\nrms_slope = 0.1\n[material]\nyoung = "210 GPa"\nhardness = "3 GPa"\n'
        f'[load]\nloading = ["50 MPa"]\n[fluid]\nkind = "liquid"\nviscosity = "1 mPa*s"\ninlet_pressure = "1 MPa"\n{fluid}\n'
        f"{more}{seal}"
    )


@pytest.mark.parametrize(
    ("kind", "seal"),
    [
        ("strip", ""),
        ("ring", '[seal]\nkind = "annular"\ninner_radius = "1 mm"\nouter_radius = "1.1 mm"\n'),
        (
            "mesh",
            '[seal]\nkind = "mesh"\npath = "ring.vtu"\nunit = "mm"\ninlet = "1"\noutlet = "2"\n',
        ),
    ],
)
def test_a_slip_length_from_the_case_on_every_shape(tmp_path, kind, seal):
    draws = "[cells]\ncount = [4, 4]\n[stochastic]\nrealisations = 2\n"
    draws += 'length = "0.3 mm"\n' if kind == "strip" else ""
    if kind == "mesh":
        _write_ring(tmp_path / "ring.vtu")
    leakage = []
    for slip in ("", 'slip_length = "0 nm"', 'slip_length = "50 nm"'):
        path = tmp_path / "case.toml"
        path.write_text(strip_case(slip, seal, "stochastic", draws), encoding="utf-8")
        case = fs.load_case(path)
        prepared = prepare(case)
        assert ("times the viscous flow" in "\n".join(describe(case, prepared))) == ("50" in slip)
        leakage.append(fs.stochastic(prepared.scene, prepared.cells, prepared.sampling).leakage)
    assert (leakage[0] == leakage[1]).all()
    assert (leakage[2] > 1.02 * leakage[0]).all()


def _write_ring(path):
    import meshio

    n, radii = 40, np.linspace(1.0, 1.1, 3)
    angle = 2 * np.pi * np.arange(n) / n
    points = np.array([[r * np.cos(a), r * np.sin(a), 0.0] for r in radii for a in angle])
    node = np.arange(3 * n).reshape(3, n)
    beside = np.roll(node, -1, axis=1)
    quads = np.stack([node[:-1], node[1:], beside[1:], beside[:-1]], axis=-1).reshape(-1, 4)
    lines = [np.stack([node[row], beside[row]], axis=-1) for row in (0, 2)]
    cells = [("quad", quads), ("line", lines[0]), ("line", lines[1])]
    tags = [np.zeros(len(quads), int), np.ones(n, int), np.full(n, 2)]
    meshio.Mesh(points, cells, cell_data={"boundary": tags}).write(path)


@pytest.mark.parametrize(
    "bad", ['slip_length = "-1 nm"', 'slip_length = "1 s"', "slip_length = true"]
)
def test_bad_slip_lengths(tmp_path, bad):
    path = tmp_path / "case.toml"
    path.write_text(strip_case(bad), encoding="utf-8")
    with pytest.raises(fs.InputError, match="slip_length"):
        fs.load_case(path)


def test_a_law_from_outside_runs_through_cells_and_seals():
    """K = (h³/12)/(1 + p/P): the flow goes with P ln((1 + p_in/P)/(1 + p_out/P))."""
    fluid, ends = SwellingLiquid(4e5), {"inlet_pressure": 1e6, "outlet_pressure": 1e5}
    cell = fs.cell_permeability(np.full((6, 5), 1e-6), SPACING, law=fluid.law, pressure=3e5)
    assert_allclose(cell.value, 1e-18 / 12 / 1.75, rtol=1e-10)
    drop = PressureDrop(fluid, 1e6, 1e5)
    k = tabulated(drop.pressures, [float(fluid.law.permeability(1e-6, p)) for p in drop.pressures])
    found = fs.seal_leakage(fs.RectangularSeal((1e-3, 2e-3), (3, 4)), k, fluid, **ends)
    exact = 2 * 1e-18 / 12 * 1e6 * 4e5 * np.log((1 + 1e6 / 4e5) / (1 + 1e5 / 4e5))
    assert_allclose(found.mass_rate, exact, rtol=2e-3)
    # along the seal p falls so that ln(1 + p/P) is straight
    straight = np.log1p(ends["inlet_pressure"] / 4e5), np.log1p(ends["outlet_pressure"] / 4e5)
    expected = 4e5 * np.expm1(straight[0] + (straight[1] - straight[0]) * np.arange(4) / 3)
    assert_allclose(found.fluid_pressure[:, 0], expected, rtol=5e-3)


def test_a_law_from_outside_runs_through_the_studies(scene):
    """It is K at a pressure between those of the ends; a law that hardly depends on the pressure is the cubic one."""
    cubic, stiff, soft = (
        replace(scene, fluid=fluid) for fluid in (WATER, SwellingLiquid(1e13), SwellingLiquid(1e6))
    )
    whole = {
        name: fs.deterministic(s)
        for name, s in (("cubic", cubic), ("stiff", stiff), ("soft", soft))
    }
    assert_allclose(whole["stiff"].leakage, whole["cubic"].leakage, rtol=1e-5)
    # of a gap that does not change the flow goes with P ln(1 + p/P)/p, here ln 2
    assert_allclose(whole["soft"].leakage / whole["cubic"].leakage, np.log(2), rtol=1e-3)
    pieces = fs.two_scale(soft, (2, 4))
    assert_allclose(pieces.leakage, whole["soft"].leakage, rtol=1e-8)
    assert_allclose(pieces.pieces.drop_fraction.sum(axis=(1, 2)), 1, rtol=1e-9)


def test_flows_of_fluids_of_one_law_are_the_same(scene):
    """So that stages of a sweep over fluids or pressures are shared."""
    oil, faster = (
        fs.Liquid(0.1, density=870.0, slip_length=SLIP),
        replace(scene, inlet_pressure=2e6),
    )
    assert scene.flow == replace(scene, fluid=oil).flow == faster.flow
    assert (
        scene.flow
        != replace(scene, fluid=WATER).flow
        == replace(faster, fluid=replace(HELIUM, slip=False)).flow
    )
    gas = replace(scene, fluid=HELIUM, outlet_pressure=1e5)
    assert gas.flow != replace(gas, inlet_pressure=2e6).flow
    assert shared_digest(scene.flow) == shared_digest(faster.flow) != shared_digest(gas.flow)


def test_fluids_of_one_law_have_the_ratio_of_their_drops(scene):
    dry = replace(scene, fluid_pressure="ignored")
    service = replace(dry, fluid=fs.Liquid(2e-3, slip_length=SLIP))
    assert_allclose(drop_ratio(FluidState(SLIPPERY, 1e6, 0.0), service), 2)
    assert drop_ratio(FluidState(WATER, 1e6, 0.0), service) is None
    gas = FluidState(HELIUM, 2e6, 1e5).in_scene(dry)
    assert drop_ratio(FluidState(HELIUM, 1e6, 1e5), gas) is None
    # where either presses the faces apart, the faces lie otherwise
    assert (
        drop_ratio(FluidState(SLIPPERY, 1e6, 0.0), replace(service, fluid_pressure="acts")) is None
    )


def test_a_fixed_point_is_found_with_its_counts():
    """x = cos x, whose rate is x + 1."""
    found = fixed_point(np.cos, lambda y: (float(y[0]) + 1, y, "kept"), np.array([0.5]), rtol=1e-6)
    assert found.found == "kept"
    assert_allclose(found.coefficient, 0.7390851332151607, rtol=1e-5)
    assert 10 < found.solutions < 40
    assert found.error <= 1e-6
    closed = fixed_point(lambda x: x, lambda y: (0.0, y, None), 0.5, rtol=1e-6)
    assert (closed.solutions, closed.error) == (1, 0.0)


def test_a_fixed_point_that_overshoots_settles_half_way():
    """x = 2/x is √2, but lies as far above as below by turns; a part without a state has none."""
    found = fixed_point(
        lambda x: 2 / x, lambda y: (float(y[0]), y, None), np.array([1.2, np.nan]), rtol=1e-6
    )
    assert_allclose(found.coefficient[0], np.sqrt(2), rtol=1e-5)
    assert np.isnan(found.coefficient[1])


def test_a_fixed_point_that_does_not_settle():
    flows = iter(range(1, 1000))
    with pytest.raises(fs.NotConverged, match=r"40 solutions it still changes by .*try pressures"):
        fixed_point(lambda x: x, lambda y: (1.0 + next(flows) % 2, y, None), 0.5, rtol=1e-6)
