"""Flow of a gas with slip: the resolved flow, networks whose permeability depends on pressure, and all studies."""

from dataclasses import dataclass, replace

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.optimize import root
from skfem import MeshQuad
from small_cases import scene_of_fluid

import femseal as fs
from femseal.face.cell_flow import FlowSettings, cell_permeabilities, solve_surface_flow
from femseal.flow import CubicLaw, FlowLaw, mesh
from femseal.flow.grid import gap_on_links
from femseal.flow.law import flow_rate
from femseal.flow.permeability_table import PermeabilityTable, PressureCurve, table_pressures
from femseal.flow.pressure_drop import PressureDrop

HELIUM = fs.IdealGas(viscosity=19.6e-6, molar_mass=4.0026e-3, temperature=293.15)
ENDS = [(1e6, 1e5), (1e5, 0.0), (1e7, 1e5)]


@dataclass(frozen=True)
class Twice(FlowLaw):
    """Twice as much as by the cubic law."""

    times: float = 2.0

    def factor(self, gap, pressure=0.0):
        return np.full(np.shape(gap), self.times)


def settings(inlet, outlet, gas=HELIUM):
    return FlowSettings(drop=PressureDrop(gas, inlet, outlet))


def rough_gap(n):
    """In contact on a part."""
    heights = fs.self_affine(
        (n, n), (n * 1e-6, n * 1e-6), hurst=0.8, rms_slope=0.1, cut_off=n / 2 * 1e-6, rng=3
    ).heights
    return np.maximum(heights + 0.6 * heights.std(), 0.0)


def mean_factor(gap, inlet, outlet):
    """Mean of F over p²: ∫ F 2p dp/(p_in² − p_out²), by the midpoint rule in ln p."""
    edges = np.geomspace(max(outlet, 1e-6 * inlet), inlet, 200_001)
    p = np.sqrt(edges[1:] * edges[:-1])
    return (HELIUM.flow_factor(gap, p) * np.diff(edges**2)).sum() / (inlet**2 - outlet**2)


def table(gaps, inlet, outlet):
    """Table of the permeability of plates at gaps."""
    p = table_pressures(inlet, outlet)
    k = [np.asarray(gaps) ** 3 / 12 * HELIUM.flow_factor(gaps, q) for q in p]
    return PermeabilityTable(tuple(p), np.array(k))


@pytest.mark.parametrize(("inlet", "outlet"), ENDS)
@pytest.mark.parametrize("gap", [1e-8, 1e-6, 1e-5])
def test_parallel_plates(gap, inlet, outlet):
    flow = solve_surface_flow(np.full((8, 4), gap), (1e-6, 1e-6), settings(inlet, outlet))
    assert_allclose(flow.permeability, gap**3 / 12 * mean_factor(gap, inlet, outlet), rtol=1e-5)


def nonlinear_flow(gap, inlet, outlet):
    """Flow along x1 for squares of pixels, periodic along x2, with the flow factor at the mean of the pressures of each
    link: Picard's iteration in p² on dense matrices."""
    n1, n2 = gap.shape
    h1, h2 = gap_on_links(gap, False, True)
    node = np.arange((n1 + 2) * n2).reshape(n1 + 2, n2)
    first = np.r_[node[:-1].ravel(), node[1:-1].ravel()]
    second = np.r_[node[1:].ravel(), np.roll(node[1:-1], -1, axis=1).ravel()]
    length = np.ones_like(h1)
    length[[0, -1]] = 0.5
    h, length = np.r_[h1.ravel(), h2.ravel()], np.r_[length.ravel(), np.ones(h2.size)]
    keep = h > 0
    first, second, h, length = first[keep], second[keep], h[keep], length[keep]
    square = np.repeat([inlet**2, (inlet**2 + outlet**2) / 2, outlet**2], [n2, n1 * n2, n2])
    free = np.intersect1d(np.r_[first, second], node[1:-1])
    for _ in range(60):
        p = (np.sqrt(square[first]) + np.sqrt(square[second])) / 2
        c = h**3 / 12 * HELIUM.flow_factor(h, p) / length
        drops = np.zeros((c.size, node.size))
        drops[np.arange(c.size), first], drops[np.arange(c.size), second] = 1, -1
        matrix = drops.T @ (c[:, None] * drops)
        known = np.setdiff1d(node, free)
        rhs = -matrix[np.ix_(free, known)] @ square[known]
        square[free] = np.linalg.lstsq(matrix[np.ix_(free, free)], rhs, rcond=None)[0]
    return (matrix @ square)[node[0]].sum() / (inlet**2 - outlet**2) * n1 / n2


