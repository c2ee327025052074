"""The form from which every flow is assembled, and the tensor of a doubly periodic cell."""

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose
from skfem import BilinearForm

from femseal.base import InputError
from femseal.flow import forms, permeability_tensor
from femseal.flow.grid import edge_conductances

D = 1e-6


@pytest.mark.parametrize(
    "form", [lambda p, q, w: w.k[0, 0] * p * q, lambda p, q, w: w.k[0, 0] * p * q.grad[0]]
)
def test_a_form_that_is_no_flow_is_refused(form, monkeypatch):
    monkeypatch.setattr(forms, "darcy_flow", BilinearForm(form))
    edge_conductances.cache_clear()
    try:
        with pytest.raises(ValueError, match="does not describe a flow"):
            edge_conductances()
    finally:
        edge_conductances.cache_clear()


def test_an_edge_of_the_unit_square_conducts_half():
    assert_allclose(edge_conductances(), 0.5, rtol=1e-14)


DOUBLED = """
import sys
import numpy as np
from skfem import BilinearForm
from femseal.flow import forms

if sys.argv[1] == "2":
    once = forms.darcy_flow
    forms.darcy_flow = BilinearForm(lambda p, q, w: 2 * once.form(p, q, w))

import femseal as fs

h = np.abs(np.sin(np.arange(400.0).reshape(20, 20))) * 1e-6 + 1e-7
h[3:6, 4:9] = 0
found = [fs.cell_permeability(h, (1e-6, 2e-6), axis=a, sides=s).value for a in (0, 1) for s in ("mirror", "periodic")]
found += list(fs.permeability_tensor(h, (1e-6, 2e-6)).ravel())
seals = (fs.RectangularSeal((0.01, 0.03), (4, 5)), fs.AnnularSeal(0.01, 0.02, (4, 5)),
         fs.MeshSeal(sys.argv[2], "inlet", "outlet"))
for seal in seals:
    found.append(fs.seal_leakage(seal, 1e-18, fs.Liquid(1e-3), inlet_pressure=1e6).volume_rate)
print(*map(float, found))
"""


def test_every_flow_follows_the_form(monkeypatch, capsys):
    """Doubled before anything is assembled, it doubles every permeability and leakage."""
    ring = Path(__file__).parents[2] / "meshes" / "ring.msh"
    monkeypatch.setattr(sys, "argv", ["once", "1", ring])
    exec(compile(DOUBLED, "once", "exec"), {})
    doubled = subprocess.run(
        [sys.executable, "-c", DOUBLED, "2", ring], capture_output=True, text=True, check=True
    )
    once, twice = (
        np.array(text.split(), dtype=float) for text in (capsys.readouterr().out, doubled.stdout)
    )
    assert once.size == 11
    assert_allclose(twice, 2 * once, rtol=1e-9)


# --- the flow through a cell ---


@pytest.mark.parametrize("solver", ["auto", "amg"])
def test_tensor_of_a_cell_is_that_of_its_links(solver):
    """Against a dense solution of the network on the torus, written out."""
    h = np.maximum(np.random.default_rng(2).normal(1, 0.3, (6, 7)), 0.1) * D
    d = np.array([D, 2 * D])
    node = np.arange(42).reshape(6, 7)
    drops, conductances, lengths = np.zeros((84, 42)), np.zeros(84), np.zeros((84, 2))
    for axis, k in enumerate(_torus_permeabilities(h)):
        for row, (s, e) in enumerate(zip(node.flat, np.roll(node, -1, axis).flat, strict=True)):
            drops[42 * axis + row, [s, e]] = -1, 1
        conductances[42 * axis :][:42] = k.ravel() * d[1 - axis] / d[axis]
        lengths[42 * axis :][:42, axis] = d[axis]
    root = np.sqrt(conductances)[:, None]
    chi = np.linalg.lstsq(root * drops, -root * lengths, rcond=None)[0]
    drop = root * (drops @ chi + lengths)
    found = permeability_tensor(h, (D, 2 * D), solver=solver)
    assert_allclose(found, drop.T @ drop / (42 * d.prod()), rtol=1e-7)
    with pytest.raises(InputError, match="solver"):
        permeability_tensor(h, (D, D), solver="elimination")


def _torus_permeabilities(h):
    """Four-point cubic in h along both axes, written with numpy."""
    found = []
    for axis in (0, 1):
        before, after, last = (np.roll(h, s, axis=axis) for s in (1, -1, -2))
        smaller = np.minimum(h, after)
        middle = np.clip((9 * (h + after) - before - last) / 16, 0.1 * smaller, 4 * smaller)
        found.append(middle**3 / 12)
    return found
