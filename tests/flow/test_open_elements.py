"""Flow through elements that are all open: closed forms, duality of both bounds, and the general solver."""

import numpy as np
import pytest
from numpy.testing import assert_allclose
from skfem import MeshQuad, MeshTri

from femseal.flow.mesh import darcy_conductance
from femseal.flow.open_elements import OpenElements
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
    return k1[:, None, None] * axis[:, :, None] * axis[:, None] + k2[:, None, None] * other[:, :, None] * other[:, None]


@pytest.mark.parametrize("spread", [0.5, 4.0])
@pytest.mark.parametrize("kind", ["quads", "triangles", "periodic"])
def test_values_and_bounds_are_those_of_the_general_solver(kind, spread):
    rng = np.random.default_rng(3)
    if kind == "periodic":
        seal = face_tiles((3.0, 4.0), (5, 7)).seal
        mesh, inlet, outlet = seal.mesh, seal.inlet, seal.outlet
    else:
        mesh, inlet, outlet, *_ = square(6, kind == "triangles")
    k = 1e-19 * np.exp(spread * rng.standard_normal((2, mesh.nelements)))
    tensor = turned(*k, rng.uniform(0, np.pi, mesh.nelements))
    found = OpenElements(mesh, inlet, outlet).flow(tensor)
    whole = darcy_conductance(mesh, tensor, inlet, outlet, bounds=True)
    assert_allclose([found.lower, found.upper], [whole.lower, whole.upper], rtol=2e-6)
    assert_allclose(found.conductance, np.sqrt(whole.lower * whole.upper), rtol=2e-6)
    assert found.lower < found.upper
    assert_allclose(found.potential, whole.potential, atol=1e-4)


@pytest.mark.parametrize("contrast", [1.0, 1e3, 1e10])
def test_the_bounds_of_a_square_and_of_its_dual_are_inverse(contrast):
    """The flux of one solution is the stream function, a potential, of the other: k⁻¹ along the other axis."""
    mesh, left, right, bottom, top = square(8)
    k1, k2 = contrast ** np.random.default_rng(1).uniform(-0.5, 0.5, (2, mesh.nelements))
    along = OpenElements(mesh, left, right).flow(diagonal(k1, k2), "direct")
    dual = OpenElements(mesh, bottom, top).flow(diagonal(1 / k2, 1 / k1), "direct")
    assert_allclose(
        [along.lower * dual.upper, along.upper * dual.lower, along.conductance * dual.conductance], 1.0, rtol=1e-9
    )


@pytest.mark.parametrize("contrast", [1e2, 1e10])
def test_a_checkerboard_has_the_root_of_the_product(contrast):
    """√(k1 k2) of two dimensions (Dykhne 1971), to the last digits by the geometric mean of both bounds."""
    mesh, left, right, *_ = square(6)
    x, y = mesh.p[:, mesh.t].mean(axis=1)
    k = np.where((np.floor(6 * x) + np.floor(6 * y)) % 2, contrast, 1.0)
    found = OpenElements(mesh, left, right).flow(diagonal(k, k), "direct")
    assert_allclose(found.conductance, np.sqrt(contrast), rtol=1e-9)
    assert found.upper > 2 * found.lower


def test_independent_tiles_have_the_mean_of_the_logarithm():
    """Of ln k that scatter symmetrically, exp⟨ln k⟩ in the median, where both bounds are off by factors."""
    mesh, left, right, *_ = square(16)
    flow, rng = OpenElements(mesh, left, right), np.random.default_rng(8)
    found = []
    for _ in range(25):
        k = np.exp(rng.normal(0, 2.0, mesh.nelements))
        one = flow.flow(diagonal(k, k))
        found.append(np.log([one.lower, one.conductance, one.upper]))
    lower, value, upper = np.median(found, axis=0)
    assert abs(value) < 3 * 1.25 * np.std(found, axis=0)[1] / 5
    assert lower < -0.2
    assert upper > 0.2


@pytest.mark.parametrize("triangles", [False, True])
def test_a_constant_tensor_is_solved_exactly(triangles):
    mesh, left, right, *_ = square(5, triangles, sides=(2.0, 3.0))
    k = 1e-20 * np.ones(mesh.nelements)
    found = OpenElements(mesh, left, right).flow(diagonal(3 * k, 1e-6 * k))
    assert_allclose([found.lower, found.conductance, found.upper], 3e-20 * 3 / 2, rtol=1e-7)
    assert_allclose(found.potential, 1 - mesh.p[0] / 2, atol=1e-4)
    assert_allclose(found.potential + found.complement, 1.0)


def test_layers_in_series_and_in_parallel_are_exact():
    mesh, left, right, bottom, top = square(6)
    layer = np.floor(6 * mesh.p[0, mesh.t].mean(axis=0)).astype(int)
    k = 10.0 ** np.array([0, -3, 5, 1, -8, 2])
    along = OpenElements(mesh, left, right).flow(diagonal(k[layer], k[layer]), "direct")
    across = OpenElements(mesh, bottom, top).flow(diagonal(k[layer], k[layer]), "direct")
    assert_allclose([along.lower, along.upper], 1 / np.mean(1 / k), rtol=1e-9)
    assert_allclose([across.lower, across.upper], np.mean(k), rtol=1e-9)


def test_more_permeable_elements_leak_more_and_all_scale_together():
    mesh, left, right, *_ = square(6, triangles=True)
    flow, rng = OpenElements(mesh, left, right), np.random.default_rng(2)
    k = np.exp(rng.normal(0, 2, (2, mesh.nelements)))
    angle = rng.uniform(0, np.pi, mesh.nelements)
    one = flow.flow(turned(*k, angle))
    more = flow.flow(turned(*(k * np.where(np.arange(mesh.nelements) % 2, 1.0, 1.5)), angle))
    assert one.lower < more.lower < 1.5 * one.lower
    assert one.upper < more.upper < 1.5 * one.upper
    scaled = flow.flow(turned(*(1e-22 * k), angle))
    assert_allclose(scaled.conductance, 1e-22 * one.conductance, rtol=1e-7)
    turned_round = OpenElements(mesh, right, left).flow(turned(*k, angle))
    assert_allclose(turned_round.conductance, one.conductance, rtol=1e-6)
