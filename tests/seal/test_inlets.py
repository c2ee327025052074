"""Seals whose inlets have pressures of their own: closed forms, superposition, balance, and faults."""

import tomllib
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose
from skfem import MeshQuad

import femseal as fs
from femseal.base import InputError
from femseal.case import parse_case
from femseal.flow.permeability_table import PermeabilityTable
from femseal.preparation import prepare
from femseal.seal.mesh_seal import ElementSeal, PressureBoundaries
from femseal.seal.tiles import SealTiles
from femseal.studies.drawn_study import _rate_of_power

ROOT = Path(__file__).parents[2]
HELIUM = {"kind": "ideal-gas", "molar_mass": "4 g/mol", "temperature": "20 °C"}
GASKET = ROOT / "meshes" / "bolted_ring.msh"
WATER = fs.Liquid(1e-3)
GAS = fs.IdealGas(2e-5, 0.028, 293.15, slip=False)
TABLE = PermeabilityTable(np.array([1e5, 1e6]), np.array([1e-18, 2e-18]))


def star(k):
    """Three arms of two squares each between a junction and its ends "left", "right" and "top", k (3,) in them."""
    lines = np.linspace(0.0, 5.0, 16), np.linspace(0.0, 3.0, 10)
    whole = MeshQuad.init_tensor(*lines)
    x, y = whole.p[:, whole.t].mean(axis=1)
    mesh = whole.restrict(np.flatnonzero((y < 1) | ((x > 2) & (x < 3)))).with_boundaries(
        {
            "left": lambda x: np.isclose(x[0], 0.0),
            "right": lambda x: np.isclose(x[0], 5.0),
            "top": lambda x: np.isclose(x[1], 3.0),
        }
    )
    x, y = mesh.p[:, mesh.t].mean(axis=1)
    # the junction is so permeable that its potential is one
    return mesh, np.select([x < 2, x > 3, y > 1], k, 1e7)


@pytest.fixture(scope="module")
def rough():
    """Permeability of the elements of the gasket."""
    elements = fs.MeshSeal(GASKET, "bore", "rim", unit="mm").mesh.nelements
    return 1e-18 * np.random.default_rng(0).lognormal(0, 1.5, elements)


@pytest.mark.parametrize("fluid", [WATER, GAS])
def test_three_arms_are_a_star_of_resistances(fluid):
    k = np.array([1.0, 3.0, 0.5])
    mesh, of_elements = star(k)
    seal = fs.MeshSeal(mesh, {"left": 10e5, "top": 4e5}, "right")
    found = fs.seal_leakage(seal, of_elements, fluid, outlet_pressure=1e5)
    potential, conductance = fluid.potential([10e5, 1e5, 4e5]), k / 2
    middle = conductance @ potential / conductance.sum()
    left, right, top = conductance * (potential - middle)
    assert found.mass_rate == pytest.approx(-right, rel=1e-6)
    rates = np.array([found.boundary_rates[name] for name in ("left", "top", "right")])
    assert_allclose(rates * fluid.reference_density, [left, top, right], rtol=1e-6)
    at_top = np.isclose(mesh.p[1], 3.0)
    assert_allclose(found.fluid_pressure[at_top], 4e5)
    assert np.isnan([found.lower, found.upper]).all()


@pytest.mark.parametrize(("solver", "rtol"), [("direct", 1e-10), ("amg", 1e-7)])
def test_equal_pressures_are_those_of_one_inlet(rough, solver, rtol):
    given = {"outlet_pressure": 1e5, "solver": solver}
    both = fs.MeshSeal(GASKET, {"bore": 4e6, "bolts": 4e6}, "rim", "mm")
    joined = fs.MeshSeal(GASKET, ["bore", "bolts"], "rim", "mm")
    several = fs.seal_leakage(both, rough, WATER, **given)
    one = fs.seal_leakage(joined, rough, WATER, inlet_pressure=4e6, **given)
    assert several.solver == one.solver == solver
    assert several.volume_rate == pytest.approx(one.volume_rate, rel=rtol)
    assert several.per_length == pytest.approx(one.per_length, rel=rtol)
    field_rtol = 1e-10 if solver == "direct" else 1e-3
    assert_allclose(several.fluid_pressure, one.fluid_pressure, rtol=field_rtol)


