"""Flow of a gas with slip: the resolved flow, networks whose permeability depends on pressure, and all studies."""

from dataclasses import dataclass, replace

import numpy as np
import pytest
import scipy.sparse as sp
from numpy.testing import assert_allclose
from scipy.integrate import solve_ivp
from scipy.optimize import root
from scipy.sparse.linalg import spsolve
from skfem import MeshQuad
from small_cases import scene_of_fluid

import femseal as fs
from femseal.face.piece_flow import FlowSettings, piece_permeability
from femseal.flow import CubicLaw
from femseal.flow.coefficient import gap_on_links
from femseal.flow.law import FlowLaw
from femseal.flow.permeability_table import PermeabilityTable, PressureCurve, table_pressures
from femseal.flow.pressure_drop import PressureDrop
from femseal.preparation.preparation import prepare
from femseal.rarefied import flow_rate
from femseal.report.case_text import case_sentences
from femseal.results.dataset import RunFacts, assemble
from femseal.runs.forecast import describe
from femseal.studies.face_flow import resolved_flow

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


def mean_factor(gap, inlet, outlet):
    """Mean of F over p²: ∫ F 2p dp/(p_in² − p_out²), by the midpoint rule in ln p."""
    edges = np.geomspace(max(outlet, 1e-6 * inlet), inlet, 200_001)
    p = np.sqrt(edges[1:] * edges[:-1])
    return (HELIUM.flow_factor(gap, p) * np.diff(edges**2)).sum() / (inlet**2 - outlet**2)


def table(gaps, inlet, outlet):
    """Table of the permeability of plates at gaps (k1, k2), or one array."""
    p = table_pressures(inlet, outlet)

    def k(h):
        h = np.asarray(h)
        return np.array(
            [
                np.where(h > 0, h**3 / 12 * HELIUM.flow_factor(np.where(h > 0, h, 1.0), q), 0.0)
                for q in p
            ]
        )

    return PermeabilityTable(tuple(p), tuple(map(k, gaps)) if isinstance(gaps, tuple) else k(gaps))


@pytest.mark.parametrize(("inlet", "outlet"), ENDS)
@pytest.mark.parametrize("gap", [1e-8, 1e-6, 1e-5])
def test_parallel_plates(gap, inlet, outlet):
    flow = resolved_flow(np.full((8, 4), gap), (1e-6, 1e-6), settings(inlet, outlet))
    assert_allclose(flow.permeability, gap**3 / 12 * mean_factor(gap, inlet, outlet), rtol=1e-5)


@pytest.mark.parametrize(("inlet", "outlet"), [(1e6, 1e5), (1e5, 1e3)])
def test_waves_across_the_flow_against_an_ordinary_differential_equation(inlet, outlet):
    n, length = 128, 128e-6

    def gap(x):
        return 1e-7 * (1 + 0.7 * np.cos(2 * np.pi * x))

    x = (np.arange(n) + 0.5) / n
    flow = resolved_flow(
        np.repeat(gap(x)[:, None], 3, axis=1),
        (length / n, 1e-6),
        settings(inlet, outlet),
        with_potential=True,
    )
    rate = flow.permeability * (inlet**2 - outlet**2)

    def slope(x, square):
        p = np.sqrt(max(square[0], 1.0))
        return [-rate / (gap(x) ** 3 / 12 * float(HELIUM.flow_factor(gap(x), p)))]

    along = solve_ivp(
        slope, (0, 1), [inlet**2], rtol=1e-8, atol=1e-2, max_step=0.02, t_eval=[*x, 1.0]
    ).y[0]
    assert_allclose(along[-1], outlet**2, atol=3e-4 * inlet**2)
    share = (along[:-1] - outlet**2) / (inlet**2 - outlet**2)
    assert_allclose(flow.potential[:, 0], share, atol=1e-3)


