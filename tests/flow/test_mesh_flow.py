"""Darcy flow on meshes: closed forms, orders, bounds that bracket, percolation, bad input."""

from dataclasses import replace
from decimal import Decimal, localcontext
from math import nan

import numpy as np
import pytest
from numpy.testing import assert_allclose
from skfem import Basis, ElementQuad1, ElementTriP1, MeshQuad, MeshQuad2, MeshTet, MeshTri
from skfem.models import laplace

from femseal.analytic import stripes_across
from femseal.base import InputError, NotConverged
from femseal.flow import mesh as flow_through_mesh
from femseal.flow.mesh import darcy_conductance
from femseal.flow.problem import checked_imbalance

LINEAR = [MeshTri, MeshQuad]


def rectangle(kind, n1, n2, size=(1.0, 1.0)):
    mesh = kind.init_tensor(np.linspace(0, size[0], n1 + 1), np.linspace(0, size[1], n2 + 1))
    return mesh.with_boundaries({"in": lambda x: x[0] == 0, "out": lambda x: x[0] == size[0]})


def flow(mesh, k, **kwargs):
    return darcy_conductance(mesh, k, mesh.boundaries["in"], mesh.boundaries["out"], **kwargs)


def centres(mesh):
    return mesh.p[:, mesh.t].mean(axis=1)


@pytest.mark.parametrize("kind", LINEAR)
def test_uniform_rectangle_is_exact(kind):
    mesh = rectangle(kind, 3, 4, (2.0, 3.0))
    f = flow(mesh, 5e-18, bounds=True)
    assert_allclose([f.conductance, f.lower, f.upper], 5e-18 * 3 / 2, rtol=1e-13)
    assert_allclose(f.potential, 1 - mesh.p[0] / 2, atol=1e-14)
    assert f.percolates
    assert max(f.imbalance, f.residual) < 1e-13


@pytest.mark.parametrize("kind", LINEAR)
@pytest.mark.parametrize(("axis", "mean"), [(0, stripes_across), (1, np.mean)])
def test_stripes(kind, axis, mean):
    mesh = rectangle(kind, 8, 8)
    k = np.where((centres(mesh)[axis] * 4).astype(int) % 2 == 0, 1.0, 1e-6)
    f = flow(mesh, k, bounds=True)
    assert_allclose([f.lower, f.conductance, f.upper], mean([1.0, 1e-6]), rtol=1e-9)


@pytest.mark.parametrize("kind", LINEAR)
def test_all_shapes_of_permeability_agree(kind):
    mesh = rectangle(kind, 4, 4)
    k = np.exp(np.random.default_rng(4).standard_normal(mesh.nelements))
    expected = flow(mesh, k, bounds=True)
    for same in (np.column_stack([k, k]), k[:, None, None] * np.eye(2), k.tolist()):
        f = flow(mesh, same, bounds=True)
        assert (f.conductance, f.lower) == (expected.conductance, expected.lower)
    assert_allclose(flow(mesh, 1e-40 * k).conductance, 1e-40 * expected.conductance, rtol=1e-12)


@pytest.mark.parametrize("kind", LINEAR)
def test_closed_across_is_exactly_zero(kind):
    """Each side stands at the pressure of its end; what no end reaches has none."""
    mesh = rectangle(kind, 6, 6)
    k = np.where(np.abs(centres(mesh)[0] - 0.5) < 0.3, 0.0, 1.0)
    f = flow(mesh, k, bounds=True)
    assert (f.conductance, f.lower, f.upper, f.percolates) == (0.0, 0.0, 0.0, False)
    x = mesh.p[0]
    expected = np.select([x < 0.3, x > 0.7], [1.0, 0.0], np.nan)
    assert_allclose(f.potential, expected)
    assert not flow(mesh, 0.0).percolates


@pytest.mark.parametrize("kind", LINEAR)
def test_pockets_and_dead_ends_do_no_harm(kind):
    """One row of six carries all; a pocket and dead ends at inlet and outlet carry nothing."""
    mesh = rectangle(kind, 6, 6)
    x, y = (centres(mesh) * 6).astype(int)
    k = np.where(y == 5, 2.0, 0.0)
    k[(y == 3) & (x == 3)] = k[(y == 1) & (x < 4)] = k[(y == 2) & (x == 5)] = 1.0
    f = flow(mesh, k, bounds=True)
    assert_allclose([f.lower, f.conductance], 2.0 / 6, rtol=1e-12)
    dead_end = (np.abs(mesh.p[1] - 1.5 / 6) < 0.1) & (mesh.p[0] < 0.6)
    assert_allclose(f.potential[dead_end], 1.0)
    corner_of_pocket = np.argmin(np.abs(mesh.p - 0.5).max(axis=0))
    assert np.isnan(f.potential[corner_of_pocket])


