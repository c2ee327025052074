"""The operator of structured grids: against scikit-fem's own assembly of the whole mesh, and the form it comes from."""

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import scipy.sparse as sp
from each import each
from numpy.testing import assert_allclose
from skfem import Basis, BilinearForm, ElementQuad1, MeshQuad
from skfem.helpers import grad

from femseal.base import InputError
from femseal.flow import permeability_tensor
from femseal.flow.grid import (
    EDGES,
    Grid,
    assemble_on_links,
    elemental,
    own_conductances,
)

D = 1e-6
UNEVEN = np.array([0.0, 0.4, 1.0, 2.5, 2.8, 4.0])


@BilinearForm
def energy_of_tensor(p, q, w):
    """Written out, apart from the package."""
    a, b = grad(p), grad(q)
    return w.k11 * a[0] * b[0] + w.k12 * (a[0] * b[1] + a[1] * b[0]) + w.k22 * a[1] * b[1]


def grids():
    rows = np.arange(UNEVEN.size)
    yield "strip", Grid.of_strip(UNEVEN, 0.7, 4)
    yield "strip of one column", Grid.of_strip(UNEVEN, 0.7, 1)
    yield "strip of two columns", Grid.of_strip(UNEVEN, 0.7, 2)
    yield (
        "uneven columns",
        Grid(UNEVEN, np.array([0.0, 1.0, 1.5, 4.0]), rows, np.arange(4), ring2=False),
    )
    yield "torus", Grid.of_torus((5, 4), (1.0, 0.6))
    for sides in ("mirror", "periodic"):
        yield f"pixels, {sides}", Grid.of_pixel_centres((5, 4), (2.0, 0.7), sides)


GRIDS = dict(grids())
each_grid = pytest.mark.parametrize("name", GRIDS)


def whole_mesh(grid, points, weights, coefficients):
    """Matrix of the degrees of freedom from scikit-fem on the whole mesh; coefficients (k11, k12, k22)(e, q, i, j)."""
    mesh = MeshQuad.init_tensor(grid.lines1, grid.lines2)
    basis = Basis(mesh, ElementQuad1(), quadrature=(points, weights))
    corner = mesh.p[:, mesh.t].min(axis=1)
    i, j = (
        np.searchsorted(lines, x)
        for lines, x in zip((grid.lines1, grid.lines2), corner, strict=True)
    )
    # where each quadrature point lies in its element, whatever scikit-fem's local axes are
    at = np.asarray(basis.global_coordinates())
    local = [
        (at[a] - corner[a][:, None]) / np.diff(lines)[n][:, None]
        for a, (lines, n) in enumerate(((grid.lines1, i), (grid.lines2, j)))
    ]
    k11, k12, k22 = coefficients(local[0], local[1], i[:, None], j[:, None])
    matrix = energy_of_tensor.assemble(basis, k11=k11, k12=k12, k22=k22)
    row, column = (
        np.searchsorted(lines, x)
        for lines, x in zip((grid.lines1, grid.lines2), mesh.p, strict=True)
    )
    n2 = grid.nodes[1]
    node = grid.rows[row] * n2 + grid.columns[column]
    join = sp.csr_array((np.ones(node.size), (node, np.arange(node.size))))
    return (join @ matrix @ join.T).toarray()


def assert_same(grid, stencil, expected):
    """Equal but for the conductances between nodes of one end, which a stencil leaves out."""
    n2 = grid.nodes[1]
    ours = stencil.to_csr().toarray()
    inner = slice(None) if grid.ring1 else slice(n2, -n2)
    assert_allclose(ours[inner], expected[inner], rtol=0, atol=1e-13 * np.abs(expected).max())


def at(local, value):
    return np.abs(local - value) < 1e-6


@each_grid
def test_edges_equal_the_assembly_of_the_whole_mesh(name):
    grid = GRIDS[name]
    rng = np.random.default_rng(3)
    m1, m2 = grid.elements
    rows, n2 = grid.nodes
    k1 = rng.lognormal(0, 2, (m1, n2))
    k2 = rng.lognormal(0, 2, (rows if grid.ring1 else rows - 2, m2 if grid.ring2 else n2 - 1))
    stencil = assemble_on_links(grid, k1, k2)
    first = 0 if grid.ring1 else 1

    def coefficients(x, y, i, j):
        """K11 on edges along x1, K22 on those along x2; half pixels at the ends take K22 at their inner edge only."""
        on1, on2 = at(x, 0.5), at(y, 0.5)
        column = grid.columns[j + at(y, 1)]
        k11 = np.where(on1, k1[i + 0 * column, column], 0.0)
        row = grid.rows[i + at(x, 1)] - first
        apart = grid.columns[j] != grid.columns[j + 1]
        inside = (row >= 0) & (row < len(k2)) & apart
        k22 = np.where(
            on2 & inside, k2[np.clip(row, 0, len(k2) - 1), grid.columns[j] % k2.shape[1]], 0.0
        )
        if grid.half_ends:
            k22 = k22 * np.where((i == 0) | (i == m1 - 1), 2.0, 1.0)
        return k11, 0 * k11, k22

    points = np.array([[0.5, 0.5, 0.0, 1.0], [0.0, 1.0, 0.5, 0.5]])
    assert_same(grid, stencil, whole_mesh(grid, points, np.full(4, 0.5), coefficients))


def test_a_form_that_is_no_flow_is_refused():
    mass = BilinearForm(lambda p, q, w: w.k[0, 0] * p * q)
    with pytest.raises(ValueError, match="no flow"):
        own_conductances(elemental(mass, ElementQuad1, EDGES))


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


@each("solver", ["auto", "amg"])
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
