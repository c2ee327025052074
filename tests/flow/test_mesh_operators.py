"""Flow through a mesh: closed forms, duality of both bounds, and systems that scikit-fem assembles."""

from dataclasses import replace

import numpy as np
import pytest
import scipy.sparse as sp
from numpy.testing import assert_allclose
from skfem import (
    Basis,
    BilinearForm,
    ElementQuad0,
    ElementQuad1,
    ElementQuadRT0,
    ElementTriP0,
    ElementTriP1,
    ElementTriRT0,
    MeshQuad,
    MeshTri,
    condense,
    solve,
)
from skfem.helpers import div

from femseal.base import InputError
from femseal.flow import forms
from femseal.flow.mesh import MeshOperators
from femseal.seal.tiles import face_tiles


def square(n=6, triangles=False, sides=(1.0, 1.0)):
    """A rectangle of elements, and its facets at x = 0, x = 1, y = 0 and y = 1."""
    lines = [np.linspace(0, side, n + 1) for side in sides]
    mesh = (MeshTri if triangles else MeshQuad).init_tensor(*lines)
    facets = mesh.boundary_facets()
    middle = mesh.p[:, mesh.facets[:, facets]].mean(axis=1)
    ends = [facets[np.isclose(middle[axis], at)] for axis in (0, 1) for at in (0.0, sides[axis])]
    return mesh, *ends


def diagonal(k1, k2):
    return k1[:, None, None] * np.diag([1.0, 0.0]) + k2[:, None, None] * np.diag([0.0, 1.0])


def turned(k1, k2, angle):
    axis = np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    other = np.stack([-axis[:, 1], axis[:, 0]], axis=-1)
    return (
        k1[:, None, None] * axis[:, :, None] * axis[:, None]
        + k2[:, None, None] * other[:, :, None] * other[:, None]
    )


def solved(mesh, inlet, outlet, tensor, solver="auto"):
    """The flow of a drawn seal, between its bounds."""
    flow = MeshOperators(mesh, (inlet, outlet)).flow(tensor, bounds=True, solver=solver)
    return replace(flow, conductance=np.sqrt(flow.lower * flow.upper))


@BilinearForm
def balance(u, q, w):
    """∫ q ∇·u."""
    return div(u) * q


def independent_bounds(mesh, inlet, outlet, tensor):
    """Both bounds by scikit-fem's own assembly: linear elements, and fluxes with a pressure in every element."""
    triangles = isinstance(mesh, MeshTri)
    k = np.moveaxis(tensor, 0, -1)[..., None]
    inverse = np.moveaxis(np.linalg.inv(tensor), 0, -1)[..., None]
    basis = Basis(mesh, ElementTriP1() if triangles else ElementQuad1(), intorder=4)
    matrix, x = forms.darcy_flow.assemble(basis, k=k), np.zeros(basis.N)
    first, last = (np.unique(mesh.facets[:, end]) for end in (inlet, outlet))
    x[first] = 1.0
    x = solve(*condense(matrix, x=x, D=np.concatenate([first, last])))
    fluxes = Basis(mesh, ElementTriRT0() if triangles else ElementQuadRT0(), intorder=4)
    pressures = fluxes.with_element(ElementTriP0() if triangles else ElementQuad0())
    resistance = forms.flux_resistance.assemble(fluxes, resistance=inverse)
    divergence = balance.assemble(fluxes, pressures)
    load = np.zeros(fluxes.N + pressures.N)
    load[inlet] = -1.0  # the pressure there; a degree of freedom is the flow out of a facet
    sides = np.setdiff1d(mesh.boundary_facets(), np.concatenate([inlet, outlet]))
    saddle = sp.bmat([[resistance, -divergence.T], [-divergence, None]], format="csr")
    flux = solve(*condense(saddle, load, D=sides))
    return -flux[inlet].sum(), x @ matrix @ x


