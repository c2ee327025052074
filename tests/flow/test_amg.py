"""Algebraic multigrid against elimination and the factorisation: whatever it returns is right, and the same every time."""

import re

import numpy as np
import pytest
import scipy.sparse as sp
from networks import cell_links, network
from numpy.testing import assert_allclose, assert_array_equal
from skfem import Basis, ElementQuad1, ElementTriP1, MeshQuad, MeshTri

from femseal.base import InputError, NotConverged
from femseal.flow import Stencil, solvers
from femseal.flow.forms import darcy_flow
from femseal.flow.percolation import nodes_reached
from femseal.flow.solvers import multigrid, sparse, thresholds
from femseal.flow.solvers.amg import solve_amg
from femseal.flow.solvers.choice import solve_flow
from femseal.flow.solvers.direct import solve_direct, solve_direct_between
from femseal.flow.solvers.linear_solution import Ends
from femseal.flow.solvers.sparse import solve_between_ends, solve_spd
from femseal.topography import self_affine


def drawn_links(rng, shape, sigma, closed, periodic):
    """Network of independent log-normal conductances, of which a share is closed."""
    n1, n2 = shape
    along, across = (
        np.exp(sigma * rng.standard_normal(s)) * (rng.random(s) >= closed)
        for s in (shape, (n1 - 1, n2 if periodic else n2 - 1))
    )
    return Stencil.network(along, across, ring=bool(periodic))


def cut_gap(rng, n, contact):
    """A self-affine face cut by a plane."""
    heights = self_affine(
        (n, n), (1.0, 1.0), hurst=0.8, rms_slope=0.1, roll_off=0.5, cut_off=8 / n, rng=rng
    ).heights
    return np.maximum(heights - np.quantile(heights, contact), 0) / np.ptp(heights)


def chain(links):
    """Matrix and right-hand side of links in series between the inlet and the outlet."""
    links = np.asarray(links, float)
    matrix = sp.diags_array(
        [links[:-1] + links[1:], -links[1:-1], -links[1:-1]], offsets=[0, 1, -1]
    ).tocsr()
    return matrix, np.r_[links[0], np.zeros(len(links) - 2)]


def mesh_system(mesh, element, k):
    """Matrix and right-hand side of Darcy flow along x for a unit drop."""
    basis = Basis(mesh, element, intorder=4)
    matrix = darcy_flow.assemble(
        basis, k=np.moveaxis(k, 0, -1)[..., None] * np.ones(basis.dx.shape)
    ).tocsr()
    inlet, outlet = (
        basis.get_dofs(lambda x, at=at: np.isclose(x[0], at)).flatten() for at in (0, 1)
    )
    unknown = np.setdiff1d(np.arange(basis.N), np.concatenate([inlet, outlet]))
    return matrix[unknown][:, unknown], -np.asarray(matrix[unknown][:, inlet].sum(axis=1)).ravel()


def energy_error(matrix, rhs, x, exact):
    difference = x - exact
    return np.sqrt(difference @ (matrix @ difference) / (rhs @ (1 - exact)))


@pytest.mark.parametrize("shape", [(5, 44), (30, 17), (60, 64), (150, 170)])
@pytest.mark.parametrize("sigma", [0.3, 2.0, 5.0])
@pytest.mark.parametrize("closed", [0.0, 0.33])
@pytest.mark.parametrize("periodic", [False, True])
def test_drawn_seals_agree_with_elimination(shape, sigma, closed, periodic):
    """Standard deviations of ln k up to 5, up to a third of the links closed."""
    stencil = drawn_links(np.random.default_rng(shape), shape, sigma, closed, periodic)
    agree(stencil)


@pytest.mark.parametrize("n", [24, 40, 64])
def test_cells_agree_with_elimination(n):
    """From open to nearly closed ones, where the flow is a tiny share of what the inlet could carry."""
    rng = np.random.default_rng(n)
    for number in range(30):
        gap = cut_gap(rng, n, rng.uniform(0.02, 0.46))
        sides = ["mirror", "periodic"][number % 2]
        agree(network(*cell_links(gap, (1.0, rng.choice([0.5, 1.0])), sides)))


def agree(stencil):
    exact = solve_flow(stencil, solver="elimination")
    if exact.solver == "none":
        return
    conductance, solution = solve_by_pyamg(stencil, 10**-4.5)
    assert_allclose(conductance, exact.conductance, rtol=1e-9)
    assert solution.solver == "amg"
    assert solution.residual**2 <= 1e-9
    assert solution.iterations <= 30