@pytest.mark.parametrize(("inlet", "outlet"), [(1e6, 1e5), (1e5, 1e3)])
def test_rough_gap_against_an_independent_nonlinear_solution(inlet, outlet):
    gap = rough_gap(20)
    flow = solve_surface_flow(gap, (1e-6, 1e-6), settings(inlet, outlet))
    # the flow factor is interpolated between pixels with the gap, there it is that of the interpolated gap
    assert_allclose(flow.permeability, nonlinear_flow(gap, inlet, outlet), rtol=0.01)
    viscous = solve_surface_flow(gap, (1e-6, 1e-6))
    assert flow.permeability > 1.2 * viscous.permeability


def test_limits_of_the_resolved_flow():
    """A gas of high pressure in a wide gap is viscous; that of free molecules depends on the drop of pressure alone."""
    gap = 1e-6 * (1.5 + np.cos(np.arange(24) / 4)[:, None] * np.cos(np.arange(16) / 3))
    high, low = ((p * 2.0, p) for p in (1e12, 1e-6))
    viscous = solve_surface_flow(gap, (1e-6, 1e-6)).permeability
    assert_allclose(
        solve_surface_flow(gap, (1e-6, 1e-6), settings(*high)).permeability, viscous, rtol=1e-6
    )
    # mass rate over the drop of pressure, at two levels: the logarithm of Q(D) is all that is left of the pressure
    first, second = (
        solve_surface_flow(gap, (1e-6, 1e-6), settings(level * 2.0, level)).permeability * 3 * level
        for level in (1e-6, 1e-8)
    )
    d = HELIUM.law.inverse_knudsen(1e-6, 1.5e-6)
    assert_allclose(second / first, flow_rate(d / 100) / flow_rate(d), rtol=0.01)
    assert low[0] > low[1]


def test_what_does_not_slip_is_solved_as_ever():
    gap = rough_gap(16)
    still = replace(HELIUM, slip=False)
    expected = fs.cell_permeability(gap, (1e-6, 1e-6), sides="periodic").value
    assert solve_surface_flow(gap, (1e-6, 1e-6), settings(1e6, 1e5, still)).permeability == expected


def test_a_closed_gap_stays_closed():
    gap = np.full((8, 8), 1e-6)
    gap[3] = 0
    flow = solve_surface_flow(gap, (1e-6, 1e-6), settings(1e6, 1e5))
    assert flow.permeability == 0
    assert cell_permeabilities(gap, (1e-6, 1e-6), 0, settings(1e6, 1e5)).k.tolist() == [0.0] * 4


@pytest.mark.parametrize(("inlet", "outlet"), ENDS)
def test_rows_in_series_against_the_balance_of_their_own_potentials(inlet, outlet):
    """Unknown pressures between rows of one gap each; the potential of a row by quadrature of its own flow factor."""
    h = 1e-7 * np.exp(np.random.default_rng(5).standard_normal(4))
    seal = fs.RectangularSeal((4e-4, 3e-4), (4, 3))
    ends = {"inlet_pressure": inlet, "outlet_pressure": outlet}
    gaps = np.repeat(h[:, None], 3, axis=1)
    found = fs.seal_leakage(seal, table(gaps, inlet, outlet), HELIUM, **ends)
    x, w = np.polynomial.legendre.leggauss(40)
    t = 0.5 * (1 + x)

    def flows(inner):
        """∫ (h³/12) F 2p dp of every row, in √ of the distance from the lower pressure."""
        p = np.concatenate([[inlet], np.abs(inner), [outlet]])
        first, second = p[:-1, None], p[1:, None]
        low, drop = np.minimum(first, second), first - second
        p = np.maximum(low + np.abs(drop) * t**2, 1e-9 * inlet)
        factor = HELIUM.flow_factor(h[:, None], p)
        return (h[:, None] ** 3 / 12 * factor * p * t * w * 2 * drop).sum(axis=1)

    scale = (h**3).max() * inlet**2 * 1e-6
    start = found.fluid_pressure[1:-1, 0]
    inner = np.abs(root(lambda inner: np.diff(flows(inner)) / scale, start, tol=1e-13).x)
    rate = found.conductance * (inlet**2 - outlet**2)
    assert_allclose(rate, 3 * flows(inner).mean(), rtol=3e-3)
    assert_allclose(start, inner, atol=3e-3 * inlet)


