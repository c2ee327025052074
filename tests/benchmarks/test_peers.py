"""The plain way of the benchmarks, by other programs, agrees with femseal on a small face."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

import chain
import femseal as fs
import peers
from femseal.flow import Stencil, solve_flow

N = 32
CYCLE = {
    "loading": chain.loads((0.05, 0.3)),
    "unload_from": chain.loads((0.3,)),
    "unloading": chain.loads((0.05,)),
}


def states_of(pixels, shift):
    """Undeformed gap of a face of 32² pixels at pixels², spacing, gaps of its cycle by femseal."""
    z, spacing = chain.heights(N, pixels, shift), N * chain.PIXEL / pixels
    gap0 = z.max() - z
    body = fs.HalfSpace(gap0.shape, (spacing, spacing), chain.MODULUS)
    states = fs.load_cycle(gap0, body, hardness=chain.HARDNESS, rtol=1e-8, **CYCLE)
    return gap0, spacing, [state.contact.gap for state in states]


def needs(name):
    pytest.importorskip(peers.MODULES[name], reason=f"{name} is not installed")


@pytest.mark.parametrize(
    ("name", "tolerance"),
    [
        ("Tamaas", 1e-8),
        pytest.param("ContactMechanics", 1e-6, marks=pytest.mark.slow),
        ("ContactMechanics from bearing area", 1e-6),
    ],
)
def test_gaps_of_a_load_cycle_with_hardness_are_those_of_peers(name, tolerance):
    needs(name)
    gap0, spacing, own = states_of(N, 0.0)
    solve = peers.CONTACTS[name](gap0.shape, spacing, chain.MODULUS, chain.HARDNESS)
    gaps = peers.gaps_of_cycle(solve, gap0, *CYCLE.values(), tolerance)
    assert len(gaps) == len(own) == 3
    # the peak deforms: the same load leaves another gap on the way down
    assert np.abs(gaps[2] - gaps[0]).max() > 0.1 * gap0.std()
    assert_allclose(gaps, own, atol=1e-5 * gap0.std())


@pytest.mark.parametrize("solver", ["pyamg", pytest.param("PARDISO", marks=pytest.mark.slow)])
def test_flow_of_a_contact_is_that_of_bilinear_elements(solver, monkeypatch):
    needs(solver)
    monkeypatch.setattr(peers, "DIRECT", 0)
    flow = peers.PlainFlow((2 * N, 2 * N), solver)
    plain = [flow(gap) for gap in states_of(2 * N, 0.0)[2]]
    # between samples at nodes and at the centres of pixels lies an error of the second order
    _, spacing, gaps = states_of(2 * N, 0.5)
    pixel = (spacing, spacing)
    own = [fs.cell_permeability(gap, pixel, sides="periodic").value for gap in gaps]
    assert_allclose(plain, own, rtol=0.03)


def test_networks_are_those_of_femseal():
    """Closed links and all."""
    rng = np.random.default_rng(3)
    shapes = ((6, 9), (5, 9))
    drawn = [np.exp(rng.standard_normal(s)) * (rng.random(s) > 0.2) for s in shapes]
    own = solve_flow(Stencil.network(*drawn)).conductance * 6 / 9
    assert own > 0
    assert_allclose(peers.network_permeability(*drawn), own, rtol=1e-9)
    drawn[0][2] = 0.0
    assert peers.network_permeability(*drawn) == 0.0
