"""What all tests share: surroundings that are the same everywhere, and reference operators of the contact tests.

The operators are independent of the package: dense matrices and plain FFTs.
"""

import os
import sys
from contextlib import contextmanager

import numpy as np
import pytest
import scipy.fft
from hypothesis import settings

# the same examples in every run; others are tried with --hypothesis-profile=default
settings.register_profile("repeatable", derandomize=True, database=None)
settings.load_profile("repeatable")


def love(x, y, spacing, modulus):
    """Displacement at (x, y) of one pixel under unit pressure, by its four corners. Johnson 1985, eq. 3.25."""
    (d1, d2) = spacing
    total = 0.0
    for s in (-1, 1):
        for t in (-1, 1):
            a, b = x + s * d1 / 2, y + t * d2 / 2
            total = total + s * t * (a * np.arcsinh(b / np.abs(a)) + b * np.arcsinh(a / np.abs(b)))
    return total / (np.pi * modulus)


def image_sum(x, y, period, spacing, modulus):
    """Love's solution of a pixel and its images along x2, less that at the origin: extrapolated in their number.

    What M images to each side leave out is a series in (M + ½)⁻², once they lie farther than x.
    """
    far = 1 + int(np.abs(x).max() / period)
    sums, t = [], []
    total, first = 0.0, 0
    for last in (8 * far, 12 * far, 16 * far, 24 * far, 32 * far):
        m = np.arange(first, last + 1)
        shift = period * np.r_[m, -m[m > 0]].reshape(-1, *np.ones(np.broadcast(x, y).ndim, int))
        images = love(x, y + shift, spacing, modulus) - love(0.0, shift, spacing, modulus)
        total, first = total + images.sum(axis=0), last + 1
        sums.append(total)
        t.append((last + 0.5) ** -2)
    weights = [np.prod([u / (u - v) for u in t if u != v]) for v in t]
    return sum(w * s for w, s in zip(weights, sums, strict=True))


def spectral(pressure, half_space):
    """Displacement under a pressure, by full complex transforms: 2/(E*|q|) p, of the even extension of mirror axes."""
    p = np.asarray(pressure, dtype=float)
    for axis, kind in enumerate(half_space.boundary):
        if kind == "mirror":
            p = np.concatenate([p, np.flip(p, axis)], axis)
    q = [
        2 * np.pi * scipy.fft.fftfreq(n, d)
        for n, d in zip(p.shape, half_space.spacing, strict=True)
    ]
    size = np.hypot(q[0][:, None], q[1][None, :])
    size[0, 0] = np.inf
    u = scipy.fft.ifft2(scipy.fft.fft2(p) * 2 / (half_space.modulus * size)).real
    return u[: half_space.shape[0], : half_space.shape[1]]


def matrix(half_space):
    """Displacement of each point under a unit pressure on each other point, as a dense matrix (n1·n2, n1·n2).

    It holds for any pair of boundary kinds; with one free axis, up to a constant.
    """
    (n1, n2), (d1, d2) = half_space.shape, half_space.spacing
    if "free" not in half_space.boundary:
        unit = np.eye(n1 * n2).reshape(-1, n1, n2)
        return np.array([spectral(p, half_space).ravel() for p in unit]).T
    i, j = (a.ravel() for a in np.indices((n1, n2)))
    if half_space.boundary == ("free", "free"):
        table = love(steps(n1)[:, None] * d1, steps(n2) * d2, (d1, d2), half_space.modulus)
        return table[i[:, None] - i, j[:, None] - j]
    if half_space.boundary[0] == "free":
        kind, m, n, across, d, row, column = half_space.boundary[1], n1, n2, d1, d2, i, j
    else:
        kind, m, n, across, d, row, column = half_space.boundary[0], n2, n1, d2, d1, j, i
    period = n * d * (2 if kind == "mirror" else 1)

    def images(offsets):
        x, y = steps(m)[:, None] * across, offsets * d
        return image_sum(x, y, period, (across, d), half_space.modulus)

    k = images(steps(n))[row[:, None] - row, column[:, None] - column]
    if kind == "mirror":
        k = k + images(np.arange(1, 2 * n))[row[:, None] - row, column[:, None] + column]
    return k


