"""Half-space: every boundary kind against sums of Love's solution, plain transforms and closed forms; bad input."""

import gc
import hashlib
import itertools
import subprocess
import sys
import weakref
from pathlib import Path

import numpy as np
import pyfftw
import pytest
from each import each
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose

from femseal.base.errors import InputError
from femseal.contact import HalfSpace, convolution, large_convolution
from femseal.contact.convolution import Convolution
from femseal.contact.influence import stiffness_stencil
from femseal.contact.large_convolution import LargeConvolution

E = 115e9
KINDS = ("periodic", "mirror", "free")
PAIRS = list(itertools.product(KINDS, KINDS))
WAYS = [Convolution, LargeConvolution]
SIZES = [(6, 9), (7, 5), (1, 8), (8, 1), (2, 2), (1, 1), (3, 16)]


def applied(half_space):
    """The matrix that `displacement` applies, column by column; the symbol, the same for all, is computed once."""
    unit = np.eye(np.prod(half_space.shape)).reshape(-1, *half_space.shape)
    symbol = half_space.symbol()
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(HalfSpace, "symbol", lambda self: symbol)
        return np.array([half_space.displacement(p).ravel() for p in unit]).T


@each("shape", SIZES)
@each("boundary", PAIRS)
@each("spacing", [(1e-6, 1e-6), (1e-6, 7e-6), (3e-5, 1e-6)])
def test_every_boundary_pair_against_a_dense_reference(boundary, shape, spacing, dense_operator):
    half_space = HalfSpace(shape, spacing, E, boundary)
    ours, reference = applied(half_space), dense_operator(half_space)
    if boundary.count("free") == 1:  # the level is arbitrary
        ours, reference = ours - ours[0, 0], reference - reference[0, 0]
    assert_allclose(ours, reference, rtol=0, atol=1e-10 * max(np.abs(reference).max(), 1e-30 / E))


def test_free_against_a_direct_sum_on_a_larger_odd_grid(dense_operator):
    half_space = HalfSpace((23, 17), (2e-6, 3e-6), E, "free")
    p = np.random.default_rng(1).random((23, 17))
    assert_allclose(
        half_space.displacement(p).ravel(), dense_operator(half_space) @ p.ravel(), rtol=1e-13
    )


