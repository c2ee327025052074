"""Half-space: every boundary kind against sums of Love's solution, plain transforms and closed forms; bad input."""

import hashlib
import itertools
import subprocess
import sys
from pathlib import Path

import numpy as np
import pyfftw
import pytest
from numpy.testing import assert_allclose

from femseal.base import InputError
from femseal.contact import HalfSpace, convolution
from femseal.contact.convolution import Convolution

E = 115e9
KINDS = ("periodic", "mirror", "free")
PAIRS = list(itertools.product(KINDS, KINDS))
#: Numbers of points from which a grid is large: all of them, and none.
WAYS = [1, convolution.LARGE]
SIZES = [(6, 9), (7, 5), (1, 8), (8, 1), (2, 2), (1, 1), (3, 16)]


def applied(half_space):
    """The matrix of displacements, column by column; its symbol is computed once."""
    unit = np.eye(np.prod(half_space.shape)).reshape(-1, *half_space.shape)
    way = Convolution(half_space.shape, half_space.boundary, half_space.symbol())
    return np.array([product(way, p).ravel() for p in unit]).T


@pytest.mark.parametrize("shape", SIZES)
@pytest.mark.parametrize("boundary", PAIRS)
@pytest.mark.parametrize("spacing", [(1e-6, 1e-6), (1e-6, 7e-6), (3e-5, 1e-6)])
def test_every_boundary_pair_against_a_dense_reference(boundary, shape, spacing, dense_operator):
    half_space = HalfSpace(shape, spacing, E, boundary)
    ours, reference = applied(half_space), dense_operator(half_space)
    if boundary.count("free") == 1:  # the level is arbitrary
        ours, reference = ours - ours[0, 0], reference - reference[0, 0]
    assert_allclose(ours, reference, rtol=0, atol=1e-10 * max(np.abs(reference).max(), 1e-30 / E))


