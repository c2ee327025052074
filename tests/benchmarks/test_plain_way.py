"""The plain way of the benchmark `chain`, a seal study by other programs, agrees with femseal on a small face."""

import chain_tasks as chain
import numpy as np
import plain_way
import pytest
from numpy.testing import assert_allclose

import femseal as fs

N, LOADING, PEAKS, UNLOADING = 32, chain.loads((0.05, 0.3)), chain.loads((0.3,)), chain.loads((0.05,))


def cycle(pixels):
    """Undeformed gap of a face of 32² pixels at pixels² nodes, pixel and load states by femseal."""
    z, spacing = chain.heights(N, pixels, 0.0), N * chain.PIXEL / pixels
    gap0 = z.max() - z
    body = fs.HalfSpace(gap0.shape, (spacing, spacing), chain.MODULUS)
    states = fs.load_cycle(
        gap0, body, loading=LOADING, unload_from=PEAKS, unloading=UNLOADING, hardness=chain.HARDNESS, rtol=1e-8
    )
    return gap0, spacing, states


@pytest.mark.parametrize(
    ("name", "module", "tolerance"),
    [
        ("Tamaas", "tamaas", 1e-8),
        pytest.param("ContactMechanics", "ContactMechanics", 1e-6, marks=pytest.mark.slow),
        ("ContactMechanics from bearing area", "ContactMechanics", 1e-6),
    ],
)
def test_gaps_of_a_load_cycle_with_hardness_are_those_of_peers(name, module, tolerance):
    pytest.importorskip(module, reason=f"{module} is not installed")
    gap0, spacing, states = cycle(N)
    solve = plain_way.CONTACTS[name](gap0.shape, spacing, chain.MODULUS, chain.HARDNESS, tolerance)
    gaps = plain_way.gaps_of_cycle(solve, gap0, LOADING, PEAKS, UNLOADING)
    assert len(gaps) == len(states) == 3
    # the peak deforms: the same load leaves another gap on the way down
    assert np.abs(gaps[2] - gaps[0]).max() > 0.1 * gap0.std()
    for gap, state in zip(gaps, states, strict=True):
        assert_allclose(gap, state.contact.gap, atol=1e-5 * gap0.std())


@pytest.mark.parametrize("solver", ["pyamg", pytest.param("PARDISO", marks=pytest.mark.slow)])
def test_flow_of_a_contact_is_that_of_bilinear_elements(solver, monkeypatch):
    pytest.importorskip({"pyamg": "pyamg", "PARDISO": "pypardiso"}[solver], reason=f"{solver} is not installed")
    monkeypatch.setattr(plain_way, "DIRECT", 0)
    pixels = 2 * N
    _, spacing, states = cycle(pixels)
    flow = plain_way.PlainFlow((pixels, pixels), True, solver)
    plain = [flow(plain_way.closed_ring(state.contact.gap)) for state in states]
    # between samples at nodes and at the centres of pixels lies an error of the second order
    scene = chain.scene_of(N, pixels)
    own = [
        fs.cell_permeability(contact_at_centres(scene, k), (spacing, spacing), sides="periodic").value for k in range(3)
    ]
    assert_allclose(plain, own, rtol=0.03)


def contact_at_centres(scene, step):
    body = fs.HalfSpace(scene.surface.shape, scene.surface.spacing, chain.MODULUS)
    gap0 = scene.surface.heights.max() - scene.surface.heights
    states = fs.load_cycle(gap0, body, loading=LOADING, unload_from=PEAKS, unloading=UNLOADING, hardness=chain.HARDNESS)
    return states[step].contact.gap


def test_networks_of_the_plain_way():
    """They are those of femseal, closed links and all."""
    rng = np.random.default_rng(3)
    drawn = [np.exp(rng.standard_normal(shape)) * (rng.random(shape) > 0.2) for shape in ((6, 9), (5, 9))]
    own = fs.RectangularSeal((6.0, 9.0), (6, 9)).flow(tuple(drawn)).conductance * 6 / 9
    assert own > 0
    assert_allclose(plain_way.network_permeability(*drawn), own, rtol=1e-9)
    drawn[0][2] = 0.0
    assert plain_way.network_permeability(*drawn) == 0.0