def solve_by_pyamg(stencil, rtol):
    """Conductance of a network by multigrid on its assembled matrix, and the solution of that matrix."""
    matrix = stencil.to_csr()
    n2 = stencil.nodes[1]
    carries_flow = nodes_reached(stencil.along, stencil.across) == 3
    carries_flow[[0, -1]] = False
    unknown = np.flatnonzero(carries_flow)
    rows = matrix[unknown]
    to_inlet = -np.asarray(rows[:, :n2].sum(axis=1)).ravel()
    solution = solve_amg(rows[:, unknown].tocsr(), to_inlet, rtol=rtol, unit_drop=True)
    potential = np.where(np.arange(matrix.shape[0]) < n2, 1.0, 0.0)
    potential[unknown] = solution.x
    potential[np.flatnonzero(nodes_reached(stencil.along, stencil.across) == 1)] = 1.0
    return stencil.energy(potential.reshape(stencil.nodes)), solution


@pytest.mark.parametrize(
    ("mesh", "element"),
    [
        (MeshTri, ElementTriP1()),
        (MeshQuad, ElementQuad1()),
    ],
)
def test_elements_agree_with_the_factorisation(mesh, element):
    """Also where some off-diagonal entries are positive: second order, sheared and stretched elements."""
    rng = np.random.default_rng(6)
    mesh = mesh.init_tensor(np.linspace(0, 1, 49), np.linspace(0, 0.7, 45))
    inside = mesh.interior_nodes()
    points = mesh.p.copy()
    points[:, inside] += rng.uniform(-0.004, 0.004, (2, inside.size))
    mesh = type(mesh)(points, mesh.t)
    for sigma, stretch in ((0, 1), (3, 1), (1, 5)):
        k = np.exp(sigma * rng.standard_normal(mesh.nelements))[:, None, None] * np.diag(
            [1.0, stretch]
        )
        matrix, rhs = mesh_system(mesh, element, k)
        exact = solve_direct(matrix, rhs)
        solution = solve_amg(matrix, rhs, rtol=1e-7, unit_drop=True)
        assert solution.solver == "amg"
        assert 3 <= solution.iterations <= 25
        assert energy_error(matrix, rhs, solution.x, exact.x) <= 1e-7


def test_the_same_bits_every_time_and_no_random_number():
    rng = np.random.default_rng(7)
    matrix, rhs = mesh_system(
        MeshQuad.init_tensor(*np.linspace(0, 1, 45)[None].repeat(2, axis=0)),
        ElementQuad1(),
        np.exp(rng.standard_normal(44**2))[:, None, None] * np.eye(2),
    )
    first = solve_amg(matrix, rhs, rtol=1e-6, unit_drop=True)
    np.random.seed(3)  # noqa: NPY002
    before = np.random.get_state()[1].copy()  # noqa: NPY002
    second = solve_amg(matrix, rhs, rtol=1e-6, unit_drop=True)
    assert_array_equal(np.random.get_state()[1], before)  # noqa: NPY002
    assert_array_equal(second.x, first.x)
    assert_array_equal(second.complement, first.complement)
    assert second.iterations == first.iterations


@pytest.mark.parametrize("weak", [1e-4, 1e-9, 1e-12, 1e-14])
@pytest.mark.parametrize("place", [0.02, 0.5, 0.98])
def test_constrictions_keep_their_digits(weak, place):
    """A chain of wide links with a narrow one: 1 − x before it is nearly 0, x behind it, and both ends have the flow."""
    links = np.random.default_rng(4).uniform(1, 3, 1500)
    links[700:720] *= 1e5
    links[int(place * 1500)] = weak
    matrix, rhs = chain(links)
    solution = solve_amg(matrix, rhs, rtol=1e-6, unit_drop=True)
    resistance = np.cumsum(1 / links)
    flow = 1 / resistance[-1]
    assert_allclose(
        [links[0] * solution.complement[0], links[-1] * solution.x[-1]], flow, rtol=1e-5
    )
    assert_allclose(solution.complement, flow * resistance[:-1], rtol=1e-3)
    assert_allclose(solution.x, flow * np.cumsum(1 / links[::-1])[-2::-1], rtol=1e-3)


@pytest.mark.parametrize("weak", [1e-4, 1e-9, 1e-14, 1e-20])
@pytest.mark.parametrize("place", [0.02, 0.5, 0.98])
def test_a_factorisation_keeps_its_digits_where_the_links_to_the_ends_are_known(weak, place):
    """As above; the matrix alone has lost the narrow links in the sums of its diagonal."""
    links = np.random.default_rng(4).uniform(1, 3, 1500)
    links[700:720] *= 1e5
    links[[int(place * 1500), 1100]] = weak
    matrix, rhs = chain(links)
    at_outlet = np.r_[np.zeros(len(rhs) - 1), links[-1]]
    ends = Ends(rhs, at_outlet)
    solution = solve_direct_between(matrix, ends)
    resistance = np.cumsum(1 / links)
    flow = 1 / resistance[-1]
    assert solution.residual < 1e-8
    assert_allclose(solution.complement, flow * resistance[:-1], rtol=1e-9)
    assert_allclose(solution.x, flow * np.cumsum(1 / links[::-1])[-2::-1], rtol=1e-9)
    assert_allclose(ends.supplied_energy(solution.x, solution.remainder), flow, rtol=1e-9)


