"""Grooves that wind in a spiral: fluid follows them once the lands are closed."""

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.integrate import quad

import femseal as fs
from femseal.seal.lay import Lay
from femseal.seal.layouts import AnnularLayout, MeshLayout, RectangularLayout
from femseal.studies import Sampling, stochastic

D = 1e-6
OIL = fs.Liquid(1e-3)


@pytest.mark.parametrize("across", [0.0, 1e-18, 3e-17])
@pytest.mark.parametrize("lead", [60e-6, 0.5e-3])
def test_the_closed_form_is_the_integral(across, lead):
    along, inner, outer = 2e-15, 2e-3, 2.6e-3

    def resistance(r):
        tangent = 2 * lead / (2 * np.pi * r)
        return 1 / (r * (across + along * tangent**2) / (1 + tangent**2))

    exact = 2 * np.pi / quad(resistance, inner, outer, epsrel=1e-12)[0]
    found = fs.analytic.turned_annulus_rate(along, across, 2 * lead, 1.0, 1.0, inner, outer)
    assert_allclose(found, exact, rtol=1e-9)


def test_a_ring_of_tensors_converges_to_the_closed_form():
    """Seals of tensors in their elements, turned by the angle of the spiral: of second order."""
    inner, outer, lead, across, along = 2e-3, 2.6e-3, 0.5e-3, 1e-18, 2e-16
    errors = []
    for n in (8, 16, 32):
        seal = fs.AnnularSeal(inner, outer, (n, 8))
        edges = np.hypot(*seal.points[:, 0].T)
        radii = 0.5 * (edges[:-1] + edges[1:])
        places = np.stack([radii, 0 * radii], axis=1)
        direction = Lay.of({"kind": "spiral", "lead": lead}).directions(places)  # radial and circumferential there
        k = across * np.eye(2) + (along - across) * direction[:, :, None] * direction[:, None, :]
        k = np.broadcast_to(k[:, None], (n, 8, 2, 2))
        found = fs.seal_leakage(seal, k, OIL, inlet_pressure=1e6).volume_rate * 1e-3 / 1e6
        exact = fs.analytic.turned_annulus_rate(along, across, lead, 1.0, 1.0, inner, outer)
        errors.append(abs(found / exact - 1))
    assert errors[2] < 1e-5
    assert errors[2] < errors[0] / 12


def window(n=16):
    """A window of ridges along x2 that touch under load, with open valleys between them."""
    x = (np.arange(n) + 0.5) / n
    return np.repeat(1e-6 * np.cos(2 * np.pi * x)[:, None], n, axis=1)


def drawn(lay, load, length=2e-3):
    surface = fs.Topography(np.tile(window(), (4, 4)), (D, D), (True, True))
    scene = fs.Scene(surface, 115e9, 2e9, OIL, 1e6, 0.0, loading=(load,), fluid_pressure="ignored",
                     layout=RectangularLayout(lay))  # fmt: skip
    sampling = Sampling(length=length, breadth=128 * D, realisations=2, library_cells=1, seed=1, pressure="uniform")
    return stochastic(scene, (4, 4), sampling)


def along_at(library, load):
    """Permeability along the grooves of its only window under a load."""
    (states,) = library.windows
    return states.k[0, 1, np.argmin(np.abs(states.pressure - load))]


def test_a_closed_strip_leaks_along_its_groove():
    """Equal windows: k₂ sin²α of the one that is closed across, as the pressure falls along x1 alone."""
    plain, wound = (drawn(lay, 2e8).leakage[0, 0] for lay in ("x2", {"kind": "spiral", "lead": "16 um"}))
    assert plain == 0
    library = drawn("x2", 2e8).library
    k2 = along_at(library, 2e8)
    sine2 = (16e-6 / np.hypot(16e-6, 2e-3)) ** 2
    assert_allclose(wound, k2 * sine2 * 1e6 / (1e-3 * 128e-6), rtol=1e-3)
    double = drawn({"kind": "spiral", "lead": "16 um", "starts": 2}, 2e8).leakage[0, 0]
    assert_allclose(double / wound, 4, rtol=1e-3)


@pytest.mark.parametrize("inlet", ["inner", "outer"])
def test_a_closed_ring_leaks_along_its_groove(inlet):
    """Equal windows: the closed form of a ring whose lands are closed, either way."""
    surface = fs.Topography(np.tile(window(), (4, 4)), (D, D), (True, True))
    lead = 32e-6
    layout = AnnularLayout(0.5e-3, 0.756e-3, inlet, lay={"kind": "spiral", "lead": lead, "starts": 2})
    scene = fs.Scene(surface, 115e9, 2e9, OIL, 1e6, 0.0, loading=(2e8,), fluid_pressure="ignored", layout=layout)
    found = stochastic(scene, (4, 4), Sampling(None, realisations=2, library_cells=1, seed=1, pressure="uniform"))
    k2 = along_at(found.library, 2e8)
    exact = fs.analytic.turned_annulus_rate(k2, 0.0, 2 * lead, 1e6, 1e-3, 0.5e-3, 0.756e-3)
    assert_allclose(found.leakage[0, 0] * found.seal.length, exact, rtol=2e-3)


def test_circumferential_is_a_spiral_without_lead():
    for lay in ("circumferential", {"kind": "spiral", "lead": "0 um"}):
        assert RectangularLayout(lay) == RectangularLayout("x2")
        assert AnnularLayout(1e-3, 2e-3, lay=lay) == AnnularLayout(1e-3, 2e-3)


def test_directions_of_a_spiral():
    lay = Lay.of({"kind": "spiral", "lead": "0.5 mm", "starts": 2})
    assert str(lay) == "in a spiral of lead 1 mm"
    radii = np.array([[1e-3, 0.0], [0.0, 2e-3]])
    found = lay.directions(radii)
    assert_allclose(found[0, 0] / found[0, 1], 1e-3 / (2 * np.pi * 1e-3))
    assert_allclose(found[1, 1] / -found[1, 0], 1e-3 / (2 * np.pi * 2e-3))


@pytest.mark.parametrize(
    ("make", "text"),
    [
        (lambda: Lay.of({"kind": "spiral", "lead": "-1 um"}), "lay.lead: given '-1 um', expected a length >= 0"),
        (lambda: Lay.of({"kind": "spiral", "lead": "1 um", "starts": 0}), "lay.starts: given 0"),
        (lambda: Lay.of({"kind": "spiral", "lead": "1 um", "turns": 2}), "lay: given"),
        (
            lambda: AnnularLayout(1e-3, 2e-3, lay={"kind": "spiral", "lead": "2 mm"}),
            "lay.lead: given 2 mm on a seal 1 mm",
        ),
        (lambda: MeshLayout("a.msh", "in", "out", "mm", {"kind": "spiral", "lead": "2 um"}), "lay: .* on a mesh"),
        (lambda: drawn({"kind": "spiral", "lead": "1 mm"}, 1e8), "lay.lead: given 1 mm on a seal 128 µm broad"),
    ],
)
def test_bad_spirals(make, text):
    with pytest.raises(fs.InputError, match=text):
        make()
