"""Flow laws: closed forms and derivatives, a liquid that slips in every study, and a law from outside."""

from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np
import pytest
from numpy.testing import assert_allclose
from small_cases import CASE, scene_of_fluid

import femseal as fs
from femseal.analytic import parallel_plates
from femseal.base import NotConverged
from femseal.flow import FlowLaw, SlipLength
from femseal.flow.law import CUBIC_LAW, law_of
from femseal.flow.permeability_table import tabulate
from femseal.flow.pressure_drop import PressureDrop
from femseal.studies import FluidState, drop_ratio

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


def test_the_former_name_of_the_scale_parameter_is_accepted():
    with pytest.warns(DeprecationWarning, match="length is scale_parameter now"):

        class Former(SlipLength):
            length = "slip_length"

    with pytest.warns(DeprecationWarning, match="homogeneous = True"):

        class FormerCubic(Swelling):
            length = ""

    assert (Former.scale_parameter, Former.homogeneous) == ("slip_length", False)
    assert (FormerCubic.scale_parameter, FormerCubic.homogeneous) == ("", True)

    @dataclass(frozen=True)
    class WithLength(Swelling):
        length: float = 1.0  # a field of this name is no name of a parameter

    assert not WithLength.homogeneous
    assert not WithLength.scale_parameter


LAWS = [CUBIC_LAW, SlipLength(SLIP), HELIUM.law]


@pytest.mark.parametrize("law", [*LAWS, Swelling(1e6)], ids=lambda law: type(law).__name__)
def test_inverse(law):
    gap, p = np.geomspace(1e-9, 1e-4, 40), 1.3e5
    assert_allclose([law.gap(k, p) for k in law.permeability(gap, p)], gap, rtol=1e-12)
    assert_allclose(
        parallel_plates(law.equivalent_gap(gap, p)), law.permeability(gap, p), rtol=1e-12
    )


@dataclass(frozen=True)
class Opening(FlowLaw):
    """A law with a jump: below a gap of 1 µm, almost nothing flows."""

    def factor(self, gap, pressure=0.0):
        return np.where(np.asarray(gap) > 1e-6, 1.0, 1e-6)


def test_a_permeability_that_no_gap_has_is_an_error():
    with pytest.raises(NotConverged, match=r"no gap with the permeability 1e-20 m³ .* Opening\(\)"):
        Opening().gap(1e-20)
    for bad in (0.0, -1e-18, np.nan):
        with pytest.raises(fs.InputError, match=r"^permeability: given .*> 0 \[m³\]"):
            CUBIC_LAW.gap(bad)


def test_a_permeability_within_a_small_jump_has_the_gap_at_the_jump():
    """The formulas of a rarefied gas have jumps between them; no gap has a permeability within an upward jump."""
    law, p = HELIUM.law, 1.3e5
    gap = np.geomspace(1e-9, 1e-4, 1_000_001)
    increase = np.diff(np.log(law.permeability(gap, p)))
    jumps = np.flatnonzero(increase > 10 * np.median(increase))
    assert len(jumps) >= 2
    for i in jumps:
        within = np.sqrt(np.prod(law.permeability(gap[i : i + 2], p)))
        assert_allclose(law.gap(within, p), gap[i], rtol=5e-3)


@pytest.mark.parametrize("law", LAWS, ids=lambda law: type(law).__name__)
def test_a_law_without_a_length_is_homogeneous(law):
    """K(s h) = s³ K(h) holds of the laws that say so, and of others if their own length grows with the gap."""
    gap, p = np.geomspace(1e-9, 1e-4, 40), 1.3e5
    same = np.allclose(
        law.permeability(3 * gap, p), 27 * law.permeability(gap, p), rtol=1e-9, atol=0
    )
    assert same == law.homogeneous == (law == CUBIC_LAW)
    if not law.homogeneous:
        longer = replace(law, **{law.scale_parameter: 3 * getattr(law, law.scale_parameter)})
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


def test_cells_of_a_liquid_that_slips():
    plates = fs.cell_permeability(np.full((8, 6), 2e-7), SPACING, law=SLIPPERY.law)
    assert_allclose(plates.value, (2e-7) ** 3 / 12 * (1 + 6 * SLIP / 2e-7), rtol=1e-10)
    gap = np.maximum(np.random.default_rng(3).standard_normal((24, 24)) + 1.5, 0.0) * 1e-6
    slip, cubic, none = (
        fs.cell_permeability(gap, SPACING, law=law)
        for law in (SLIPPERY.law, CUBIC_LAW, SlipLength(0.0))
    )
    assert none.value == cubic.value
    assert slip.value > 1.05 * cubic.value


def test_waves_across_and_along_a_liquid_that_slips():
    """The harmonic and the arithmetic mean of K(h), of order 2."""

    def gap(n):
        return 1e-6 * (1 + 0.6 * np.cos(2 * np.pi * (np.arange(n) + 0.5) / n))

    k = SLIPPERY.law.permeability(gap(4096))
    exact = np.array([1 / np.mean(1 / k), np.mean(k)])
    errors = []
    for n in (32, 64, 128):
        wave, spacing = np.repeat(gap(n)[:, None], 4, axis=1), (1 / n, 0.3)
        found = [
            fs.cell_permeability(wave, spacing, axis=axis, law=SLIPPERY.law).value
            for axis in (0, 1)
        ]
        errors.append(np.abs(found / exact - 1))
    assert errors[-1].max() < 1e-6
    assert errors[-1][0] < 0.1 * errors[0][0]
    tensor = fs.permeability_tensor(wave, spacing, law=SLIPPERY.law)
    assert_allclose(np.diag(tensor), found, rtol=5e-3)