def nonlinear_flow(gap, inlet, outlet):
    """Flow along x1 for squares of pixels, periodic along x2, with the flow factor at the mean of the pressures of each
    link: Picard's iteration in p² on scipy's direct solver."""
    n1, n2 = gap.shape
    h1, h2 = gap_on_links(gap, False, True)
    node = np.arange(n1 * n2).reshape(n1, n2)
    first = np.r_[np.full(n2, -1), node.ravel(), node.ravel()]
    second = np.r_[node.ravel(), np.full(n2, -2), np.roll(node, -1, axis=1).ravel()]
    second = np.r_[
        node[0], np.r_[node[1:].ravel(), np.full(n2, -2)], np.roll(node, -1, axis=1).ravel()
    ]
    length = np.r_[
        np.full(n2, 0.5), np.full((n1 - 1) * n2, 1.0), np.full(n2, 0.5), np.full(n1 * n2, 1.0)
    ]
    h = np.r_[h1.ravel(), h2.ravel()]
    keep = h > 0
    first, second, length, h = first[keep], second[keep], length[keep], h[keep]
    square = np.full(n1 * n2 + 2, (inlet**2 + outlet**2) / 2)
    square[-1], square[-2] = inlet**2, outlet**2
    free = np.unique(np.r_[first, second])
    free = free[free >= 0]
    for _ in range(200):
        p = (np.sqrt(square[first]) + np.sqrt(square[second])) / 2
        c = h**3 / 12 * HELIUM.flow_factor(h, p) / length
        i, j = np.r_[first, second, first, second], np.r_[first, second, second, first]
        size = n1 * n2 + 2
        matrix = sp.csr_array((np.r_[c, c, -c, -c], (i % size, j % size)), shape=(size, size))
        new = square.copy()
        new[free] = spsolve(
            matrix[free][:, free].tocsc(),
            -(matrix[free][:, [size - 1, size - 2]] @ square[[-1, -2]]),
        )
        change = np.abs(new - square).max() / inlet**2
        square = new
        if change < 1e-9:
            break
    into = first == -1
    return (c[into] * (square[-1] - square[second[into]])).sum() / (inlet**2 - outlet**2) * n1 / n2


@pytest.mark.parametrize(("inlet", "outlet"), [(1e6, 1e5), (1e5, 1e3)])
def test_rough_gap_against_an_independent_nonlinear_solution(inlet, outlet):
    heights = fs.self_affine(
        (32, 32), (32e-6, 32e-6), hurst=0.8, rms_slope=0.1, cut_off=16e-6, rng=3
    ).heights
    gap = np.maximum(heights + 0.6 * heights.std(), 0.0)
    assert 0.1 < (gap == 0).mean() < 0.4
    flow = resolved_flow(gap, (1e-6, 1e-6), settings(inlet, outlet))
    # the flow factor is interpolated between pixels with the gap, there it is that of the interpolated gap
    assert_allclose(flow.permeability, nonlinear_flow(gap, inlet, outlet), rtol=0.01)
    viscous = resolved_flow(gap, (1e-6, 1e-6))
    assert flow.permeability > 1.2 * viscous.permeability


def test_limits_of_the_resolved_flow():
    """A gas of high pressure in a wide gap is viscous; that of free molecules depends on the drop of pressure alone."""
    gap = 1e-6 * (1.5 + np.cos(np.arange(24) / 4)[:, None] * np.cos(np.arange(16) / 3))
    high, low = ((p * 2.0, p) for p in (1e12, 1e-6))
    viscous = resolved_flow(gap, (1e-6, 1e-6)).permeability
    assert_allclose(
        resolved_flow(gap, (1e-6, 1e-6), settings(*high)).permeability, viscous, rtol=1e-6
    )
    # mass rate over the drop of pressure, at two levels: the logarithm of Q(D) is all that is left of the pressure
    first, second = (
        resolved_flow(gap, (1e-6, 1e-6), settings(level * 2.0, level)).permeability * 3 * level
        for level in (1e-6, 1e-8)
    )
    d = HELIUM.law.inverse_knudsen(1e-6, 1.5e-6)
    assert_allclose(second / first, flow_rate(d / 100) / flow_rate(d), rtol=0.01)
    assert low[0] > low[1]