@pytest.mark.parametrize("spread", [0.5, 4.0])
@pytest.mark.parametrize("kind", ["quads", "triangles", "periodic"])
def test_bounds_are_those_of_systems_assembled_by_scikit_fem(kind, spread):
    rng = np.random.default_rng(3)
    if kind == "periodic":
        seal = face_tiles((3.0, 4.0), (5, 7)).seal
        mesh, inlet, outlet = seal.mesh, seal.inlet, seal.outlet
    else:
        mesh, inlet, outlet, *_ = square(6, kind == "triangles")
    k = np.exp(spread * rng.standard_normal((2, mesh.nelements)))
    tensor = turned(*k, rng.uniform(0, np.pi, mesh.nelements))
    found = solved(mesh, inlet, outlet, 1e-19 * tensor)
    expected = 1e-19 * np.array(independent_bounds(mesh, inlet, outlet, tensor))
    assert_allclose([found.lower, found.upper], expected, rtol=1e-9)
    assert found.lower < found.upper


@pytest.mark.parametrize("contrast", [1.0, 1e3, 1e10])
def test_the_bounds_of_a_square_and_of_its_dual_are_inverse(contrast):
    """The flux of one solution is the stream function, a potential, of the other: k⁻¹ along the other axis."""
    mesh, left, right, bottom, top = square(8)
    k1, k2 = contrast ** np.random.default_rng(1).uniform(-0.5, 0.5, (2, mesh.nelements))
    along = solved(mesh, left, right, diagonal(k1, k2), "direct")
    dual = solved(mesh, bottom, top, diagonal(1 / k2, 1 / k1), "direct")
    assert_allclose(
        [along.lower * dual.upper, along.upper * dual.lower, along.conductance * dual.conductance],
        1.0,
        rtol=1e-9,
    )


@pytest.mark.parametrize("contrast", [1e2, 1e10])
def test_a_checkerboard_has_the_root_of_the_product(contrast):
    """√(k1 k2) of two dimensions (Dykhne 1971), to the last digits by the geometric mean of both bounds."""
    mesh, left, right, *_ = square(6)
    x, y = mesh.p[:, mesh.t].mean(axis=1)
    k = np.where((np.floor(6 * x) + np.floor(6 * y)) % 2, contrast, 1.0)
    found = solved(mesh, left, right, diagonal(k, k), "direct")
    assert_allclose(found.conductance, np.sqrt(contrast), rtol=1e-9)
    assert found.upper > 2 * found.lower


def test_more_permeable_elements_leak_more():
    mesh, left, right, *_ = square(6, triangles=True)
    rng = np.random.default_rng(2)
    k, angle = np.exp(rng.normal(0, 2, (2, mesh.nelements))), rng.uniform(0, np.pi, mesh.nelements)
    wider = np.where(np.arange(mesh.nelements) % 2, 1.0, 1.5)
    one, more = (solved(mesh, left, right, turned(*ks, angle)) for ks in (k, k * wider))
    assert one.lower < more.lower < 1.5 * one.lower
    assert one.upper < more.upper < 1.5 * one.upper


def test_a_number_is_the_permeability_of_an_isotropic_film_and_other_shapes_are_refused():
    basis = Basis(MeshTri().refined(2), ElementTriP1())
    unit = np.eye(2)[:, :, None, None] * np.ones(basis.dx.shape)
    expected = forms.darcy_flow.assemble(basis, k=3 * unit).toarray()
    assert "(K ∇p)·∇q" in forms.darcy_flow.__doc__
    for k in (3.0, 3 * np.ones(basis.dx.shape), 3 * np.eye(2)):
        assert_allclose(forms.darcy_flow.assemble(basis, k=k).toarray(), expected, atol=1e-15)
    for k in (np.ones((3, *basis.dx.shape)), np.ones((2, *basis.dx.shape))):
        with pytest.raises(InputError, match=r"^k: given shape \(.*expected a number"):
            forms.darcy_flow.assemble(basis, k=k)
