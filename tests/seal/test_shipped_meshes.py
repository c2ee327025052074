"""Meshes that are shipped: what their scripts say, read by MeshSeal; gmsh makes them again where it is installed."""

import runpy
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose
from skfem import MeshQuad1, MeshTri1

from femseal.seal import MeshSeal

MESHES = Path(__file__).parents[2] / "meshes"
#: Inlet, outlet, kind, and flow for a unit permeability and drop, where a closed form is near, with its tolerance.
KNOWN = {
    "bolted_ring": ("bore", ("rim", "bolts"), MeshTri1, None, 0),
    # two half rings and two straight sides in parallel
    "racetrack": ("inside", "outside", MeshTri1, 2 * np.pi / np.log(12 / 8) + 2 * 20 / 4, 1e-3),
    # four straight sides, and four square corners of which each adds 0.559 squares to what a straight side has
    "frame": ("inside", "outside", MeshQuad1, 2 * (24 + 16) / 4 + 4 * 0.559, 0.01),
    "cone_seat": ("small", "large", MeshQuad1, 2 * np.pi * np.sin(np.pi / 4) / np.log(6 / 5), 1e-3),
}
every_mesh = pytest.mark.parametrize("name", sorted(KNOWN))


def script(name):
    return runpy.run_path(str(MESHES / f"{name}.py"))


def test_every_mesh_has_its_script():
    assert (
        {p.stem for p in MESHES.glob("*.msh")}
        == {p.stem for p in MESHES.glob("*.py")}
        == {*KNOWN, "ring"}
    )


@every_mesh
def test_a_mesh_is_what_its_script_says(name):
    inlet, outlet, kind, flow, tolerance = KNOWN[name]
    path = MESHES / f"{name}.msh"
    seal = MeshSeal(path, inlet, outlet, "mm")
    assert type(seal.mesh) is kind
    assert path.stat().st_size < 300_000
    assert_allclose(seal.area, 1e-6 * script(name)["area"](), rtol=5e-4)
    if flow is not None:
        found = seal.flow(1.0, bounds=True)
        assert_allclose(found.conductance, flow, rtol=tolerance)
        assert found.lower < found.upper == found.conductance


def test_holes_draw_flow_to_them():
    """The holes are at the pressure of the rim: more flows than through the ring without holes."""
    path = MESHES / "bolted_ring.msh"
    into_all, into_rim = (MeshSeal(path, "bore", out, "mm") for out in (("rim", "bolts"), "rim"))
    whole = 2 * np.pi / np.log(25 / 10)
    assert into_rim.flow(1.0).conductance < whole < into_all.flow(1.0).conductance
    assert_allclose(
        into_all.length, 2 * np.pi * (25 + 4 * 2.75) * 1e-3, rtol=1e-3
    )  # sides are chords


@every_mesh
def test_the_script_makes_a_mesh_of_the_same_area(name, tmp_path):
    if name != "cone_seat":
        pytest.importorskip("gmsh", reason="the extra femseal[mesh] is not installed")
    path = tmp_path / f"{name}.msh"
    script(name)["write"](path)
    inlet, outlet, kind, *_ = KNOWN[name]
    again, shipped = (MeshSeal(p, inlet, outlet, "mm") for p in (path, MESHES / path.name))
    assert type(again.mesh) is kind
    assert_allclose(again.area, shipped.area, rtol=1e-4)
