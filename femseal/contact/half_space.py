"""Describe the elastic half-space: its boundaries, the symbol of its compliance, and displacements due to pressures.

The symbol of the compliance K is the array of its eigenvalues, which are real. E* is the contact modulus, q a wave
vector [rad/m], Δ the length of a pixel, K₀ a modified Bessel function, and Ki₁(x) = ∫ₓ^∞ K₀ the Bickley function.
Sources: Johnson, Contact Mechanics, 1985, ch. 3 and 13; Love, Phil. Trans. R. Soc. A 228, 1929, 377 (pixel under
constant pressure); Liu, Wang & Liu, Wear 243, 2000, 101 (free boundaries by FFT).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from math import prod

import numpy as np
from numpy.typing import ArrayLike
from scipy.fft import dct
from scipy.special import polygamma

from ..base import Array, InputError, Pair, Shape, validate
from .convolution import Boundary, Convolution, padded_length
from .layered import (
    Bodies,
    checked_modulus,
    modulus_of_waves,
    scaled,
    surface_modulus,
)
from .layered_free_axes import free_difference, strip_difference

BOUNDARIES = ("periodic", "mirror", "free")
#: Number of kernel values that are computed at a time for a single free axis, to limit the memory.
_STRIP_VALUES = 2**20
#: Argument above which Ki₁ is smaller than 1e-17.
_LARGEST_ARGUMENT = 38.0
#: Largest number of pixels. The contact solver numbers them by integers of 32 bits, which take less memory.
_MOST_POINTS = 2**31 - 1


@dataclass(frozen=True)
class HalfSpace:
    """An elastic half-space with pressures p and displacements u = K p on a grid of pixels.

    On periodic axes the Fourier coefficients of the displacement are û = 2 p̂/(E*|q|), and the mean displacement is
    arbitrary. On a mirror axis, the pressure is mirrored beyond both ends. A cosine transform over the grid points is
    then exact. Along a free axis, the pressure is constant within each pixel, and 0 beyond the ends of the axis.

    Parameters
    ----------
    shape : pair of int
        Numbers of pixels (n1, n2).
    spacing : pair of float
        Spacing (Δ1, Δ2) of the pixels [m].
    modulus : float or pair of bodies
        Contact modulus E* [Pa]; or the two bodies in contact, each a `Solid`, a `Coated`, or None for a rigid body. For
        two bodies without a coating, the attribute `modulus` is their contact modulus.
    boundary : str or pair of str
        Kind of boundary of each axis: "periodic", "mirror" or "free". A single string applies to both axes.

    Raises
    ------
    InputError
        A shape, spacing, modulus or kind of boundary is not allowed, or there are more than 2³¹ − 1 pixels.

    Notes
    -----
    Sources: Johnson, Contact Mechanics, 1985; Stanley & Kato, J. Tribol. 119, 1997, 481 (periodic); Liu, Wang & Liu,
    Wear 243, 2000, 101 (free).

    If one axis is free and the pressure varies only along this axis, the displacement is logarithmic, as in plane
    strain. The constant of the logarithm is arbitrary. The mean of `displacement` is therefore arbitrary as well.

    Free axes are padded to lengths whose transforms are fast. Periodic and mirror axes cannot be padded. A large prime
    factor in the number of points of an axis makes the transforms slow: 1021² points take 8 times as long as 1024²
    points. `Topography.resample` can change the number of points.

    Examples
    --------
    >>> body = HalfSpace((64, 64), (1e-6, 1e-6), modulus=115e9, boundary=("free", "periodic"))
    >>> body.displacement(np.zeros((64, 64))).shape
    (64, 64)
    """

    shape: Shape
    spacing: Pair
    modulus: float | Bodies
    boundary: Boundary = ("periodic", "periodic")

    def __post_init__(self) -> None:
        object.__setattr__(self, "shape", validate.grid("shape", self.shape))
        if prod(self.shape) > _MOST_POINTS:
            raise InputError("shape", self.shape, f"at most {_MOST_POINTS} pixels")
        object.__setattr__(self, "spacing", validate.lengths("spacing", self.spacing))
        object.__setattr__(self, "modulus", checked_modulus(self.modulus))
        ends = (self.boundary,) * 2 if isinstance(self.boundary, str) else self.boundary
        is_pair = isinstance(ends, (tuple, list)) and len(ends) == 2
        if not (is_pair and all(end in BOUNDARIES for end in ends)):
            kinds = f"one of {', '.join(BOUNDARIES)} for each axis"
            raise InputError("boundary", self.boundary, kinds)
        object.__setattr__(self, "boundary", tuple(ends))

    @cached_property
    def pixel_modulus(self) -> float:
        """Contact modulus E* [Pa] for a wave with the length of four pixels.

        For bodies without a coating, E* does not depend on the wavelength.
        """
        wave = np.array(np.pi / (2 * self._mean_spacing))
        return float(modulus_of_waves(self.modulus, wave))

    @cached_property
    def _mean_spacing(self) -> float:
        """Geometric mean of the pixel lengths along both axes [m]; an axis with a single point is left out."""
        spacings = [d for n, d in zip(self.shape, self.spacing, strict=True) if n > 1]
        if not spacings:
            spacings = [min(self.spacing)]
        return float(np.prod(spacings) ** (1 / len(spacings)))

    @cached_property
    def stiffness(self) -> float:
        """Stiffness c = πE*/(4Δ) [Pa/m] of the half-space for a wave with the length of four pixels.

        The contact solver multiplies gaps by c to obtain pressures. Δ is the geometric mean of the pixel lengths along
        both axes; an axis with a single point is ignored.
        """
        return np.pi * self.pixel_modulus / (4 * self._mean_spacing)

    @cached_property
    def of_unit_modulus(self) -> HalfSpace:
        """Half-space whose moduli are divided by `pixel_modulus`, so that displacements are larger by this factor."""
        if isinstance(self.modulus, float):
            return replace(self, modulus=1.0)
        return replace(self, modulus=scaled(self.modulus, 1 / self.pixel_modulus))

    @cached_property
    def coarser(self) -> HalfSpace:
        """Half-space of the same area on the next coarser grid, with about half as many points along each axis."""
        n1, n2 = self.shape
        d1, d2 = self.spacing
        spacing = (2 * d1 if n1 > 1 else d1, 2 * d2 if n2 > 1 else d2)
        return replace(self, shape=((n1 + 1) // 2, (n2 + 1) // 2), spacing=spacing)

    def symbol(self) -> Array:
        """Compute the eigenvalues of K [m/Pa].

        The eigenvectors of K are waves along periodic axes and padded free axes, and cosines along mirror axes. An
        eigenvalue does not depend on the signs of the wave numbers. The array therefore includes only waves with
        non-negative wave numbers. Along a mirror axis with n points, the array includes n cosines.
        """
        n1, n2 = self.shape
        d1, d2 = self.spacing
        b1, b2 = self.boundary
        if b1 == b2 == "free":
            return free_symbol(self.shape, self.spacing, self.modulus)
        q1 = wave_numbers(n1, d1, b1)
        q2 = wave_numbers(n2, d2, b2)
        if b1 == "free":
            return strip_symbol(n1, d1, q2, d2, self.modulus)
        if b2 == "free":
            return np.ascontiguousarray(strip_symbol(n2, d2, q1, d1, self.modulus).T)
        wave = np.hypot(q1[:, None], q2)
        if isinstance(self.modulus, float):
            stiffness = self.modulus * wave
        else:
            stiffness = modulus_of_waves(self.modulus, wave) * wave
        # the mean displacement is arbitrary, so that the eigenvalue for q = 0 is set to 0
        symbol = np.zeros_like(stiffness)
        return np.divide(2.0, stiffness, out=symbol, where=wave > 0)

    def displacement(self, pressure: ArrayLike) -> Array:
        """Compute the displacement u = K p (n1, n2) [m] due to pressures p (n1, n2) [Pa]."""
        p = validate.field("pressure", pressure, unit="Pa", shape=self.shape)
        product = Convolution(self.shape, self.boundary, self.symbol())
        product.pressure[:] = p
        product.apply()
        return np.ascontiguousarray(product.displacement)


def wave_numbers(n: int, spacing: float, kind: str) -> Array:
    """Return the wave numbers |q| [rad/m] of an axis with n points, in the order of its transform.

    A periodic axis has the non-negative wave numbers of a real Fourier transform. A mirror axis has the wave numbers
    πk/(nΔ) of a cosine transform, which are those of a periodic axis of twice the length.
    """
    if kind == "mirror":
        return np.pi / (n * spacing) * np.arange(n, dtype=float)
    return 2 * np.pi / (n * spacing) * np.arange(n // 2 + 1, dtype=float)


def _love(x: Array, y: Array) -> Array:
    """Evaluate the indefinite integral of 1/√(x² + y²) over both coordinates; x and y must not be 0."""
    return x * np.arcsinh(y / np.abs(x)) + y * np.arcsinh(x / np.abs(y))


def free_symbol(shape: Shape, spacing: Pair, modulus: float | Bodies) -> Array:
    """Compute the eigenvalues of the compliance K [m/Pa] for two free axes.

    The eigenvalues are the Fourier transform of Love's solution, the displacement around a pixel under constant
    pressure. Love's solution applies to a half-space without a coating. For coated bodies, the change in
    displacement due to the coatings is added, see `layered_free_axes.free_difference`.
    """
    length1, length2 = (padded_length(n) for n in shape)
    d1, d2 = spacing
    x = (np.arange(length1 // 2 + 2, dtype=float) - 0.5) * d1  # edges of the pixels
    y = (np.arange(length2 // 2 + 2, dtype=float) - 0.5) * d2
    potential = _love(x[:, None], y)
    kernel = np.diff(np.diff(potential, axis=0), axis=1) / (np.pi * surface_modulus(modulus))
    if not isinstance(modulus, float):
        kernel += free_difference(x, y, modulus)
    return _even_transform(_even_transform(kernel, axis=1), axis=0)


def _even_transform(half: Array, axis: int) -> Array:
    """Compute the Fourier transform of even functions of the position along an axis, given only their first half.

    The first half contains the values at 0 and at half of the period. The transform is real and even as well, and only
    its first half is returned.
    """
    if half.shape[axis] == 1:
        return half  # an axis with a single point, whose period is one point
    return dct(half, type=1, axis=axis)


def bickley_1(x: Array) -> Array:
    """Compute the Bickley function Ki₁(x) = ∫ₓ^∞ K₀(t) dt = ∫₀^∞ exp(−x cosh θ)/cosh θ dθ for x >= 0.

    The integral over θ is computed by the trapezoidal rule, with an error of about 1e-15. The integrand is even and
    decays doubly exponentially. The rule therefore converges exponentially as the interval of θ is reduced.

    Examples
    --------
    >>> bool(abs(bickley_1(np.array([0.0]))[0] - np.pi / 2) < 1e-14)
    True
    """
    out = np.zeros_like(x, dtype=float)
    is_significant = x < _LARGEST_ARGUMENT
    xs = x[is_significant]
    h = 1 / 6  # interval of θ; the error of the rule is exp(−π²/h), which is below rounding
    # the integrand is negligible from x cosh θ = 40 on
    smallest_x = max(float(xs.min(initial=40.0)), 1e-16)
    θ_end = float(np.arccosh(max(1.0, 40.0 / smallest_x)))
    total = np.zeros_like(xs)
    for m in range(int(θ_end / h) + 2):
        weight = 0.5 if m == 0 else 1.0
        cosh_θ = np.cosh(m * h)
        total += weight * np.exp(-xs * cosh_θ) / cosh_θ
    out[is_significant] = h * total
    return out


def strip_symbol(
    n_free: int, d_free: float, q: Array, d_other: float, modulus: float | Bodies
) -> Array:
    """Compute the eigenvalues of the compliance K [m/Pa] for one free axis and one periodic or mirror axis.

    Consider a line load that varies as a wave q along the periodic or mirror axis. At a distance x along the free axis,
    the displacement due to this load is (2/πE*) K₀(|q||x|). For q = 0, the displacement is the logarithmic solution of
    plane strain, which contains an arbitrary constant.

    A pressure wave q that is represented by constant pixel values also contains the aliases q + 2πm/Δ for all integers
    m. The displacement due to the pressure on a pixel is therefore a sum over all aliases. The contribution of an alias
    to the displacement decays exponentially with the distance x. At x = 0, the sum over the aliases is an alternating
    series with a closed form. The sum over the aliases is equal to the sum of Love's solutions for all periodic images
    of the pixel.

    For coated bodies, the change in displacement due to the coatings is added, see
    `layered_free_axes.strip_difference`.

    Parameters
    ----------
    n_free : int
        Number of points along the free axis.
    d_free : float
        Spacing along the free axis [m].
    q : array (waves,)
        Wave numbers along the periodic or mirror axis [rad/m].
    d_other : float
        Spacing along the periodic or mirror axis [m].
    modulus : float or pair of bodies
        Contact modulus E* [Pa], or the two bodies.

    Returns
    -------
    array (half of the padded length of the free axis, waves)
    """
    length = padded_length(n_free)
    # the kernels of some waves are transformed at a time, to limit the memory
    width = max(1, _STRIP_VALUES // length)  # number of waves at a time
    parts = [
        _strip_columns(n_free, length, d_free, q[j : j + width], d_other)
        for j in range(0, q.size, width)
    ]
    symbol = np.concatenate(parts, axis=1) * (2 / (np.pi * surface_modulus(modulus)))
    if not isinstance(modulus, float):
        # kernel (wave, offset); its values at offsets of more than n_free − 1 pixels do not matter
        difference = np.zeros((q.size, length // 2 + 1))
        n_offsets = min(n_free, difference.shape[1])
        kernel = strip_difference(n_free, d_free, q, d_other, modulus)
        difference[:, :n_offsets] = kernel[:, :n_offsets]
        symbol += _even_transform(difference, axis=1).T
    return symbol


def _strip_columns(n: int, length: int, d: float, q: Array, d_other: float) -> Array:
    """Compute the Fourier transform, along a free axis, of the kernels of some waves q; see `strip_symbol`.

    A kernel is the displacement as a function of the offset from the loaded pixel. Because each kernel is an even
    function of the offset, the first half of its transform is sufficient. The kernel at offsets of more than n − 1
    pixels has no influence on the displacement of the n points.

    n : number of points of the free axis.
    length : padded length of the free axis, as a number of points.
    d : pixel length of the free axis [m].
    q : wave numbers along the periodic or mirror axis [rad/m].
    d_other : pixel length along the periodic or mirror axis [m].
    """
    kernel = np.zeros((q.size, length // 2 + 1))  # (wave, offset)
    is_wave = q > 0
    positive_q = q[is_wave]
    alias_distance = 2 * np.pi / d_other  # between the wave numbers of aliases
    a = positive_q / alias_distance
    # Kernels of the waves q > 0, (wave, offset). The alias q_m = q + 2πm/Δ adds sinc(π(a + m)) ∫ K₀(|q_m t|) dt.
    waves = np.zeros((positive_q.size, kernel.shape[1]))
    n_aliases = int(_LARGEST_ARGUMENT * d_other / (np.pi * d)) + 2
    for m in range(n_aliases):
        for sign in (1, -1) if m else (1,):
            alias = np.abs(positive_q + sign * m * alias_distance)
            _add_wave(waves, d, alias, np.sinc(a + sign * m))
    # The integral of K₀(|q_m t|) over the whole line is π/|q_m|. The sum Σ_m sinc(π(a + m)) π/|q_m| over all integers m
    # consists of an alternating series for m >= 0 and of one for m < 0.
    alternating = _alternating_sum(a) + _alternating_sum(1 - a)
    waves[:, 0] += np.sin(np.pi * a) / alias_distance * alternating
    kernel[is_wave] = waves
    # For q = 0, −ln|t| is integrated between the edges t1 and t2 of each pixel; lengths are divided by n d.
    t1 = (np.arange(kernel.shape[1]) - 0.5) / n
    t2 = (np.arange(kernel.shape[1]) + 0.5) / n
    kernel[~is_wave] = -n * d * (t2 * np.log(t2) - t1 * np.log(np.abs(t1)) - (t2 - t1))
    return _even_transform(kernel, axis=1).T


def _add_wave(waves: Array, d: float, q: Array, weight: Array) -> None:
    """Add one alias of each wave to the kernels (wave, pixel): weight · ∫ K₀(q|t|) dt over each pixel.

    The pixels lie at t = 0, d, 2d, … The integral over the pixel at t = 0 is that over the whole line minus that over
    |t| > d/2. Only the latter is subtracted here; the caller adds the former, for all aliases at once.

    waves : kernels (wave, pixel), which the function changes.
    d : pixel length [m].
    q : wave number of each wave's alias (wave,) [rad/m].
    weight : weight of each wave's alias (wave,).
    """
    # The integral of K₀(q|t|) from t to infinity is Ki₁(q t)/q. It is negligible beyond `n_near` pixels for all waves.
    reach = _LARGEST_ARGUMENT / (q.min(initial=np.inf) * d)
    n_near = min(waves.shape[1], int(reach + 0.5) + 1)
    edges = (np.arange(n_near) + 0.5) * d
    # weight · ∫ K₀(q|t|) dt from each edge to infinity, (wave, edge)
    beyond_edge = bickley_1(q[:, None] * edges)
    beyond_edge *= (weight / q)[:, None]
    waves[:, 0] -= 2 * beyond_edge[:, 0]  # on both sides of the pixel at t = 0
    waves[:, 1:n_near] += beyond_edge[:, :-1] - beyond_edge[:, 1:]


def _alternating_sum(a: Array) -> Array:
    """Compute Σ_{m>=0} (−1)^m / (m + a)² for a > 0."""
    return (polygamma(1, a / 2) - polygamma(1, (a + 1) / 2)) / 4


def stiffness_stencil(half_space: HalfSpace) -> Array:
    """Compute the preconditioner of the solver: the 3 × 3 weights [Pa/m] of an approximate inverse of K.

    On a periodic grid, the inverse of K is a convolution with the symbol E*|q|/2. The nine weights are the kernel of
    this convolution at the offsets −1, 0 and 1 along both axes.

    For very elongated pixels, a stencil with these weights would not be positive definite. In this case, all weights
    except the middle one are set to 0.
    """
    # symbol of the inverse of K on a periodic grid of 64² pixels
    q1, q2 = (2 * np.pi * np.abs(np.fft.fftfreq(64, d)) for d in half_space.spacing)
    q = np.hypot(q1[:, None], q2[None, :])
    inverse = np.zeros(q.shape)
    is_wave = q > 0
    inverse[is_wave] = modulus_of_waves(half_space.modulus, q[is_wave]) * q[is_wave] / 2
    # weights at the offsets 0 and +1 along both axes; the weights at −1 are the same
    quarter = np.fft.ifft2(inverse).real[:2, :2]
    # The symbol of the stencil is linear in the cosine along each axis, w₀ + 2 w₁ cos. Its smallest and largest values
    # therefore occur where the cosines are 1 or −1.
    at_cosines = np.array([[1, 2], [1, -2]])
    symbol = at_cosines @ quarter @ at_cosines.T
    # the factor 1e-3 also excludes stencils that are nearly singular
    is_positive_definite = symbol.min() > 1e-3 * symbol.max()
    if not is_positive_definite:
        quarter = np.diag([quarter[0, 0], 0.0])
    offsets = [1, 0, 1]  # distances of the rows and columns of the stencil from its middle
    return quarter[offsets][:, offsets]