def test_what_does_not_slip_is_solved_as_ever():
    gap = np.maximum(np.random.default_rng(0).standard_normal((16, 16)) + 1, 0) * 1e-6
    still = replace(HELIUM, slip=False)
    assert (
        PressureDrop(still, 1e6, 1e5).law
        == PressureDrop(fs.Liquid(1e-3), 1e6, 1e5).law
        == CubicLaw()
    )
    assert PressureDrop(still, 1e6, 1e5).pressures.tolist() == [1e6]
    expected = fs.cell_permeability(gap, (1e-6, 1e-6), sides="periodic").value
    assert resolved_flow(gap, (1e-6, 1e-6), settings(1e6, 1e5, still)).permeability == expected
    # a gas whose factor is 1 to six digits everywhere
    assert resolved_flow(gap + 1.0, (1e-6, 1e-6), settings(1e9, 5e8)).solvers.systems[0][1] == 1


def test_a_closed_gap_stays_closed():
    gap = np.full((8, 8), 1e-6)
    gap[3] = 0
    flow = resolved_flow(gap, (1e-6, 1e-6), settings(1e6, 1e5), with_potential=True)
    assert flow.permeability == 0
    assert piece_permeability(gap, (1e-6, 1e-6), 0, settings(1e6, 1e5)).k.tolist() == [0.0] * 4


@pytest.mark.parametrize(("inlet", "outlet"), ENDS)
def test_network_of_one_link(inlet, outlet):
    for gap in (1e-8, 3e-7, 1e-5):
        found = fs.seal_leakage(
            fs.RectangularSeal((1e-3, 2e-3), (1, 1)),
            table(gap, inlet, outlet),
            HELIUM,
            inlet_pressure=inlet,
            outlet_pressure=outlet,
        )
        assert_allclose(
            found.conductance, 2 * gap**3 / 12 * mean_factor(gap, inlet, outlet), rtol=5e-3
        )


@pytest.mark.parametrize(("inlet", "outlet"), ENDS)
def test_network_against_the_balance_of_its_own_potentials(inlet, outlet):
    """Unknown pressures of a small random network; the potential of each link by quadrature of its own flow factor."""
    rng = np.random.default_rng(5)
    n1, n2 = 3, 4
    h1, h2 = (1e-7 * np.exp(rng.standard_normal(shape)) for shape in ((n1, n2), (n1 - 1, n2)))
    seal = fs.RectangularSeal((3e-4, 4e-4), (n1, n2))
    found = fs.seal_leakage(
        seal, table((h1, h2), inlet, outlet), HELIUM, inlet_pressure=inlet, outlet_pressure=outlet
    )
    x, w = np.polynomial.legendre.leggauss(40)

    def flow(h, first, second):
        """∫ (h³/12) F 2p dp, in √ of the distance from the lower pressure."""
        low, high = np.minimum(first, second), np.maximum(first, second)
        t = 0.5 * (1 + x)
        p = np.maximum(low[..., None] + (high - low)[..., None] * t**2, 1e-9 * inlet)
        total = (HELIUM.flow_factor(h[..., None], p) * p * t * w).sum(axis=-1) * 2 * (high - low)
        return h**3 / 12 * total * np.sign(first - second)

    def excess(inner):
        p = np.vstack([np.full(n2, inlet), np.abs(inner).reshape(n1 - 1, n2), np.full(n2, outlet)])
        q1, q2 = flow(h1, p[:-1], p[1:]), flow(h2, p[1:-1], np.roll(p[1:-1], -1, axis=1))
        return (np.diff(q1, axis=0) + q2 - np.roll(q2, 1, axis=1)).ravel() / (
            h1**3
        ).max() / inlet**2, q1

    solved = root(
        lambda inner: excess(inner)[0] * 1e6, found.fluid_pressure[1:-1].ravel(), tol=1e-13
    )
    q1 = excess(solved.x)[1]
    assert_allclose(q1[0].sum(), q1[-1].sum(), rtol=1e-5)
    assert_allclose(found.conductance * (inlet**2 - outlet**2), q1[0].sum(), rtol=3e-3)
    assert_allclose(found.fluid_pressure[1:-1].ravel(), np.abs(solved.x), atol=3e-3 * inlet)
    # the local permeabilities have the same flow in the viscous potential
    φ = found.fluid_pressure**2
    k1, k2 = found.permeability
    q1, q2 = k1 * -np.diff(φ, axis=0), k2 * (φ[1:-1] - np.roll(φ[1:-1], -1, axis=1))
    balance = np.diff(q1, axis=0) + q2 - np.roll(q2, 1, axis=1)
    assert np.abs(balance).max() < 2e-3 * q1.max()
    assert_allclose(q1[0].sum(), found.conductance * (inlet**2 - outlet**2), rtol=2e-3)


