"""Waves of a map of cell-centred samples: Fourier on periodic axes, even (mirror) extension on others.

The even extension of cell-centred samples is the cosine transform DCT-II, on the same n points.

Symbols: z heights (n1, n2) [m], d spacing [m], q angular wavenumber [rad/m], k number of the wave along an
axis. A wave of number k along a periodic axis of length L is exp(i q x), q = 2πk/L, k = −n/2 … n/2; along a
mirror axis cos(q x), q = πk/L, k = 0 … n−1. x = 0 is the edge of the first pixel, not its centre.
"""

import numpy as np
import scipy
from numpy.typing import NDArray

from ..base import Pair, Periodic, Shape

#: Relative slack on a limit of wavenumber, so that rounding does not decide on the wave exactly at the limit.
SLACK = 1e-9


def power(z: NDArray, periodic: Periodic) -> NDArray:
    """Fraction (n1, n2) of each wave in the mean square of `z` [m²]; the sum is the mean square (Parseval)."""
    mirrored, wrapped = _axes(periodic)
    c = scipy.fft.dctn(z, axes=mirrored, norm="ortho") if mirrored else z
    c = scipy.fft.fftn(c, axes=wrapped, norm="ortho") if wrapped else c
    return (c * c.conj()).real / z.size


def wavenumbers(n: int, d: float, periodic: bool) -> NDArray:
    """Wavenumbers q (n,) [rad/m] of an axis in the order of transforms; signed on a periodic axis."""
    return 2 * np.pi * scipy.fft.fftfreq(n, d) if periodic else np.pi * np.arange(n) / (n * d)


def wavenumber_grids(shape: Shape, spacing: Pair, periodic: Periodic) -> tuple[NDArray, NDArray]:
    """q1 (n1, 1) and q2 (1, n2) [rad/m]."""
    q1, q2 = (wavenumbers(*axis) for axis in zip(shape, spacing, periodic, strict=True))
    return q1[:, None], q2[None, :]


def truncate(z: NDArray, spacing: Pair, periodic: Periodic, limit: float) -> NDArray:
    """Waves of `z` with |q| <= `limit` [rad/m]."""
    mirrored, wrapped = _axes(periodic)
    c = scipy.fft.dctn(z, axes=mirrored, norm="ortho") if mirrored else z
    # of the last periodic axis waves k >= 0 alone
    c = scipy.fft.rfftn(c, axes=wrapped, norm="ortho") if wrapped else c
    q1, q2 = wavenumber_grids((z.shape[0], z.shape[1]), spacing, periodic)
    c[q1[: c.shape[0]] ** 2 + q2[:, : c.shape[1]] ** 2 > (limit * (1 + SLACK)) ** 2] = 0
    if wrapped:
        c = scipy.fft.irfftn(
            c, [z.shape[axis] for axis in wrapped], axes=wrapped, norm="ortho", overwrite_x=True
        )
    return scipy.fft.idctn(c, axes=mirrored, norm="ortho", overwrite_x=True) if mirrored else c


def resample_axis(z: NDArray, n: int, axis: int, periodic: bool) -> NDArray:
    """Interpolant of `z` at the centres of `n` pixels along `axis`, without waves too short for them.

    Exact for band-limited data. With m points before and n after, coefficient k turns by the phase
    exp(iπk(1/n − 1/m)), because the first pixel centre moves from d_m/2 to d_n/2.
    """
    m = z.shape[axis]
    if m == n:
        return z
    if not periodic:
        return scipy.fft.idct(_fit(scipy.fft.dct(z, axis=axis), n, axis), axis=axis) * (n / m)
    k = np.arange(min(m, n) // 2 + 1)
    weight = np.exp(1j * np.pi * k * (1 / n - 1 / m)) * (n / m)
    # The sampled Nyquist wave stands for a pair ±k: going up it is shared between both, going down it
    # collects both.
    if min(m, n) % 2 == 0:
        weight[-1] *= 0.5 if m < n else 2.0
    shape = [1, 1]
    shape[axis] = k.size
    kept = _fit(scipy.fft.rfft(z, axis=axis), k.size, axis) * weight.reshape(shape)
    return scipy.fft.irfft(kept, n, axis=axis)


def _axes(periodic: Periodic) -> tuple[list[int], list[int]]:
    """Mirror axes and periodic ones."""
    return [k for k in (0, 1) if not periodic[k]], [k for k in (0, 1) if periodic[k]]


def _fit(c: NDArray, n: int, axis: int) -> NDArray:
    """First `n` coefficients along `axis`, zeros behind where there are fewer."""
    kept = np.moveaxis(c, axis, 0)[:n]
    missing = np.zeros((n - len(kept), kept.shape[1]), c.dtype)
    return np.moveaxis(np.concatenate((kept, missing)), 0, axis)