@pytest.fixture(scope="module")
def scene():
    return scene_of_fluid(SLIPPERY, 0.0)


def test_all_studies_of_a_liquid_that_slips(scene):
    """A slip length of 0 changes no bit; the same draws leak more, by about as much as the face."""
    cubic, zero = (replace(scene, fluid=f) for f in (WATER, fs.Liquid(1e-3, slip_length=0.0)))
    whole, plain, none = (fs.deterministic(s).leakage for s in (scene, cubic, zero))
    assert (whole > 1.05 * plain).all()
    assert (none == plain).all()
    found, still = (fs.two_scale(s, (2, 4)) for s in (scene, cubic))
    assert (found.leakage == whole).all()
    assert (found.k1 > 1.05 * still.k1).all()
    sampling = fs.Sampling(length=0.5e-3, realisations=3, seed=1)
    found, still = (fs.stochastic(s, (2, 4), sampling).leakage for s in (scene, cubic))
    ratio = found / still
    assert (ratio > 1).all()
    assert_allclose(np.log(np.median(ratio, axis=0)) / np.log(whole / plain), 1, atol=0.6)


@pytest.mark.parametrize(
    ("given", "slip"),
    [("", 0), ('"50 nm"', SLIP), ('"-1 nm"', None), ('"1 s"', None), ("true", None)],
)
def test_a_slip_length_from_the_case(tmp_path, given, slip):
    path = tmp_path / "case.toml"
    more = f"slip_length = {given}\n" if given else ""
    path.write_text(CASE.replace("[contact]", more + "[contact]"))
    if slip is None:
        with pytest.raises(fs.InputError, match="slip_length"):
            fs.load_case(path)
    else:
        assert fs.load_case(path).fluid.slip_length == slip


def test_a_law_from_outside_runs_through_cells_and_seals():
    """K = (h³/12)/(1 + p/P): the flow goes with P ln((1 + p_in/P)/(1 + p_out/P))."""
    fluid, ends = SwellingLiquid(4e5), {"inlet_pressure": 1e6, "outlet_pressure": 1e5}
    cell = fs.cell_permeability(np.full((6, 5), 1e-6), SPACING, law=fluid.law, pressure=3e5)
    assert_allclose(cell.value, 1e-18 / 12 / 1.75, rtol=1e-10)
    drop = PressureDrop(fluid, 1e6, 1e5)
    k = tabulate(drop.pressures, [float(fluid.law.permeability(1e-6, p)) for p in drop.pressures])
    found = fs.seal_leakage(fs.RectangularSeal((1e-3, 2e-3), (3, 4)), k, fluid, **ends)
    exact = 2 * 1e-18 / 12 * 1e6 * 4e5 * np.log((1 + 1e6 / 4e5) / (1 + 1e5 / 4e5))
    assert_allclose(found.mass_rate, exact, rtol=2e-3)
    # along the seal p falls so that ln(1 + p/P) is straight
    straight = np.log1p(ends["inlet_pressure"] / 4e5), np.log1p(ends["outlet_pressure"] / 4e5)
    expected = 4e5 * np.expm1(straight[0] + (straight[1] - straight[0]) * np.arange(4) / 3)
    assert_allclose(found.fluid_pressure[:, 0], expected, rtol=5e-3)


def test_the_factor_of_a_law_is_not_used_where_the_gap_is_closed():
    """A law may divide by the gap: numpy's warnings, which are errors here, do not reach the user."""

    @dataclass(frozen=True)
    class Slip(FlowLaw):
        def factor(self, gap, pressure=0.0):
            return 1 + 6 * SLIP / gap

    gap = np.full((8, 8), 1e-6)
    gap[2:4, 2:4] = 0
    own = fs.cell_permeability(gap, SPACING, law=Slip()).value
    assert_allclose(own, fs.cell_permeability(gap, SPACING, law=SlipLength(SLIP)).value, rtol=1e-12)


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
    cells = fs.two_scale(soft, (2, 4))
    assert_allclose(cells.leakage, whole["soft"].leakage, rtol=1e-8)
    assert_allclose(cells.cells.drop_fraction.sum(axis=(1, 2)), 1, rtol=1e-9)


def test_fluids_of_one_law_have_the_ratio_of_their_drops(scene):
    dry = replace(scene, fluid_pressure="ignored")
    service = replace(dry, fluid=fs.Liquid(2e-3, slip_length=SLIP))
    assert_allclose(drop_ratio(FluidState(SLIPPERY, 1e6, 0.0), service), 2)
    gas = FluidState(HELIUM, 2e6, 1e5).in_scene(dry)
    # where either presses the faces apart, the faces lie otherwise
    acts = replace(service, fluid_pressure="acts")
    for fluid, pressure, other in (
        (WATER, 0.0, service),
        (HELIUM, 1e5, gas),
        (SLIPPERY, 0.0, acts),
    ):
        assert drop_ratio(FluidState(fluid, 1e6, pressure), other) is None