def test_a_constant_permeability_in_a_table_changes_nothing():
    k1, k2 = (
        np.random.default_rng(1).random((4, 5)) * 1e-18,
        np.random.default_rng(2).random((3, 5)) * 1e-18,
    )
    k1[2, 1] = 0
    constant = PermeabilityTable((1e6, 3e5, 1e5), (np.array([k1] * 3), np.array([k2] * 3)))
    seal = fs.RectangularSeal((1e-3, 1e-3), (4, 5))
    for fluid in (replace(HELIUM, slip=False), fs.Liquid(1e-3), HELIUM):
        plain, tabled = (
            fs.seal_leakage(seal, k, fluid, inlet_pressure=1e6, outlet_pressure=1e5, bounds=True)
            for k in ((k1, k2), constant)
        )
        assert_allclose(tabled.mass_rate, plain.mass_rate, rtol=2e-4)
        assert_allclose((tabled.lower, tabled.upper), (plain.lower, plain.upper), rtol=2e-4)
        assert_allclose(tabled.fluid_pressure, plain.fluid_pressure, rtol=2e-4)


def test_meshes_and_links_agree():
    inlet, outlet = 1e6, 1e5
    mesh = MeshQuad.init_tensor(np.linspace(0, 1e-3, 9), np.linspace(0, 2e-3, 7)).with_boundaries(
        {"in": lambda x: x[0] == 0, "out": lambda x: x[0] > 0.9999e-3}
    )
    numbers = table(1e-7, inlet, outlet)
    n = mesh.nelements
    of_elements = PermeabilityTable(
        numbers.pressures, np.repeat(numbers.values[:, None], n, axis=1)
    )
    seals = {
        "mesh": fs.MeshSeal(mesh, "in", "out"),
        "strip": fs.RectangularSeal((1e-3, 2e-3), (8, 6)),
    }
    rates = [
        fs.seal_leakage(
            seals[name], k, HELIUM, inlet_pressure=inlet, outlet_pressure=outlet
        ).mass_rate
        for name, k in (
            ("mesh", numbers),
            ("mesh", of_elements),
            (
                "mesh",
                PermeabilityTable(
                    numbers.pressures, np.repeat(of_elements.values[..., None], 2, axis=2)
                ),
            ),
            ("strip", numbers),
            ("strip", table((np.full((8, 6), 1e-7), np.full((7, 6), 1e-7)), inlet, outlet)),
        )
    ]
    assert_allclose(rates, rates[-1], rtol=5e-3)