def test_free_centre_of_a_uniform_square():
    # Love 1929: u = (8 a/πE*) ln(1 + √2) p at the centre of a square of side 2a
    n, d = 15, 1e-6
    u = HalfSpace((n, n), (d, d), E, "free").displacement(np.ones((n, n)))
    assert_allclose(
        u[n // 2, n // 2], 8 * (n * d / 2) / (np.pi * E) * np.log(1 + np.sqrt(2)), rtol=1e-13
    )


@each(
    "boundary", [("free", "periodic"), ("free", "mirror"), ("periodic", "free"), ("mirror", "free")]
)
def test_strip_under_uniform_lines_is_plane_strain(boundary):
    # −(2/πE*) p ∫ ln|x − s| ds, up to a constant. Johnson 1985, eq. 2.24
    n, d = 40, 2e-6
    axis = boundary.index("free")
    shape, spacing = ((n, 6), (d, 5e-6)) if axis == 0 else ((6, n), (5e-6, d))
    p = np.random.default_rng(2).random(n)
    field = np.broadcast_to(p[:, None] if axis == 0 else p, shape)
    u = HalfSpace(shape, spacing, E, boundary).displacement(field)
    assert_allclose(
        u, np.broadcast_to(u[:, :1] if axis == 0 else u[:1], shape), rtol=0, atol=1e-12 * np.ptp(u)
    )
    x = np.arange(n) * d
    t = x[:, None] - x
    upper, lower = t + d / 2, t - d / 2
    line = (
        -2 / (np.pi * E) * (upper * np.log(np.abs(upper)) - lower * np.log(np.abs(lower)) - d) @ p
    )
    ours = u[:, 0] if axis == 0 else u[0]
    assert_allclose(ours - ours[0], line - line[0], rtol=0, atol=1e-12 * np.ptp(line))


@each("kind", ["periodic", "mirror"])
def test_strip_approaches_the_free_patch_far_from_its_images(kind):
    # a lone pixel whose images are L away feels −c/L + O((x/L)²)
    n, d = 6, 1e-6
    p = np.zeros((n, 240))
    p[2, 120] = 1.0
    patch = HalfSpace(p.shape, (d, d), E, "free").displacement(p)[:, 117:124]
    strip = HalfSpace(p.shape, (d, d), E, ("free", kind)).displacement(p)[:, 117:124]
    assert_allclose(strip - strip[2, 3], patch - patch[2, 3], rtol=0, atol=1e-4 * patch.max())


@each("boundary", PAIRS)
def test_symmetric_and_positive(boundary):
    half_space = HalfSpace((11, 8), (1e-6, 2.5e-6), E, boundary)
    rng = np.random.default_rng(3)
    p, q = rng.standard_normal((2, 11, 8))
    assert_allclose(
        np.sum(q * half_space.displacement(p)), np.sum(p * half_space.displacement(q)), rtol=1e-12
    )
    eigenvalues = np.linalg.eigvalsh(applied(half_space))
    zero_sum = np.eye(88) - 1 / 88
    restricted = np.linalg.eigvalsh(zero_sum @ applied(half_space) @ zero_sum)
    assert np.sum(restricted > 1e-6 * restricted.max()) == 87
    assert restricted.min() > -1e-12 * restricted.max()
    if boundary == ("free", "free"):
        assert eigenvalues.min() > 0


@each(
    ("mirror", "periodic", "axes"),
    [
        (("mirror", "periodic"), ("periodic", "periodic"), (0,)),
        (("periodic", "mirror"), ("periodic", "periodic"), (1,)),
        (("mirror", "mirror"), ("periodic", "periodic"), (0, 1)),
        (("free", "mirror"), ("free", "periodic"), (1,)),
        (("mirror", "free"), ("periodic", "free"), (0,)),
    ],
)
def test_mirror_is_the_even_extension(mirror, periodic, axes):
    p = np.random.default_rng(4).random((9, 14))
    whole = p
    for axis in axes:
        whole = np.concatenate([whole, np.flip(whole, axis)], axis)
    u = HalfSpace(p.shape, (1e-6, 3e-6), E, mirror).displacement(p)
    v = HalfSpace(whole.shape, (1e-6, 3e-6), E, periodic).displacement(whole)[:9, :14]
    # a free axis leaves the level open
    assert_allclose(u - u.mean(), v - v.mean(), rtol=0, atol=1e-12 * np.abs(v).max())
    if "free" not in mirror:
        assert_allclose(u, v, rtol=0, atol=1e-13 * np.abs(v).max())


@each("kind", ["periodic", "mirror"])
def test_single_waves_respond_with_two_over_modulus_times_wave_number(kind):
    n1, n2, d = 24, 30, 1e-6
    half_space = HalfSpace((n1, n2), (d, 2 * d), E, kind)
    unit = np.pi if kind == "mirror" else 2 * np.pi
    for k1, k2 in [(1, 0), (0, 1), (2, 3), (11, 14)]:
        q1, q2 = unit * k1 / (n1 * d), unit * k2 / (n2 * 2 * d)
        wave = np.outer(
            np.cos(q1 * (np.arange(n1) + 0.5) * d), np.cos(q2 * (np.arange(n2) + 0.5) * 2 * d)
        )
        u = half_space.displacement(wave)
        assert_allclose(u, 2 / (E * np.hypot(q1, q2)) * wave, rtol=0, atol=1e-13 * np.abs(u).max())


@settings(deadline=None, max_examples=25)
@given(
    shape=st.tuples(st.integers(1, 13), st.integers(1, 13)),
    boundary=st.sampled_from(PAIRS),
    ratio=st.floats(1 / 30, 30),
    seed=st.integers(0, 99),
)
def test_linear_and_transposed(shape, boundary, ratio, seed):
    spacing = (1e-6, ratio * 1e-6)
    p, q = np.random.default_rng(seed).standard_normal((2, *shape))
    half_space = HalfSpace(shape, spacing, E, boundary)
    u = half_space.displacement(p)
    scale = np.abs(u).max() + 1e-6 / E
    both = half_space.displacement(2 * p - 3 * q)
    assert_allclose(both, 2 * u - 3 * half_space.displacement(q), rtol=0, atol=1e-11 * scale)
    turned = HalfSpace(shape[::-1], spacing[::-1], E, boundary[::-1]).displacement(p.T).T
    assert_allclose(turned, u, rtol=0, atol=1e-12 * scale)
    # K has the unit length/modulus, but for the open level of a strip
    scaled = HalfSpace(shape, (3 * spacing[0], 3 * spacing[1]), 2 * E, boundary).displacement(p)
    assert_allclose(scaled, 1.5 * u, rtol=0, atol=1e-12 * scale)


@each("boundary", PAIRS)
@each("shape", [*SIZES, (36, 50), (125, 40)])
def test_large_grids_have_the_products_of_small_ones(shape, boundary, monkeypatch):
    monkeypatch.setattr(large_convolution, "BLOCK_BYTES", 16 * 16 * shape[0])
    half_space = HalfSpace(shape, (1e-6, 2e-6), E, boundary)
    p = np.random.default_rng(5).random(shape)
    monkeypatch.setattr(large_convolution, "LARGE", np.inf)
    u = half_space.displacement(p)
    monkeypatch.setattr(large_convolution, "LARGE", 1)
    assert_allclose(half_space.displacement(p), u, rtol=0, atol=1e-14 * np.abs(u).max())


@each("boundary", PAIRS)
@each("kind", WAYS)
def test_workspace_can_be_used_again(kind, boundary, monkeypatch):
    monkeypatch.setattr(large_convolution, "LARGE", 1 if kind is LargeConvolution else np.inf)
    half_space = HalfSpace((10, 7), (1e-6, 1e-6), E, boundary)
    workspace = kind(half_space.shape, half_space.boundary, half_space.symbol())
    p, q = np.random.default_rng(7).random((2, 10, 7))

    def displacement(pressure):
        workspace.pressure[:] = pressure
        workspace.apply()
        assert np.array_equal(workspace.pressure, pressure)
        return workspace.displacement.copy()

    first, second = displacement(p), displacement(q)
    assert np.array_equal(displacement(p), first)
    assert np.array_equal(second, half_space.displacement(q))


@each("boundary", PAIRS)
@each(("dtype", "error"), [(np.float64, 0), (np.float32, 1e-5)])
@each("kind", WAYS)
def test_two_workspaces_in_the_same_memory(kind, boundary, dtype, error, monkeypatch):
    monkeypatch.setattr(large_convolution, "LARGE", 1 if kind is LargeConvolution else np.inf)
    half_space = HalfSpace((10, 7), (1e-6, 1e-6), E, boundary)
    first = kind(half_space.shape, half_space.boundary, half_space.symbol())
    second = kind(
        half_space.shape, half_space.boundary, half_space.symbol(), dtype=dtype, over=first
    )
    p, q = np.random.default_rng(7).random((2, 10, 7))
    for _ in range(2):
        for workspace, pressure, rtol in ((first, p, 0), (second, q, error)):
            workspace.pressure[:] = pressure
            workspace.apply()
            u = half_space.displacement(pressure)
            assert_allclose(workspace.displacement, u, rtol=0, atol=rtol * np.ptp(u))


@each("ratio", [1, 3, 30, 1 / 30])
def test_preconditioner_is_positive_definite(ratio):
    stencil = stiffness_stencil((1e-6, ratio * 1e-6), E, radius=2)
    padded = np.zeros((48, 48))
    padded[:5, :5] = stencil
    symbol = np.fft.fft2(np.roll(padded, (-2, -2), (0, 1)))
    assert np.abs(symbol.imag).max() < 1e-12 * symbol.real.max()
    assert symbol.real.min() > 0


def test_one_word_stands_for_both_axes():
    assert HalfSpace((4, 4), (1, 1), 1, "free").boundary == ("free", "free")  # type: ignore[arg-type]


@each(
    ("change", "words"),
    [
        ({"shape": (0, 4)}, ["shape", "(0, 4)", ">= 1"]),
        ({"shape": (4.5, 4)}, ["shape", "4.5"]),
        ({"shape": 4}, ["shape", "4", "two"]),
        ({"shape": (4, 4, 4)}, ["shape", "two"]),
        ({"spacing": "1 um"}, ["spacing"]),
        ({"spacing": (1e-6, -1e-6)}, ["spacing", "> 0"]),
        ({"spacing": (1e-6, np.nan)}, ["spacing", "nan"]),
        ({"spacing": (np.inf, 1e-6)}, ["spacing", "inf"]),
        ({"modulus": 0.0}, ["modulus", "0.0", "[Pa]"]),
        ({"modulus": np.nan}, ["modulus", "nan"]),
        ({"modulus": np.inf}, ["modulus", "inf"]),
        ({"boundary": ("free", "closed")}, ["boundary", "closed", "periodic, mirror, free"]),
        ({"boundary": "open"}, ["boundary", "open"]),
        ({"boundary": ("free",)}, ["boundary", "each axis"]),
        ({"shape": (np.nan, 4)}, ["shape", "nan"]),
        ({"shape": ("a", 4)}, ["shape", "a"]),
        ({"spacing": ("1 um", 1e-6)}, ["spacing", "1 um"]),
        ({"modulus": "115 GPa"}, ["modulus", "115 GPa"]),
        ({"modulus": None}, ["modulus", "None"]),
    ],
)
def test_bad_input_is_named(change, words):
    given = {
        "shape": (4, 4),
        "spacing": (1e-6, 1e-6),
        "modulus": E,
        "boundary": ("periodic", "periodic"),
    } | change
    with pytest.raises(InputError) as caught:
        HalfSpace(**given)
    assert all(word in str(caught.value) for word in words), str(caught.value)


@each(
    ("pressure", "word"), [(np.ones((4, 5)), "shape (4, 5)"), (np.full((4, 4), np.nan), "finite")]
)
def test_bad_pressure_is_named(pressure, word):
    with pytest.raises(InputError, match="pressure") as caught:
        HalfSpace((4, 4), (1e-6, 1e-6), E).displacement(pressure)
    assert word in str(caught.value)


def displacements():
    """Bytes of displacements on grids of every boundary kind, of one block of columns and of several."""
    rng = np.random.default_rng(8)
    parts = []
    for kinds in PAIRS:
        for n in (40, 288):
            parts.append(
                HalfSpace((n, n), (1e-6, 1e-6), E, kinds)
                .displacement(rng.standard_normal((n, n)))
                .tobytes()
            )
    return hashlib.sha256(b"".join(parts)).hexdigest()


def test_every_process_computes_the_same_bits():
    code = "import sys; sys.path[:0] = sys.argv[1:]; import test_half_space as t; print(t.displacements())"
    command = [sys.executable, "-c", code, *Path(__file__).parents[:2]]
    once = subprocess.run(command, capture_output=True, text=True, check=True).stdout
    assert once == f"{displacements()}\n"


def test_what_fftw_has_planned_before_changes_no_bits_and_is_kept():
    before = displacements()
    for n in (40, 288):
        points, waves = (
            pyfftw.empty_aligned((n, n)),
            pyfftw.empty_aligned((n, n // 2 + 1), dtype=complex),
        )
        pyfftw.FFTW(points, waves, (1,), "FFTW_FORWARD", ("FFTW_MEASURE",))
        pyfftw.FFTW(waves, points, (1,), "FFTW_BACKWARD", ("FFTW_MEASURE", "FFTW_DESTROY_INPUT"))
    known = pyfftw.export_wisdom()
    assert displacements() == before
    assert [sorted(part.splitlines()) for part in pyfftw.export_wisdom()] == [
        sorted(k.splitlines()) for k in known
    ]


@each("boundary", PAIRS)
@each(("kind", "module"), zip(WAYS, [convolution, large_convolution], strict=True))
def test_threads_share_rows_and_columns_and_change_no_bits(kind, module, boundary, monkeypatch):
    monkeypatch.setattr(module, "ROW_POINTS", 200)
    monkeypatch.setattr(module, "BLOCK_BYTES", 8 * 16 * 36)
    half_space = HalfSpace((36, 50), (1e-6, 1e-6), E, boundary)
    p = np.random.default_rng(9).random((36, 50))
    found = []
    for threads in (1, 2, 3):
        shared = kind(half_space.shape, half_space.boundary, half_space.symbol(), threads=threads)
        shared.pressure[:] = p
        shared.apply()
        found.append(shared.displacement.tobytes())
    rows, blocks = (
        shared._stages[:2]
        if kind is Convolution
        else (shared._parts, [b[0] for b in shared._blocks])
    )
    assert len(rows) > 2
    assert [len(part) > 0 for part in blocks] == [True] * 3
    assert len(set(found)) == 1
    u = half_space.displacement(p)
    assert_allclose(shared.displacement, u, rtol=0, atol=1e-14 * np.abs(u).max())


@each("kind", WAYS)
def test_the_memory_of_a_convolution_goes_with_it(kind):
    """Of nested grids one is there at a time, without waiting for the garbage collector."""
    half_space = HalfSpace((36, 50), (1e-6, 1e-6), E)
    one = kind(half_space.shape, half_space.boundary, half_space.symbol())
    one.apply()
    left = weakref.ref(one)
    gc.disable()
    try:
        del one
        assert left() is None
    finally:
        gc.enable()