def test_corners_connect_in_the_value_and_not_in_the_lower_bound():
    mesh = rectangle(MeshQuad, 2, 2)
    k = np.where((centres(mesh) > 0.5).sum(axis=0) % 2 == 0, 1.0, 0.0)
    f = flow(mesh, k, bounds=True)
    assert f.percolates
    assert f.lower == 0.0
    assert_allclose(
        [f.conductance, f.upper], 5 / 16, rtol=1e-12
    )  # by hand, with the two free nodes at 7/8 and 1/8


def test_elements_closed_along_one_axis():
    """k2 = 0 everywhere leaks along x1; a column with k1 = 0 closes the seal, most of one makes a detour."""
    mesh = rectangle(MeshQuad, 4, 4)
    k = np.ones((mesh.nelements, 2))
    k[:, 1] = 0
    f = flow(mesh, k, bounds=True)
    assert_allclose([f.conductance, f.lower], 1.0, rtol=1e-8)
    column = (centres(mesh)[0] * 4).astype(int) == 2
    k = np.ones((mesh.nelements, 2))
    k[column, 0] = 0
    f = flow(mesh, k, bounds=True)
    assert (f.conductance, f.upper, f.percolates) == (0.0, 0.0, False)
    k[column & (centres(mesh)[1] > 0.75), 0] = 1
    f = flow(mesh, k, bounds=True)
    assert f.percolates
    assert 0.25 < f.lower < f.upper < 1


@pytest.mark.parametrize(
    ("k", "message"),
    [
        (np.nan, "given 1 value not finite, expected numbers >= 0"),
        (-1e-18, "given -1e-18, expected numbers >= 0"),
        (
            np.ones(5),
            r"given shape \(5,\), expected a number or shape \(4,\) or \(4, 2\) or \(4, 2",
        ),
        ("much", "given 'much', expected numbers"),
        (np.tile([[1.0, 0.5], [0, 1]], (4, 1, 1)), "given a tensor that is not symmetric in el"),
        (np.tile([[1.0, 2], [2, 1]], (4, 1, 1)), "given a negative principal value in element 0"),
    ],
)
def test_bad_permeability(k, message):
    with pytest.raises(InputError, match="^permeability: " + message):
        flow(rectangle(MeshQuad, 2, 2), k)


def test_bad_meshes_and_ends():
    mesh = rectangle(MeshQuad, 2, 2)
    inlet, outlet = mesh.boundaries["in"], mesh.boundaries["out"]
    inside = np.setdiff1d(np.arange(mesh.nfacets), mesh.boundary_facets())[:1]
    rest = np.setdiff1d(mesh.boundary_facets(), inlet)
    for given, text in (
        ((MeshTet(), 1.0, [0], [1]), "mesh: given a MeshTet1, expected one of MeshTri1, MeshQuad1"),
        ((MeshQuad2.from_mesh(mesh), 1.0, inlet, outlet), "mesh: .* with linear elements; mesh"),
        ((mesh, 1.0, [], outlet), "inlet: given no facets"),
        ((mesh, 1.0, inlet + 0.4, outlet), "inlet: given an array of float64, .* integers, or"),
        ((mesh, 1.0, [True, False], outlet), "inlet: given an array of bool, shape .2,., .* flags"),
        (
            (mesh, 1.0, inlet, inside),
            "outlet: given facets inside the mesh, expected facets of its",
        ),
        ((mesh, 1.0, inlet, rest), "inlet and outlet: given boundaries that touch"),
    ):
        with pytest.raises(InputError, match="^" + text):
            darcy_conductance(*given)


def test_facets_may_be_given_by_flags():
    mesh = rectangle(MeshQuad, 3, 3)
    k = np.arange(1.0, mesh.nelements + 1)
    inlet, outlet = mesh.boundaries["in"], mesh.boundaries["out"]
    flags = [np.isin(np.arange(mesh.nfacets), end) for end in (inlet, outlet)]
    by_number, by_flag = (
        darcy_conductance(mesh, k, inlet, outlet),
        darcy_conductance(mesh, k, *flags),
    )
    assert by_flag.conductance == by_number.conductance


