"""The elastic half-space: its boundary kinds, its symbol, and the displacement under a pressure.

Symbols are real eigenvalues of K. E* contact modulus, q wave vector [rad/m], Δ pixel spacing, K₀ modified Bessel
function, Ki₁(x) = ∫ₓ^∞ K₀ (Bickley function).
Sources: Johnson, Contact Mechanics, 1985, ch. 3 and 13; Love, Phil. Trans. R. Soc. A 228, 1929, 377 (pixel of
constant pressure); Liu, Wang, Liu, Wear 243, 2000, 101 (DC-FFT).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike
from scipy.fft import rfft
from scipy.special import polygamma

from ..base import Array, InputError, Pair, Shape, validate
from .convolution import Boundary, Convolution, padded_length

BOUNDARIES = ("periodic", "mirror", "free")
#: Values of the kernel of a free axis that are computed at a time.
_STRIP_VALUES = 2**20


@dataclass(frozen=True)
class HalfSpace:
    """An elastic half-space under pressures on a grid of pixels: u = K p.

    û = 2 p̂/(E*|q|) on periodic axes (mean displacement free); a mirror axis is the even extension, exactly a cosine
    transform on the same points; on free axes the pressure is 0 outside and constant on each pixel (Love).

    Parameters
    ----------
    shape : (n1, n2) pixels.
    spacing : (Δ1, Δ2) [m].
    modulus : contact modulus E* [Pa].
    boundary : kind of each axis, "periodic", "mirror" or "free"; one word stands for both.

    Raises
    ------
    InputError : a size, spacing, modulus or boundary kind that is not allowed.

    Notes
    -----
    Sources: Johnson, Contact Mechanics, 1985; Stanley & Kato, J. Tribol. 119, 1997, 481 (periodic);
    Liu, Wang & Liu, Wear 243, 2000, 101 (free). With one free axis, the uniform mode is the plane-strain logarithm,
    whose constant is arbitrary, and so is then the level of `displacement`.

    Free axes are padded to lengths with fast transforms. Periodic and mirror ones cannot be: a large prime factor in
    their number of points slows everything, 1021² points take 8 times as long as 1024². `Topography.resample` helps.

    Examples
    --------
    >>> body = HalfSpace((64, 64), (1e-6, 1e-6), modulus=115e9, boundary=("free", "periodic"))
    >>> body.displacement(np.zeros((64, 64))).shape
    (64, 64)
    """

    shape: Shape
    spacing: Pair
    modulus: float
    boundary: Boundary = ("periodic", "periodic")

    def __post_init__(self) -> None:
        object.__setattr__(self, "shape", validate.grid("shape", self.shape))
        object.__setattr__(self, "spacing", validate.lengths("spacing", self.spacing))
        object.__setattr__(self, "modulus", validate.number("modulus", self.modulus, unit="Pa"))
        ends = (self.boundary,) * 2 if isinstance(self.boundary, str) else self.boundary
        is_pair = isinstance(ends, (tuple, list)) and len(ends) == 2
        if not (is_pair and all(end in BOUNDARIES for end in ends)):
            kinds = f"one of {', '.join(BOUNDARIES)} for each axis"
            raise InputError("boundary", self.boundary, kinds)
        object.__setattr__(self, "boundary", tuple(ends))

    @cached_property
    def stiffness(self) -> float:
        """c = πE*/(4Δ) [Pa/m], that of a wave of four pixels: the step from gap to pressure of the contact solver.

        Δ is the geometric mean of the spacings along which there are points.
        """
        spacings = [d for n, d in zip(self.shape, self.spacing, strict=True) if n > 1] or [
            min(self.spacing)
        ]
        return np.pi * self.modulus / (4 * float(np.prod(spacings) ** (1 / len(spacings))))

    @cached_property
    def of_unit_modulus(self) -> HalfSpace:
        """The body with E* = 1 Pa, whose displacements are E* times as large."""
        return replace(self, modulus=1.0)

    @cached_property
    def coarser(self) -> HalfSpace:
        """The same area with about half of the points along each axis that has more than one."""
        (n1, n2), (d1, d2) = self.shape, self.spacing
        spacing = 2 * d1 if n1 > 1 else d1, 2 * d2 if n2 > 1 else d2
        return replace(self, shape=((n1 + 1) // 2, (n2 + 1) // 2), spacing=spacing)

    def symbol(self) -> Array:
        """Eigenvalues of K [m/Pa] for the waves of periodic and padded free axes and the cosines of mirror axes.

        A wave and its conjugate respond alike, and so does that with one number reversed: half of both axes is enough,
        but for mirrors.
        """
        (n1, n2), (d1, d2), (b1, b2) = self.shape, self.spacing, self.boundary
        if b1 == b2 == "free":
            return free_symbol(self.shape, self.spacing, self.modulus)
        q1, q2 = wave_numbers(n1, d1, b1), wave_numbers(n2, d2, b2)
        if b1 == "free":
            return strip_symbol(n1, d1, q2, d2, self.modulus)
        if b2 == "free":
            return np.ascontiguousarray(strip_symbol(n2, d2, q1, d1, self.modulus).T)
        stiffness = self.modulus * np.hypot(q1[:, None], q2)
        # the mean displacement is free, 0 for q = 0
        return np.divide(2.0, stiffness, out=stiffness, where=stiffness > 0)

    def displacement(self, pressure: ArrayLike) -> Array:
        """Displacement u = K p [m] of shape (n1, n2) under pressures p [Pa] of the same shape."""
        p = validate.field("pressure", pressure, unit="Pa", shape=self.shape)
        product = Convolution(self.shape, self.boundary, self.symbol())
        product.pressure[:] = p
        product.apply()
        return np.ascontiguousarray(product.displacement)


def wave_numbers(n: int, spacing: float, kind: str) -> Array:
    """|q| [rad/m] of the modes of one axis, in the order of its transform.

    Periodic: the non-negative half of a real transform; mirror: q = πk/(nΔ) of the cosine transform, which is the
    periodic axis of twice the length.
    """
    if kind == "mirror":
        return np.pi / (n * spacing) * np.arange(n, dtype=float)
    return 2 * np.pi / (n * spacing) * np.arange(n // 2 + 1, dtype=float)


def _love(x: Array, y: Array) -> Array:
    """Antiderivative in both coordinates of 1/√(x² + y²); neither coordinate is 0 at a pixel's corners."""
    return x * np.arcsinh(y / np.abs(x)) + y * np.arcsinh(x / np.abs(y))