def test_the_law_of_a_cell():
    gap = np.maximum(np.random.default_rng(3).standard_normal((12, 9)) + 1.5, 0) * 1e-7
    for axis in (0, 1):
        plain = fs.cell_permeability(gap, (1e-6, 2e-6), axis=axis, bounds=True)
        twice = fs.cell_permeability(gap, (1e-6, 2e-6), axis=axis, bounds=True, law=Twice())
        assert_allclose(
            (twice.value, twice.lower, twice.upper),
            2 * np.array([plain.value, plain.lower, plain.upper]),
            rtol=1e-9,
        )
        # F of every pixel: the bounds are those of pixels of constant permeability
        gas = fs.cell_permeability(
            gap, (1e-6, 2e-6), axis=axis, bounds=True, law=HELIUM.law, pressure=1e5
        )
        assert gas.lower > 5 * plain.upper
    for bad in (np.ones(3), -1.0, np.nan, None):
        with pytest.raises(fs.InputError, match=r"^pressure: given"):
            fs.cell_permeability(gap, (1e-6, 1e-6), law=HELIUM.law, pressure=bad)
    for bad in (HELIUM, Twice(-1.0)):
        with pytest.raises(fs.InputError, match=r"^law: given"):
            fs.cell_permeability(gap, (1e-6, 1e-6), law=bad)


@pytest.mark.parametrize("shape", [(3, 8, 6), (3, 5), (3, 6, 6)])
def test_tables_of_other_shapes_than_the_seal(shape):
    seal = fs.RectangularSeal((1e-3, 2e-3), (7, 6))
    wrong = PermeabilityTable((1e6, 3e5, 1e5), (np.ones(shape), np.ones((3, 5, 6))))
    with pytest.raises(fs.InputError, match=r"^permeability: given shape"):
        fs.seal_leakage(seal, wrong, HELIUM, inlet_pressure=1e6, outlet_pressure=1e5)


@pytest.mark.parametrize(
    ("pressures", "values", "word"),
    [
        ((1e5,), np.ones(1), "pressures"),
        ((1e5, 1e5), np.ones(2), "pressures"),
        ((0.0, 1e5), np.ones(2), "pressures"),
        ((1.0, 2.0), np.ones(3), "values"),
        ((1.0, 2.0), -np.ones(2), "values"),
        ((1.0, 2.0), [np.nan, 1], "values"),
    ],
)
def test_tables_that_are_none(pressures, values, word):
    with pytest.raises(fs.InputError, match=f"^{word}: given"):
        PermeabilityTable(pressures, values)


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
    assert (np.diff(found.pieces.k[order], axis=0) < 0).all()


@pytest.mark.parametrize("breadth", [None, 128e-6])
def test_drawn_seals_of_a_gas_leak_more_by_the_flow_factor(scene, breadth):
    """At the loads of the scene, and along a ladder."""
    sampling = fs.Sampling(length=0.5e-3, realisations=3, seed=1, breadth=breadth)
    viscous = replace(scene, fluid=replace(HELIUM, slip=False))
    found, still = (fs.stochastic(s, (2, 4), sampling) for s in (scene, viscous))
    whole, plain = fs.deterministic(scene), fs.deterministic(viscous)
    ratio = found.leakage / still.leakage
    assert (ratio > 1).all()
    expected = whole.leakage / plain.leakage
    assert_allclose(np.log(np.median(ratio, axis=0)) / np.log(expected), 1, atol=0.6)


@pytest.fixture(scope="module")
def equal(scene):
    """A face of four equal columns, without what the fluid does to the contact."""
    surface = fs.Topography(np.tile(scene.surface.heights[:, :32], (1, 4)), scene.surface.spacing)
    return replace(scene, surface=surface.low_pass(8e-6), fluid_pressure="ignored")


def test_a_drawn_gas_is_the_face_where_its_columns_are_equal(equal):
    """Seals as broad as the face leak with slip what it leaks, all of its columns being the same."""
    whole = fs.deterministic(equal)
    drawn = fs.stochastic(equal, (2, 4), fs.Sampling(length=0.5e-3, realisations=2, seed=1))
    assert_allclose(drawn.leakage, np.tile(whole.leakage, (2, 1)), rtol=1e-3)
    assert drawn.pieces.k.shape[0] == len(table_pressures(1e6, 1e5))