def test_flows_that_do_not_balance_are_refused(monkeypatch):
    exact = flow_through_mesh.solve_between_ends

    def careless(*given, **options):
        solution = exact(*given, **options)
        return replace(solution, x=1.01 * solution.x)

    monkeypatch.setattr(flow_through_mesh, "solve_between_ends", careless)
    with pytest.raises(NotConverged, match=r"^flow: the flow rates at inlet and outlet differ by"):
        flow(rectangle(MeshTri, 3, 3), 1.0)


@pytest.mark.parametrize(
    ("rates", "scale"),
    [((1.0, 0.98, 1.0), 1.0), ((1.0, 1.0, 0.98), 1.0), ((1.0, nan, 1.0), 1.0), ((0.0,) * 3, 0.0)],
)
def test_inflow_outflow_and_energy_must_agree(rates, scale):
    assert checked_imbalance(1.0, 0.995, 1.0025, scale=2.0, allowed=0.01) == pytest.approx(0.0025)
    with pytest.raises(NotConverged, match=r"^flow through a test: .* expected 1e-02; advice$"):
        checked_imbalance(
            *rates, scale=scale, allowed=0.01, flow="flow through a test", advice="advice"
        )


@pytest.mark.parametrize("kind", [MeshQuad, MeshTri])
def test_a_part_behind_two_narrow_bands_is_exact_or_refused(kind):
    """Sums of wide and narrow links lose the narrow ones, by which alone the part in the middle has its potential."""
    mesh = rectangle(kind, 8, 8)
    x = centres(mesh)[0]
    bands = ((x > 0.25) & (x < 0.375)) | ((x > 0.625) & (x < 0.75))
    for decades in (6, 9, 12, 14, 17, 20):
        k = np.where(bands, 10.0**-decades, 1.0)
        found = flow(mesh, k)
        assert_allclose(found.conductance, 1 / (0.25 * 10.0**decades + 0.75), rtol=1e-11)
        assert max(found.residual, found.imbalance) < 1e-8
    for decades in (60, 150):
        with pytest.raises(NotConverged, match="try a smaller permeability contrast"):
            flow(mesh, np.where(bands, 10.0**-decades, 1.0))


@pytest.mark.parametrize("contrast", [1e3, 1e9, 1e13, 1e17, 1e21])
@pytest.mark.parametrize("kind", LINEAR)
def test_flow_past_elements_that_are_lost_in_sums(kind, contrast):
    """Against elimination in 60 digits: the pressure drops across elements of which no digit is in the diagonals."""
    mesh = rectangle(kind, 6, 6)
    is_open = np.random.default_rng(14).random(mesh.nelements) < 0.5
    k = np.where(is_open, 1.0, 1 / contrast)
    assert_allclose(flow(mesh, k).conductance, flow_in_many_digits(mesh, k), rtol=1e-10)


def flow_in_many_digits(mesh, k):
    """Flow for a unit drop by elimination of the vertices one by one, the forms assembled by scikit-fem."""
    element = ElementTriP1() if isinstance(mesh, MeshTri) else ElementQuad1()
    basis = Basis(mesh, element)
    local = laplace.coo_data(basis).tolocal()
    matrix = [[Decimal(0)] * mesh.nvertices for _ in range(mesh.nvertices)]
    with localcontext(prec=60):
        for vertices, own, value in zip(mesh.t.T, local, k, strict=True):
            for a, i in enumerate(vertices):
                for b, j in enumerate(vertices):
                    if i < j:  # the row sums to zero
                        link = Decimal(value) * Decimal(own[a, b])
                        matrix[i][j] += link
                        matrix[j][i] += link
                        matrix[i][i] -= link
                        matrix[j][j] -= link
        ends = [np.unique(mesh.facets[:, mesh.boundaries[name]]) for name in ("in", "out")]
        inner = np.setdiff1d(np.arange(mesh.nvertices), np.concatenate(ends))
        for n, i in enumerate(inner):
            others = [*inner[n + 1 :], *ends[0], *ends[1]]
            for a in others:
                part = matrix[a][i] / matrix[i][i]
                for b in others:
                    matrix[a][b] -= part * matrix[i][b]
        return float(-sum(matrix[i][j] for i in ends[0] for j in ends[1]))