def test_flows_are_those_of_three_conductances(rough):
    """What three boundaries let through in pairs follows from the flow of each against both others."""
    names = np.array(["bore", "bolts", "rim"])
    seals = [fs.MeshSeal(GASKET, one, list(names[names != one]), "mm") for one in names]
    alone = np.array([seal.flow(rough).conductance for seal in seals])
    pair = np.add.outer(alone, alone) - (alone.sum() - np.add.outer(alone, alone))
    pressure = np.array([4e6, 1e6, 1e5])
    expected = (pair / 2 * np.subtract.outer(pressure, pressure)).sum(axis=1) / 1e-3
    seal = fs.MeshSeal(GASKET, {"bore": 4e6, "bolts": 1e6}, "rim", "mm")
    found = fs.seal_leakage(seal, rough, WATER, outlet_pressure=1e5)
    assert_allclose([found.boundary_rates[name] for name in names], expected, rtol=1e-8)
    assert found.boundary_rates["bolts"] < 0  # the bore's fluid leaves there
    assert found.imbalance < 1e-10
    assert abs(sum(found.boundary_rates.values())) < 1e-10 * found.volume_rate


def test_an_outlet_that_is_cut_off_leaks_exactly_nothing():
    mesh, k = star(np.array([1.0, 0.0, 1.0]))
    found = fs.seal_leakage(fs.MeshSeal(mesh, {"left": 2.0, "top": 1.0}, "right"), k, WATER)
    assert (found.volume_rate, found.boundary_rates["right"], found.percolates) == (0.0, 0.0, False)
    # the junction is 1e7 times as permeable, of which sums lose as many digits
    assert_allclose(found.boundary_rates["left"], -found.boundary_rates["top"], rtol=1e-6)
    assert_allclose(found.boundary_rates["left"], 0.25 / 1e-3, rtol=1e-6)


def test_drawn_elements_take_the_mean_of_two_solutions_that_balances():
    mesh, _ = star(np.ones(3))
    k = np.random.default_rng(3).lognormal(0, 1.5, mesh.nelements)
    facets = tuple(mesh.boundaries[name] for name in ("left", "top", "right"))
    ends = np.concatenate(facets[:2]), facets[2]
    axes = np.tile(np.eye(2), (mesh.nelements, 1, 1))
    shape = {"size": (5.0, 1.0), "outlines": mesh.p.T[mesh.t.T], "axes": axes}
    k = np.tile(k[:, None], 2)

    def seal(left, top):
        return ElementSeal(
            mesh,
            *ends,
            **shape,
            boundaries=PressureBoundaries(("a", "b", "c"), facets, (left, top)),
        )

    one = fs.seal_leakage(ElementSeal(mesh, *ends, **shape), k, WATER, inlet_pressure=2.0)
    equal = fs.seal_leakage(seal(2.0, 2.0), k, WATER)
    assert equal.volume_rate == pytest.approx(one.volume_rate, rel=1e-10)
    given = fs.seal_leakage(seal(2.0, 0.5), k, WATER)
    assert 0 < given.volume_rate < one.volume_rate
    assert -given.boundary_rates["c"] == pytest.approx(given.volume_rate, rel=1e-12)
    assert abs(sum(given.boundary_rates.values())) < 1e-10 * given.volume_rate
    # as for bounds, both solutions are near each other where the permeability is even
    conforming = fs.seal_leakage(fs.MeshSeal(mesh, {"left": 2.0, "top": 0.5}, "right"), 1.0, WATER)
    assert fs.seal_leakage(seal(2.0, 0.5), 1.0, WATER).volume_rate == pytest.approx(
        conforming.volume_rate, rel=0.02
    )
    with pytest.raises(InputError, match="all on one side of it"):
        fs.seal_leakage(seal(2.0, -1.0), k, WATER)


def test_the_flux_of_a_drawn_seal_dissipates_what_flows_between_all_boundaries():
    mesh, _ = star(np.ones(3))
    k = np.random.default_rng(3).lognormal(0, 0.5, (mesh.nelements, 2))
    facets = tuple(mesh.boundaries[name] for name in ("left", "top", "right"))
    held = PressureBoundaries(("a", "b", "c"), facets, (2e6, 0.5e6))
    corners = mesh.p.T[mesh.t.T]
    axes = np.tile(np.eye(2), (mesh.nelements, 1, 1))
    seal = ElementSeal(mesh, np.concatenate(facets[:2]), facets[2], (5.0, 1.0), corners, axes, held)
    laid = SealTiles(seal, np.tile([0.0, 1.0], (mesh.nelements, 1)), np.arange(mesh.nelements))
    surface = fs.Topography(np.zeros((4, 4)), (1e-6, 1e-6))
    scene = fs.Scene(surface, 1e11, 1e9, WATER, 2e6, 0.0, loading=(1e8,))
    found = scene.leakage(seal, k)
    flux = laid.flux(k, found.fluid_pressure / WATER.viscosity, _rate_of_power(scene, laid, found))
    ways = corners[:, [2, 3]] - corners[:, [0, 1]]
    p = found.fluid_pressure[mesh.t]
    gradient = np.linalg.solve(ways, (p[[2, 3]] - p[[0, 1]]).T[..., None])[..., 0]
    power = -(flux * gradient).sum() / 9  # the elements are squares of 1/3 m
    rates = found.boundary_rates
    assert power == pytest.approx(rates["a"] * 2e6 + rates["b"] * 0.5e6, rel=1e-9)