@pytest.mark.parametrize(("inlet", "outlet"), [(1e6, 1e5), (1e5, 1e3)])
def test_a_drawn_gas_through_faces_in_series(scene, inlet, outlet):
    """The pressure falls over several faces of equal pieces, which go on periodically, as over one of them.

    Elements have one pressure each: the two rows of the face by itself, to which its factor belongs, miss .1 to .5 % of
    the flow, more rows less.
    """
    piece = fs.self_affine(
        (32, 32), (32e-6,) * 2, hurst=0.8, rms_slope=0.1, roll_off=16e-6, cut_off=8e-6, rng=1
    )
    surface = fs.Topography(np.tile(piece.heights, (2, 3)), piece.spacing, (True, True))
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


def test_a_helium_test_from_case_to_report(tmp_path):
    """The fluid by its name, through forecast, run and report; without slip it leaks less."""
    face = 'kind = "self-affine"\npoints = [48, 64]\nsize = ["48 um", "64 um"]\nhurst = 0.8\nrms_slope = 0.1'
    text = (
        f'title = "helium"\nmethod = "deterministic"\n[face]\n{face}\n[material]\nyoung = "210 GPa"\nhardness = "3 GPa"\n'
        '[load]\nloading = ["50 MPa", "300 MPa"]\n[fluid]\nname = "helium"\ninlet_pressure = "10 bar"\n{slip}'
    )
    leakage = {}
    for slip in ("", "slip = false\n"):
        path = tmp_path / f"case{len(slip)}.toml"
        path.write_text(text.replace("{slip}", slip), encoding="utf-8")
        case = fs.load_case(path)
        told = "\n".join(describe(case, prepare(case)))
        assert ("times the viscous flow in a gap of the rms height" in told) == (slip == "")
        study = fs.deterministic(prepare(case).scene)
        leakage[slip] = study.leakage
        words = " ".join(
            case_sentences(assemble(prepare(case).scene, study, facts=RunFacts(case=case.echo())))
        )
        assert (
            "helium, an ideal gas of viscosity 19.62 µPa·s and molar mass 4.0026 g/mol at 20 °C"
            in words
        )
        assert f", with{'out' if slip else ''} slip" in words
        assert "The solids: E = 210 GPa, ν = 0.3, hardness 3 GPa against a rigid flat." in words
    assert (leakage[""] > 1.1 * leakage["slip = false\n"]).all()


@pytest.mark.parametrize(("inlet", "outlet"), [(1e6, 1e5), (1e5, 0.0)])
def test_one_pressure_in_a_window_is_near_to_its_own(inlet, outlet):
    """k(p) of a face with the pressure uniform in it, over the whole drop; 36 gaps of 128² pixels: 0.057 at most."""
    heights = fs.self_affine(
        (48, 48), (48e-6, 48e-6), hurst=0.8, rms_slope=0.1, cut_off=8e-6, rng=1
    ).heights
    gap = 0.3 * np.maximum(heights + heights.std(), 0.0)
    whole = resolved_flow(gap, (1e-6, 1e-6), settings(inlet, outlet)).permeability
    p = table_pressures(inlet, outlet)
    k = [
        fs.cell_permeability(gap, (1e-6, 1e-6), sides="periodic", law=HELIUM.law, pressure=q).value
        for q in p
    ]
    found = fs.seal_leakage(
        fs.RectangularSeal((1.0, 1.0), (1, 1)),
        PermeabilityTable(tuple(p), np.array(k)),
        HELIUM,
        inlet_pressure=inlet,
        outlet_pressure=outlet,
    )
    assert_allclose(found.conductance, whole, rtol=0.05)
    assert abs(found.conductance / whole - 1) > 1e-5


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
        found = curve.between(at, at, drop.mobility) * HELIUM.flow_factor(1e-7, inside)
        assert_allclose(found[0], principal(inside), rtol=5e-3)
        assert (found[1] == 0).all()