def free_symbol(shape: Shape, spacing: Pair, modulus: float) -> Array:
    """Both axes free: transform of Love's displacement [m/Pa] of a pixel under constant pressure."""
    x, y = (
        (np.arange(padded_length(n) // 2 + 2, dtype=float) - 0.5) * d
        for n, d in zip(shape, spacing, strict=True)
    )
    potential = _love(x[:, None], y)
    kernel = np.diff(np.diff(potential, axis=0), axis=1) / (np.pi * modulus)
    l1, l2 = (padded_length(n) for n in shape)
    return np.ascontiguousarray(_even_transform(_even_transform(kernel, l2).T, l1).T)


def _even_transform(half: Array, length: int) -> Array:
    """Transform of rows that are even about 0, of which the first half is given: the first half of it."""
    rest = length - half.shape[1]
    return rfft(np.concatenate((half, half[:, rest:0:-1]), axis=1), axis=1).real


def bickley_1(x: Array) -> Array:
    """Ki₁(x) = ∫ₓ^∞ K₀(t) dt = ∫₀^∞ exp(−x cosh θ)/cosh θ dθ for x >= 0, to 1e-15.

    The trapezoidal rule converges exponentially because the integrand is even and decays doubly exponentially.

    >>> bool(abs(bickley_1(np.array([0.0]))[0] - np.pi / 2) < 1e-14)
    True
    """
    out = np.zeros_like(x, dtype=float)
    live = x < 38.0  # Ki₁(38) < 1e-17
    xs = x[live]
    # h = 1/6 leaves an error of exp(−π²/h): below rounding
    h = 1 / 6
    θ_end = float(np.arccosh(max(1.0, 40.0 / max(float(xs.min(initial=40.0)), 1e-16))))
    total = np.zeros_like(xs)
    for m in range(int(θ_end / h) + 2):
        c = np.cosh(m * h)
        total += (0.5 if m == 0 else 1.0) * np.exp(-xs * c) / c
    out[live] = h * total
    return out


def strip_symbol(n_free: int, d_free: float, q: Array, d_other: float, modulus: float) -> Array:
    """One free axis of pixels d_free, the other periodic or mirrored with wave numbers q: (half of it padded, q.size).

    A wave q along the other axis decays as (2/πE*) K₀(|q||x|) across it; q = 0 is the plane-strain logarithm, whose
    constant is arbitrary. Pressure is constant on each pixel, so every q brings its aliases q + 2πm/Δ: the sum is
    Love's solution summed over all periodic images, to rounding. Aliases decay exponentially with the distance;
    their part at zero distance is an alternating series with a closed form.
    """
    length = padded_length(n_free)
    width = max(1, _STRIP_VALUES // length)
    parts = [
        _strip_columns(n_free, length, d_free, q[j : j + width], d_other)
        for j in range(0, q.size, width)
    ]
    return np.concatenate(parts, axis=1) * (2 / (np.pi * modulus))


def _strip_columns(n: int, length: int, d: float, q: Array, d_other: float) -> Array:
    """Half of the transform of the kernel of a free axis for some waves q, see `strip_symbol`.

    The kernel is even about 0; offsets beyond n − 1 have no effect on the result.
    """
    kernel = np.zeros((q.size, length // 2 + 1))
    live = q > 0
    p = q[live]
    period = 2 * np.pi / d_other
    a = p / period
    waves = np.zeros((p.size, kernel.shape[1]))
    for m in range(int(38 * d_other / (np.pi * d)) + 2):
        for sign in (1, -1) if m else (1,):
            _add_wave(waves, d, np.abs(p + sign * m * period), np.sinc(a + sign * m))
    # Σ_m sinc(π(a + m)) π/|q_m|: the integral of every alias over the whole line
    waves[:, 0] += np.sin(np.pi * a) / period * (_alternating(a) + _alternating(1 - a))
    kernel[live] = waves
    t1, t2 = ((np.arange(kernel.shape[1]) + side) / n for side in (-0.5, 0.5))
    kernel[~live] = -n * d * (t2 * np.log(t2) - t1 * np.log(np.abs(t1)) - (t2 - t1))
    return _even_transform(kernel, length).T


def _add_wave(waves: Array, d: float, q: Array, weight: Array) -> None:
    """Add weight · ∫ K₀(q|t|) dt over the pixels at 0, d, 2d, …; at 0 minus what lies outside the pixel."""
    near = min(waves.shape[1], int(38 / (q.min(initial=np.inf) * d) + 0.5) + 1)
    beyond = bickley_1(q[:, None] * ((np.arange(near) + 0.5) * d))
    beyond *= (weight / q)[:, None]
    waves[:, 0] -= 2 * beyond[:, 0]
    waves[:, 1:near] += beyond[:, :-1] - beyond[:, 1:]


def _alternating(a: Array) -> Array:
    """Σ_{m>=0} (−1)^m / (m + a)² for a > 0."""
    return (polygamma(1, a / 2) - polygamma(1, (a + 1) / 2)) / 4


def stiffness_stencil(spacing: Pair, modulus: float) -> Array:
    """3 × 3 truncation of the inverse operator, symbol E*|q|/2 [Pa/m]: the preconditioner of the solver.

    A truncation that is not positive definite (strongly stretched pixels) is reduced to its diagonal.
    """
    q = np.hypot(*np.ix_(*(2 * np.pi * np.abs(np.fft.fftfreq(64, d)) for d in spacing)))
    corner = np.fft.ifft2(modulus * q / 2).real[:2, :2]
    # the symbol is linear in the cosines along both axes: its extremes are where these are 1 and −1
    ends = np.array([[1, 2], [1, -2]])
    symbol = ends @ corner @ ends.T
    if symbol.min() <= 1e-3 * symbol.max():
        corner = np.diag([corner[0, 0], 0.0])
    mirrored = [1, 0, 1]
    return corner[mirrored][:, mirrored]
