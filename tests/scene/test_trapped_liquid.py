"""Liquid that pockets of the faces keep: closed forms of one groove, volumes, and what is refused."""

import tomllib

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from small_cases import steel_scene

import femseal as fs
from femseal.case import parse_case
from femseal.face.cell_flow import FlowSettings
from femseal.preparation import prepare
from femseal.scene.fluid_coupling import solve_coupled_contact
from femseal.scene.fluid_pressure import FluidPressure
from femseal.scene.trapped_liquid import label_pockets
from femseal.seal import Profile

E, D = 115e9, 1e-6
N = 64


def groove():
    """One wave along x1 with its crest at both ends (n1, n2): all that is open is one groove."""
    x = (np.arange(N) + 0.5) / N
    return np.repeat(1e-6 * (1 - np.cos(2 * np.pi * x))[:, None], 4, axis=1)


def groove_contact(load, former=None, bulk_modulus=None):
    """The groove under a load [Pa], with liquid without pressure at both ends."""
    body = fs.HalfSpace((N, 4), (D, D), E, ("periodic", "periodic"))
    fluid = fs.Liquid(1e-3, bulk_modulus=bulk_modulus)
    acting = FluidPressure(fluid, 1.0, 0.0, "total", FlowSettings(), trapped=True)
    return solve_coupled_contact(
        acting, groove(), body, pressure=load, hardness=np.inf, rtol=1e-9, remembered=former
    )


FIRST = 2e9  # of 11e9 that close the groove (Westergaard: π E* 2 h / λ)


@pytest.mark.parametrize("second", [1.2 * FIRST, 2 * FIRST, 5 * FIRST])
def test_an_incompressible_liquid_carries_all_of_a_further_load(second):
    """A uniform pressure on a periodic face moves nothing: with the same volume the gap is the same."""
    first = groove_contact(FIRST)
    then = groove_contact(second, first.trapped)
    assert then.trapped.pressure.size == 1
    # the volume is right to 1e-3, which is that times V/(dV/dp) = 1.3 GPa of the pressure
    assert_allclose(then.trapped.pressure, second - FIRST, rtol=0, atol=1.5e6)
    assert_allclose(then.gap, first.gap, rtol=0, atol=2e-3 * first.gap.max())
    assert_allclose(then.pressure, first.pressure, rtol=0, atol=5e-3 * first.pressure.max())


def test_a_compressible_liquid_keeps_its_mass():
    """V exp(p/B) stays, where V is that of the dry groove under p̄ − p."""
    bulk = 2e9
    first = groove_contact(FIRST, bulk_modulus=bulk)
    then = groove_contact(2 * FIRST, first.trapped, bulk)
    (p,) = then.trapped.pressure
    body = fs.HalfSpace((N, 4), (D, D), E, ("periodic", "periodic"))
    dry = fs.solve_contact(groove(), body, pressure=2 * FIRST - p, rtol=1e-9)
    assert 0.1 * FIRST < p < 0.9 * FIRST
    assert_allclose(dry.gap.sum() * np.exp(p / bulk), first.gap.sum(), rtol=3e-3)


def test_unloading_to_where_it_closed_gives_the_first_contact():
    """Below that the liquid has no tension, and the vapour that fills the rest is pressed out first."""
    first = groove_contact(FIRST)
    back = groove_contact(FIRST, groove_contact(2 * FIRST, first.trapped).trapped)
    less = groove_contact(0.5 * FIRST, first.trapped)
    assert_allclose(less.trapped.pressure, 0.0, atol=1.0)
    assert less.gap.sum() > first.gap.sum()
    again = groove_contact(FIRST, less.trapped)
    for contact in (back, again):
        assert_allclose(contact.trapped.pressure, 0.0, atol=2e-3 * FIRST)
        assert_allclose(contact.gap, first.gap, rtol=0, atol=2e-3 * first.gap.max())


H = 2.3e9


def face(seed=1):
    waves = {"rms_slope": 0.2, "roll_off": 8 * D, "cut_off": 6 * D, "rng": seed}
    return fs.self_affine((96, 96), (96 * D, 96 * D), hurst=0.75, **waves)


def scene(**changes):
    given = {
        "hardness": H,
        "fluid": fs.Liquid(1e-3, bulk_modulus=2e9),
        "inlet_pressure": 0.006 * H,
        "loading": (0.25 * H, 0.3 * H, 0.35 * H),
        "unload_from": (0.35 * H,),
        "unloading": (0.2 * H,),
        "fluid_pressure": "trapped",
    }
    return steel_scene(changes.pop("surface", face()), **given | changes)