@pytest.mark.parametrize(("inlet", "outlet"), ENDS)
def test_the_permeability_of_the_solution_has_its_flow_in_the_viscous_potential(inlet, outlet):
    rng = np.random.default_rng(6)
    seal = fs.RectangularSeal((3e-4, 4e-4), (6, 8))
    gaps = 1e-7 * np.exp(0.5 * rng.standard_normal((6, 8)))
    ends = {"inlet_pressure": inlet, "outlet_pressure": outlet}
    found = fs.seal_leakage(seal, table(gaps, inlet, outlet), HELIUM, **ends)
    again = seal.flow(found.permeability)
    assert_allclose(again.conductance, found.conductance, rtol=0.02)
    p = np.sqrt(outlet**2 + (inlet**2 - outlet**2) * again.potential)
    assert_allclose(p, found.fluid_pressure, atol=0.02 * inlet)


@pytest.mark.parametrize(("inlet", "outlet"), ENDS)
def test_strips_and_meshes_agree(inlet, outlet):
    """With the mean of F over p²."""
    mesh = MeshQuad.init_tensor(np.linspace(0, 1e-3, 9), np.linspace(0, 2e-3, 7)).with_boundaries(
        {"in": lambda x: x[0] == 0, "out": lambda x: x[0] > 0.9999e-3}
    )
    number = table(1e-7, inlet, outlet)
    tensor = np.full((mesh.nelements, 2), 1e-7)
    on_mesh, strip = fs.MeshSeal(mesh, "in", "out"), fs.RectangularSeal((1e-3, 2e-3), (8, 6))
    for seal, k in (
        (on_mesh, number),
        (on_mesh, table(tensor[:, 0], inlet, outlet)),
        (on_mesh, table(tensor, inlet, outlet)),
        (strip, number),
        (strip, table(np.full((8, 6), 1e-7), inlet, outlet)),
        (strip, table(np.full((8, 6, 2), 1e-7), inlet, outlet)),
    ):
        found = fs.seal_leakage(seal, k, HELIUM, inlet_pressure=inlet, outlet_pressure=outlet)
        exact = 2 * 1e-21 / 12 * mean_factor(1e-7, inlet, outlet)
        assert_allclose(found.conductance, exact, rtol=5e-3)


def test_all_iterations_on_a_mesh_use_the_same_element_matrices(monkeypatch):
    square = (
        MeshQuad()
        .refined(2)
        .with_boundaries({"in": lambda x: x[0] == 0, "out": lambda x: x[0] == 1})
    )
    seal = fs.MeshSeal(square, "in", "out")
    flows = []
    assemblies = []

    def counted(function, calls):
        def call(*arguments, **options):
            calls.append(arguments)
            return function(*arguments, **options)

        return call

    monkeypatch.setattr(mesh, "_local_matrices", counted(mesh._local_matrices, assemblies))
    monkeypatch.setattr(mesh.MeshOperators, "flow", counted(mesh.MeshOperators.flow, flows))
    gaps = 1e-7 * np.exp(np.random.default_rng(7).standard_normal(seal.mesh.nelements))
    fs.seal_leakage(seal, table(gaps, 2e5, 1e4), HELIUM, inlet_pressure=2e5, outlet_pressure=1e4)
    assert len(flows) > 2
    assert len(assemblies) == 1