def test_rows_without_links_are_left_out():
    matrix, rhs = chain(np.linspace(1, 3, 40))
    n = matrix.shape[0]
    place = np.sort(np.random.default_rng(8).permutation(2 * n)[:n])
    spread = sp.csr_array((np.ones(n), (place, np.arange(n))), shape=(2 * n, n))
    wide, b = (spread @ matrix @ spread.T).tolil(), spread @ rhs
    alone = np.setdiff1d(np.arange(2 * n), place)[0]
    wide[alone, alone], b[alone] = 4.0, 2.0  # linked to the ends only
    solution = solve_amg(wide.tocsr(), b, rtol=1e-10, unit_drop=False)
    assert_allclose(solution.x[place], solve_direct(matrix, rhs).x, rtol=1e-9)
    assert solution.x[alone] == 0.5
    assert np.count_nonzero(solution.x) == n + 1
    assert solve_amg(sp.csr_array((5, 5)), np.zeros(5), rtol=1e-6).iterations == 0


def test_several_right_hand_sides():
    matrix, _ = chain(np.linspace(1, 3, 900))
    rhs = np.random.default_rng(9).standard_normal((899, 3))
    solution = solve_amg(matrix, rhs, rtol=1e-10)
    assert_allclose(solution.x, solve_direct(matrix, rhs).x, rtol=1e-6, atol=1e-9)
    assert_array_equal(solution.x[:, 1], solve_amg(matrix, rhs[:, 1], rtol=1e-10).x)


def test_what_it_cannot_solve_is_refused():
    matrix, rhs = chain(np.linspace(1, 3, 900))
    n = len(rhs)
    with pytest.raises(NotConverged, match="without links"):
        solve_amg(sp.diags_array(np.r_[np.zeros(1), np.ones(3)]).tocsr(), np.ones(4), rtol=1e-6)
    pocket = sp.block_diag([matrix, sp.csr_array([[1.0, -1.0], [-1.0, 1.0]])]).tocsr()
    with pytest.raises(NotConverged):
        solve_amg(pocket, np.r_[rhs, 1.0, 1.0], rtol=1e-6, unit_drop=True)
    with pytest.raises(NotConverged):
        solve_amg(matrix - 3 * sp.eye_array(n), rhs, rtol=1e-6)  # indefinite


def test_the_solver_is_chosen_by_its_name_and_the_size():
    matrix, rhs = chain(np.linspace(1, 3, 900))
    assert solve_spd(matrix, rhs, 1e-8).solver == "direct"
    assert solve_spd(matrix, rhs, 1e-8, "amg").solver == "amg"
    with pytest.raises(
        InputError, match=r"^solver: given 'fast', expected one of auto, amg, direct"
    ):
        solve_spd(matrix, rhs, 1e-8, "fast")
    with pytest.raises(NotConverged):
        solve_direct(sp.csr_array([[1.0, -1.0], [-1.0, 1.0]]), np.ones(2))


def test_the_map_of_the_solvers_names_numbers_that_exist():
    named = set(re.findall(r"\b[A-Z_]{6,}\b", solvers.__doc__))
    assert len(named) >= 10
    assert named <= {*vars(thresholds), *vars(multigrid)}


def test_a_solver_that_is_named_is_used_or_fails(monkeypatch):
    """Only "auto" goes on with a factorisation if multigrid does not converge."""
    links = np.linspace(1, 3, 900)
    matrix, rhs = chain(links)
    ends = Ends(rhs, np.r_[np.zeros(len(rhs) - 1), links[-1]])

    def fail(*_matrix, **_options):
        raise NotConverged("flow: did not converge", 1.0)

    monkeypatch.setattr(sparse, "solve_amg", fail)
    monkeypatch.setattr(sparse, "DIRECT_UNKNOWNS", 10)
    for solve, right in ((solve_spd, rhs), (solve_between_ends, ends)):
        assert solve(matrix, right, 1e-8).solver == "direct"
        with pytest.raises(NotConverged):
            solve(matrix, right, 1e-8, "amg")


@pytest.mark.parametrize("rtol", [1e-3, 1e-6])
def test_it_stops_where_the_flow_is_right(rtol):
    """The flow errs by the square of the potential's error: half the iterations, and still what was asked for."""
    gap = cut_gap(np.random.default_rng(12), 60, 0.3)
    stencil = network(*cell_links(gap, (1.0, 1.0), "periodic"))
    exact = solve_flow(stencil, solver="elimination")
    conductance, solution = solve_by_pyamg(stencil, rtol**0.5)
    assert 0 <= conductance / exact.conductance - 1 <= min(rtol, 4 * solution.residual**2)
    _, finer = solve_by_pyamg(stencil, 1e-7)
    assert finer.iterations > solution.iterations + 2
