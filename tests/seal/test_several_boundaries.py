"""Seals on meshes whose inlet or outlet is made of several boundaries."""

import tomllib
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose
from skfem import MeshQuad

import femseal as fs
from femseal.base import InputError
from femseal.case import parse_case

ROOT = Path(__file__).parents[2]
GASKET = ROOT / "meshes" / "bolted_ring.msh"
WATER = fs.Liquid(1e-3)
GAS = fs.IdealGas(2e-5, 0.028, 293.15, slip=False)


def star(permeability):
    """Mesh of three arms of two squares each between a junction and its ends "left", "right" and "top".

    Returns also the permeability of the elements, from those of the arms to the left, to the right and to the top.
    """
    whole = MeshQuad.init_tensor(np.linspace(0.0, 5.0, 16), np.linspace(0.0, 3.0, 10))
    x, y = whole.p[:, whole.t].mean(axis=1)
    mesh = whole.restrict(np.flatnonzero((y < 1) | ((x > 2) & (x < 3)))).with_boundaries(
        {
            "left": lambda x: np.isclose(x[0], 0.0),
            "right": lambda x: np.isclose(x[0], 5.0),
            "top": lambda x: np.isclose(x[1], 3.0),
        }
    )
    x, y = mesh.p[:, mesh.t].mean(axis=1)
    # the junction is so permeable that its potential is uniform
    return mesh, np.select([x < 2, x > 3, y > 1], permeability, 1e7)


@pytest.mark.parametrize("fluid", [WATER, GAS])
@pytest.mark.parametrize("is_inlet", [True, False])
def test_two_boundaries_of_a_star_are_resistances_in_parallel(fluid, is_inlet):
    conductance = np.array([1.0, 3.0, 0.5]) / 2  # an arm is two squares long
    mesh, permeability = star(2 * conductance)
    both, other = ["left", "top"], "right"
    seal = fs.MeshSeal(mesh, both, other) if is_inlet else fs.MeshSeal(mesh, other, both)
    found = fs.seal_leakage(seal, permeability, fluid, inlet_pressure=10e5, outlet_pressure=1e5)
    parallel = conductance[0] + conductance[2]
    series = 1 / (1 / parallel + 1 / conductance[1])
    drop = fluid.potential(10e5) - fluid.potential(1e5)
    assert found.mass_rate == pytest.approx(series * drop, rel=1e-6)


def test_an_inlet_of_which_one_boundary_is_cut_off_leaks_through_the_other():
    mesh, permeability = star(np.array([1.0, 1.0, 0.0]))
    found = fs.seal_leakage(
        fs.MeshSeal(mesh, ["left", "top"], "right"), permeability, WATER, inlet_pressure=1e6
    )
    assert_allclose(found.mass_rate, 1e6 / 1e-3 / 4 * WATER.density, rtol=1e-6)


def test_pressures_of_inlets_are_answered_with_what_to_do():
    with pytest.raises(InputError, match="inlet: given pressures of bore, bolts, expected names"):
        fs.MeshSeal(GASKET, {"bore": 4e6, "bolts": 1e6}, "rim", "mm")
    data = tomllib.loads((ROOT / "examples" / "gasket_seal.toml").read_text(encoding="utf-8"))
    data["seal"] |= {"path": str(GASKET), "inlet": {"bore": "4 MPa", "bolts": "1 MPa"}}
    with pytest.raises(InputError, match=r"seal.inlet: given pressures of bore, bolts") as error:
        parse_case(data)
    assert "\n" not in str(error.value)