def test_trapped_liquid_carries_load_and_leaves_more_open():
    acts, trapped = (fs.deterministic(scene(fluid_pressure=how)) for how in ("acts", "trapped"))
    # nothing was trapped before
    assert_allclose(trapped.leakage[0], acts.leakage[0], rtol=2e-3)
    assert trapped.carried_pressure[2] > 1.2 * acts.carried_pressure[2]
    assert np.all(trapped.leakage[1:] >= 0.999 * acts.leakage[1:])
    assert trapped.leakage[2] > 1.01 * acts.leakage[2]
    assert_array_equal(fs.two_scale(scene(), (3, 3)).leakage, trapped.leakage)


def test_where_none_is_trapped_the_fluid_that_flows_carries_nearly_all():
    nearly = {
        "loading": (0.1 * H,),
        "unload_from": (),
        "unloading": (),
        "inlet_pressure": 0.165 * H,
    }
    acts, trapped = (
        fs.deterministic(scene(fluid_pressure=how, **nearly)) for how in ("acts", "trapped")
    )
    assert 0.9 * 0.1 * H < acts.carried_pressure[0] < 0.1 * H
    assert_allclose(trapped.leakage, acts.leakage, rtol=1e-9)


def test_pockets_keep_their_volume():
    whole = scene(unload_from=(), unloading=())
    _, *states = whole.contact_states(lambda state: state.contact, mapper=map)
    for now in states:
        liquid = now.trapped
        size = liquid.amount.size + 1
        volume = D**2 * np.bincount(np.maximum(liquid.pocket, 0).ravel(), now.gap.ravel(), size)[1:]
        kept = (volume > 0) & ~np.isnan(liquid.step) & (liquid.pressure < 0.89 * H)
        held = volume * np.exp(liquid.pressure / 2e9)
        assert kept.any()
        assert_allclose(held[kept].sum(), liquid.amount[kept].sum(), rtol=5e-3)


def test_drawn_seals_in_the_rows_of_the_face_have_its_contact():
    sampling, whole = fs.Sampling(96e-6, 3, seed=1), fs.deterministic(scene())
    alone = fs.stochastic(scene(), (3, 3), sampling)
    assert_allclose(alone.cells.surface_leakage, whole.leakage, rtol=1e-9)
    acts = fs.stochastic(scene(fluid_pressure="acts"), (3, 3), sampling)
    assert (np.median(alone.leakage / acts.leakage, axis=0)[2:] > 1.01).all()


@pytest.mark.parametrize(
    "given",
    [
        {"fluid": fs.IdealGas(2e-5, 0.029, 293.0), "outlet_pressure": 1e5},
        {"surface": [face(seed=1), face(seed=2), face(seed=3)]},
    ],
)
def test_a_gas_and_several_patches_are_refused(given):
    with pytest.raises(fs.InputError, match="'trapped' with a gas, several patches or a spiral"):
        scene(**given)


@pytest.mark.parametrize(
    "given", [{"breadth": 192e-6}, {"pressure_map": Profile((0.8, 1.2))}], ids=["broad", "map"]
)
def test_drawn_seals_of_cells_from_anywhere_are_refused(given, contacts):
    """Before any contact is solved: a ladder is one of dry faces."""
    with pytest.raises(fs.InputError, match="'trapped' with a seal that takes cells from anywhere"):
        fs.stochastic(scene(), (3, 3), fs.Sampling(96e-6, 2, seed=1, **given))
    assert contacts == []


def test_pockets_go_on_over_the_seam():
    is_pocket = np.zeros((5, 6), bool)
    is_pocket[1, :2] = is_pocket[1, 5] = is_pocket[3, 2] = True
    pocket, n = label_pockets(is_pocket)
    assert n == 2
    assert_array_equal(pocket > 0, is_pocket)
    assert pocket[1, 0] == pocket[1, 1] == pocket[1, 5] != pocket[3, 2]


CASE = """
    title = "a trapped liquid"
    method = "deterministic"
    seed = 1
    face = {kind = "self-affine", points = [64, 64], size = ["60 um", "60 um"], rms_slope = 0.2}
    material = {young = "210 GPa", hardness = "3 GPa"}
    load = {loading = ["100 MPa", "300 MPa"]}
    contact = {fluid_pressure = "trapped"}
    fluid = {kind = "liquid", viscosity = "1 mPa*s", bulk_modulus = "2 GPa", inlet_pressure = "1 MPa"}
    cells = {count = [4, 4]}
"""


def test_a_case_says_so():
    prepared = prepare(parse_case(tomllib.loads(CASE)))
    assert prepared.scene.acting_fluid.trapped
    assert prepared.scene.fluid.bulk_modulus == 2e9
    assert "keeps its volume" in prepared.scene.fluid_effect