def test_free_centre_of_a_uniform_square():
    # Love 1929: u = (8 a/πE*) ln(1 + √2) p at the centre of a square of side 2a
    n, d = 15, 1e-6
    u = HalfSpace((n, n), (d, d), E, "free").displacement(np.ones((n, n)))
    exact = 8 * (n * d / 2) / (np.pi * E) * np.log(1 + np.sqrt(2))
    assert_allclose(u[n // 2, n // 2], exact, rtol=1e-13)


@pytest.mark.parametrize(
    "boundary", [("free", "periodic"), ("free", "mirror"), ("periodic", "free"), ("mirror", "free")]
)
def test_strip_under_uniform_lines_is_plane_strain(boundary):
    # −(2/πE*) p ∫ ln|x − s| ds, up to a constant. Johnson 1985, eq. 2.24
    n, d = 40, 2e-6
    order = 1 if boundary[0] == "free" else -1
    p = np.random.default_rng(2).random(n)
    field = np.repeat(p[:, None], 6, axis=1)
    body = HalfSpace((n, 6)[::order], (d, 5e-6)[::order], E, boundary)
    u = body.displacement(field if order == 1 else field.T)
    u = u if order == 1 else u.T
    x = np.arange(n) * d
    upper, lower = (x[:, None] - x + half for half in (d / 2, -d / 2))
    integral = upper * np.log(np.abs(upper)) - lower * np.log(np.abs(lower)) - d
    line = -2 / (np.pi * E) * integral @ p
    expected = np.repeat(line[:, None], 6, axis=1)
    assert_allclose(u - u[0, 0], expected - line[0], rtol=0, atol=1e-12 * np.ptp(line))


@pytest.mark.parametrize("boundary", PAIRS)
def test_symmetric_and_positive(boundary):
    k = applied(HalfSpace((11, 8), (1e-6, 2.5e-6), E, boundary))
    assert_allclose(k, k.T, rtol=0, atol=1e-12 * np.abs(k).max())
    zero_sum = np.eye(88) - 1 / 88
    restricted = np.linalg.eigvalsh(zero_sum @ k @ zero_sum)
    assert np.sum(restricted > 1e-6 * restricted.max()) == 87
    assert restricted.min() > -1e-12 * restricted.max()
    assert boundary != ("free", "free") or np.linalg.eigvalsh(k).min() > 0


@pytest.mark.parametrize("kind", ["periodic", "mirror"])
def test_single_waves_respond_with_two_over_modulus_times_wave_number(kind):
    n, d = np.array([24, 30]), np.array([1e-6, 2e-6])
    half_space = HalfSpace(tuple(n), tuple(d), E, kind)
    for k in [(1, 0), (0, 1), (2, 3), (11, 14)]:
        q = (np.pi if kind == "mirror" else 2 * np.pi) * np.array(k) / (n * d)
        wave = np.outer(*(np.cos(q[a] * (np.arange(n[a]) + 0.5) * d[a]) for a in (0, 1)))
        u = half_space.displacement(wave)
        assert_allclose(u, 2 / (E * np.hypot(*q)) * wave, rtol=0, atol=1e-13 * np.abs(u).max())


@pytest.mark.parametrize("boundary", PAIRS)
@pytest.mark.parametrize("shape", [*SIZES, (36, 50), (125, 40)])
def test_large_grids_have_the_products_of_small_ones(shape, boundary, monkeypatch):
    """Threads share rows and columns, and change no bits."""
    body = HalfSpace(shape, (1e-6, 2e-6), E, boundary)
    p = np.random.default_rng(5).random(shape)
    u, symbol = body.displacement(p), body.symbol()
    for large in WAYS:
        monkeypatch.setattr(convolution, "LARGE", large)
        found = [product(Convolution(shape, boundary, symbol, threads=n), p) for n in (1, 2, 3)]
        assert len({f.tobytes() for f in found}) == 1
        assert_allclose(found[0], u, rtol=0, atol=1e-14 * np.abs(u).max())


def product(way, pressure):
    way.pressure[:] = pressure
    way.apply()
    return way.displacement.copy()


@pytest.mark.parametrize("boundary", PAIRS)
@pytest.mark.parametrize(("dtype", "error"), [(np.float64, 1e-14), (np.float32, 1e-5)])
@pytest.mark.parametrize("large", WAYS)
def test_two_workspaces_in_the_same_memory(large, boundary, dtype, error, monkeypatch):
    monkeypatch.setattr(convolution, "LARGE", large)
    half_space = HalfSpace((10, 7), (1e-6, 1e-6), E, boundary)
    given = half_space.shape, half_space.boundary, half_space.symbol()
    first = Convolution(*given)
    second = Convolution(*given, dtype=dtype, memory_of=first)
    p, q = np.random.default_rng(7).random((2, 10, 7))
    for _ in range(2):
        for workspace, pressure, rtol in ((first, p, 1e-14), (second, q, error)):
            u = half_space.displacement(pressure)
            found = product(workspace, pressure)
            assert_allclose(found, u, rtol=0, atol=rtol * np.abs(u).max())


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"shape": (0, 4)}, ["shape", "(0, 4)", ">= 1"]),
        ({"shape": (4.5, 4)}, ["shape", "4.5"]),
        ({"shape": 4}, ["shape", "4", "two"]),
        ({"shape": ("a", 4)}, ["shape", "a"]),
        ({"spacing": "1 um"}, ["spacing"]),
        ({"spacing": (1e-6, -1e-6)}, ["spacing", "> 0"]),
        ({"spacing": (1e-6, np.nan)}, ["spacing", "nan"]),
        ({"modulus": 0.0}, ["modulus", "0.0", "[Pa]"]),
        ({"modulus": np.inf}, ["modulus", "inf"]),
        ({"modulus": "115 GPa"}, ["modulus", "115 GPa"]),
        ({"shape": (2**16, 2**15)}, ["shape", "65536", "at most 2147483647 pixels"]),
        ({"boundary": ("free", "closed")}, ["boundary", "closed", "periodic, mirror, free"]),
        ({"boundary": "open"}, ["boundary", "open"]),
        ({"boundary": ("free",)}, ["boundary", "each axis"]),
        ({"pressure": np.ones((4, 5))}, ["pressure", "shape (4, 5)"]),
        ({"pressure": np.full((4, 4), np.nan)}, ["pressure", "finite"]),
    ],
)
def test_bad_input_is_named(change, words):
    given = {"shape": (4, 4), "spacing": (1e-6, 1e-6), "modulus": E} | change
    pressure = given.pop("pressure", np.ones((4, 4)))
    with pytest.raises(InputError) as caught:
        HalfSpace(**given).displacement(pressure)
    assert all(word in str(caught.value) for word in words), str(caught.value)


def displacements():
    """Bytes of displacements on grids of every boundary kind, of one block of columns and of several."""
    rng = np.random.default_rng(8)
    bodies = (HalfSpace((n, n), (1e-6, 1e-6), E, kinds) for kinds in PAIRS for n in (40, 288))
    parts = [body.displacement(rng.standard_normal(body.shape)).tobytes() for body in bodies]
    return hashlib.sha256(b"".join(parts)).hexdigest()


def test_every_process_computes_the_same_bits():
    code = "import sys; sys.path[:0] = sys.argv[1:]; import test_half_space as t; print(t.displacements())"
    command = [sys.executable, "-c", code, *Path(__file__).parents[:2]]
    once = subprocess.run(command, capture_output=True, text=True, check=True).stdout
    assert once == f"{displacements()}\n"


def test_what_fftw_has_planned_before_changes_no_bits():
    before = displacements()
    for n in (40, 288):
        points = pyfftw.empty_aligned((n, n))
        waves = pyfftw.empty_aligned((n, n // 2 + 1), dtype=complex)
        pyfftw.FFTW(points, waves, (1,), "FFTW_FORWARD", ("FFTW_MEASURE",))
        pyfftw.FFTW(waves, points, (1,), "FFTW_BACKWARD", ("FFTW_MEASURE", "FFTW_DESTROY_INPUT"))
    assert displacements() == before