def steps(n):
    """Differences i − j of two of n indices, of which `steps(n)[i - j]` is i − j, also where it is negative."""
    return np.r_[:n, 1 - n : 0]


@pytest.fixture
def dense_operator():
    """A function that returns the displacements of a half-space under pressures as a dense matrix, by closed forms."""
    return matrix


@pytest.fixture
def spectral_displacement():
    """A function that returns the displacement under a pressure by plain transforms, without free boundaries."""
    return spectral


def pytest_configure(config):
    """One thread of linear algebra in every process that is started from here, so that they do not compete for cores."""
    os.environ.setdefault("OMP_NUM_THREADS", "1")


@pytest.hookimpl(tryfirst=True)
def pytest_sessionstart(session):
    """Before several processes run the tests, compile the loops once: each would compile all of them."""
    processes = session.config.getoption("numprocesses", None)
    if processes and not hasattr(session.config, "workerinput"):
        from femseal.execution.run import ordered_map
        from femseal.studies.compiling import compile_ahead

        with ordered_map(processes, before=compile_ahead):
            pass


@pytest.fixture(autouse=True, scope="session")
def _plain_terminal():
    """Texts for a terminal are plain and of a usual width, whatever the tests run in."""
    with pytest.MonkeyPatch.context() as patch:
        for name in ("FORCE_COLOR", "GITHUB_ACTIONS", "PY_COLORS", "TERMINAL_WIDTH"):
            patch.delenv(name, raising=False)
        patch.setenv("COLUMNS", "80")
        yield


@contextmanager
def _pictures(figures, rendered_formats):
    """Pictures of results folders are made by these two functions.

    The first one returns functions that draw the figures of a run, the second the content of a figure in several formats.
    """
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("femseal.report.pictures._figures", figures)
        patch.setattr("femseal.report.pictures.rendered_formats", rendered_formats)
        yield


def _nothing(figure, formats):
    return dict.fromkeys(formats, b"\x89PNG\r\n\x1a\n")


@pytest.fixture(autouse=True, scope="session")
def _how_pictures_are_made():
    """Replace the pictures of results folders by files of their kind with nothing in them: to draw takes too long.

    Tests receive the two functions that make the pictures outside of tests.
    """
    from femseal.report import pictures

    made = pictures._figures, pictures.rendered_formats
    with _pictures(lambda *given: dict.fromkeys(made[0](*given), lambda: None), _nothing):
        yield made


@pytest.fixture(scope="module")
def drawn_pictures(_how_pictures_are_made):
    """Pictures of results folders are drawn: for modules that look at them."""
    with _pictures(*_how_pictures_are_made):
        yield


@pytest.fixture
def undrawn(_how_pictures_are_made):
    """Within a module that looks at pictures, a test of figures that are made, but not drawn."""
    with _pictures(_how_pictures_are_made[0], _nothing):
        yield


@pytest.fixture
def contacts(monkeypatch):
    """A list that receives the nominal pressure of every contact that is solved in this process."""
    from femseal.contact import solver

    solved, check = [], solver._checked_pressure

    def counted(pressure, law):
        solved.append(pressure)
        return check(pressure, law)

    monkeypatch.setattr(solver, "_checked_pressure", counted)
    return solved


@pytest.fixture
def femseal(monkeypatch, capsys):
    """Call the command line in this process: exit code, output, errors."""
    from femseal import cli

    def call(*arguments):
        monkeypatch.setattr("sys.argv", ["femseal", *map(str, arguments)])
        try:
            cli.main()
            code = 0
        except SystemExit as stop:
            code = stop.code or 0
        return (code, *capsys.readouterr())

    yield call
    cli._debug = False


@pytest.fixture(autouse=True)
def _no_figures_left():
    """Close the figures of pyplot, which would stay open until the end of the process."""
    yield
    if (pyplot := sys.modules.get("matplotlib.pyplot")) is not None:
        pyplot.close("all")