BOTH = {"bore": 1e6, "bolts": 1e5}


@pytest.mark.parametrize(
    ("inlet", "outlet", "fluid", "more", "message"),
    [
        ({"bore": 1e6, "port": 1e6}, "rim", WATER, {}, "inlet: given 'port', expected the name of"),
        ({"bore": 1e6, "rim": 1e6}, "rim", WATER, {}, "outlet: given 'rim', which is an inlet too"),
        ({"bore": "high"}, "rim", WATER, {}, "inlet 'bore': given 'high'"),
        ({}, "rim", WATER, {}, "inlet: given no boundaries"),
        ({"bore": 1e6, "bolts": -1e5}, "rim", GAS, {}, "inlet 'bolts': given -100000 Pa"),
        (BOTH, "rim", WATER, {"inlet_pressure": 1e6}, "inlet_pressure: given a pressure"),
        (BOTH, "rim", WATER, {"bounds": True}, "bounds: given true, expected none"),
        (BOTH, "rim", GAS, {"permeability": TABLE}, "permeability: given a table over pressures"),
    ],
)
def test_faults(inlet, outlet, fluid, more, message):
    given = {"permeability": 1e-18, "fluid": fluid} | more
    with pytest.raises(InputError, match=message):
        fs.seal_leakage(fs.MeshSeal(GASKET, inlet, outlet, "mm"), **given)


def test_touching_boundaries_are_refused():
    ends = {"a": lambda x: x[0] == 0, "b": lambda x: x[1] == 0, "c": lambda x: x[0] * x[1] > 0.6}
    square = MeshQuad().refined(2).with_boundaries(ends)
    with pytest.raises(InputError, match="boundaries 'a' and 'b' that touch"):
        fs.MeshSeal(square, {"a": 1.0, "b": 2.0}, "c")


# --- cases ------------------------------------------------------------------------------------------------


def case(**tables):
    data = tomllib.loads((ROOT / "examples" / "gasket_seal.toml").read_text(encoding="utf-8"))
    del data["fluid"]["inlet_pressure"]
    data["seal"] |= {
        "path": str(GASKET),
        "inlet": {"bore": "4 MPa", "bolts": "4 MPa"},
        "outlet": "rim",
    }
    data["face"]["points"] = [64, 128]
    data["load"] = {"loading": ["200 MPa"]}
    data["stochastic"] |= {"realisations": 3}
    for table, keys in tables.items():
        data[table] = data.get(table, {}) | keys
    return data


def test_a_case_with_pressures_of_the_inlets():
    """Without what they do to the contact, for which several inlets count with their mean."""
    more = {"contact": {"fluid_pressure": "ignored"}, "output": {"budget": False}}
    one = {"seal": {"inlet": ["bore", "bolts"]}, "fluid": {"inlet_pressure": "4 MPa"}}
    cases = one, {}, {"seal": {"inlet": {"bore": "4 MPa", "bolts": "1 MPa"}}}
    runs = [fs.run(parse_case(case(**tables, **more)), workers=1) for tables in cases]
    together, several, lower = (run.leakage.values for run in runs)
    assert_allclose(several, together, rtol=1e-9)
    flux, same = (run.dataset["drawn_flux"].values for run in runs[:2])
    assert_allclose(flux, same, atol=1e-6 * np.abs(same).max())
    assert (lower < several).all()


@pytest.mark.parametrize(
    ("tables", "message"),
    [
        ({"fluid": {"inlet_pressure": "4 MPa"}}, "fluid.inlet_pressure: given '4 MPa' beside"),
        ({"seal": {"inlet": {"bore": "4 MPa", "bolts": "-1 MPa"}}}, "a pressure >= 0"),
        ({"seal": {"inlet": {"bore": "4 MPa", "bolts": 4}}}, "seal.inlet"),
        ({"seal": {"inlet": {}}}, "seal.inlet: given no boundaries"),
        ({"seal": {"inlet": {"bore": "4 MPa", "bolts": "0 Pa"}}}, "seal.inlet.bolts: given 0 Pa,"),
        ({"seal": {"outlet": ["rim", "bolts"]}}, "outlet: given 'bolts', which is an inlet too"),
        ({"fluid": HELIUM}, "a liquid, or a gas without slip"),
        ({"output": {"test_fluid": {"name": "helium", "inlet_pressure": "5 bar"}}}, "test_fluid: "),
    ],
)
def test_faults_of_a_case_are_one_line(tables, message):
    with pytest.raises(InputError) as error:
        prepare(parse_case(case(**tables)))
    assert message in str(error.value)
    assert "\n" not in str(error.value)