def test_the_law_of_a_cell():
    gap = np.maximum(np.random.default_rng(3).standard_normal((12, 9)) + 1.5, 0) * 1e-7
    given = {"gap": gap, "spacing": (1e-6, 2e-6)}
    for axis in (0, 1):
        plain, twice, gas = (
            fs.cell_permeability(**given, axis=axis, law=law, pressure=1e5)
            for law in (CubicLaw(), Twice(), HELIUM.law)
        )
        assert_allclose(twice.value, 2 * plain.value, rtol=1e-9)
        assert gas.value > 5 * plain.value
    for bad in (np.ones(3), -1.0, np.nan, None):
        with pytest.raises(fs.InputError, match=r"^pressure: given"):
            fs.cell_permeability(**given, law=HELIUM.law, pressure=bad)
    for bad in (HELIUM, Twice(-1.0)):
        with pytest.raises(fs.InputError, match=r"^law: given"):
            fs.cell_permeability(**given, law=bad)


@pytest.fixture(scope="module")
def scene():
    return scene_of_fluid(HELIUM, 1e5)


def test_all_studies_of_a_gas(scene):
    """Each study of a gas is as near to the deterministic one as it is for the viscous gas."""
    viscous = replace(scene, fluid=replace(HELIUM, slip=False))
    whole, plain = fs.deterministic(scene), fs.deterministic(viscous)
    assert (whole.leakage > 1.1 * plain.leakage).all()
    # p² falls less steeply near the inlet than without slip
    assert np.nanmax(np.abs(whole.fluid_pressure - plain.fluid_pressure)) > 1e4
    assert np.nanmin(whole.fluid_pressure) >= 0.999e5
    found, still = (fs.two_scale(s, (2, 4)) for s in (scene, viscous))
    assert (found.leakage == whole.leakage).all()
    assert (found.k1 > 1.05 * still.k1).all()
    # at lower pressures, as near the outlet, it slips more
    order = np.argsort(scene.flow.drop.pressures)
    assert (np.diff(found.cells.k[order], axis=0) < 0).all()


@pytest.mark.parametrize(("inlet", "outlet"), [(1e6, 1e5), (1e5, 1e3)])
def test_a_drawn_gas_through_faces_in_series(scene, inlet, outlet):
    """The pressure falls over several faces of equal cells, which go on periodically, as over one of them.

    Elements have one pressure each: the two rows of the face by itself, to which its factor belongs, miss .1 to .5 % of
    the flow, more rows less.
    """
    cell = fs.self_affine(
        (32, 32), (32e-6,) * 2, hurst=0.8, rms_slope=0.1, roll_off=16e-6, cut_off=8e-6, rng=1
    )
    surface = fs.Topography(np.tile(cell.heights, (2, 3)), cell.spacing, (True, True))
    given = {"surface": surface, "boundary": ("periodic", "periodic"), "fluid_pressure": "ignored"}
    one = replace(scene, inlet_pressure=inlet, outlet_pressure=outlet, **given)
    whole = fs.deterministic(one).leakage
    times = []
    for faces in (2, 5, 10):
        breadth = faces * 64e-6
        drawn = fs.stochastic(
            one, (2, 3), fs.Sampling(96e-6, 1, seed=1, breadth=breadth, median_fields=False)
        )
        assert drawn.tiles.grid == (2 * faces, 3)
        times.append(drawn.leakage[0] * faces)
    assert_allclose(times[:2], np.tile(times[2], (2, 1)), rtol=2e-3)
    assert_allclose(times[2], whole, rtol=5e-3)


def test_principal_values_between_their_pressures():
    """Two gaps along x1 and x2 of an element: at a pressure between those of the table they have those of the gaps."""
    p, drop = table_pressures(1e6, 1e5), PressureDrop(HELIUM, 1e6, 1e5, 1e-7)
    gaps = np.array([1e-7, 3e-8])

    def principal(pressure):
        return gaps**3 / 12 * HELIUM.flow_factor(gaps, pressure)

    closed = np.zeros((len(p), 2))
    curve = PressureCurve(p, np.stack([[principal(q) for q in p], closed], axis=1))
    for inside in (1.3e5, 3e5, 8e5):
        at = np.full((2, 2), inside)
        # ∫ k dφ/∫ dψ over no drop is k/F(h₀, p)
        found = curve.mean_between(at, at, drop.mobility) * HELIUM.flow_factor(1e-7, inside)
        assert_allclose(found[0], principal(inside), rtol=5e-3)
        assert (found[1] == 0).all()
