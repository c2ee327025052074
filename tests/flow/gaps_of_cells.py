"""Gaps of cells whose flow is tested, and the gap between two pixels as the documentation states it."""

import numpy as np

D = 1e-6


def rough_heights(shape, seed=0, cut=8):
    """Periodic self-affine heights with the standard deviation D, of waves of at least `cut` pixels."""
    rng = np.random.default_rng(seed)
    q = np.hypot(np.fft.fftfreq(shape[0])[:, None], np.fft.fftfreq(shape[1])[None, :])
    amplitude = np.where((q > 0) & (q <= 1 / cut), np.maximum(q, 4 / max(shape)) ** -1.8, 0.0)
    h = np.fft.ifft2(np.fft.fft2(rng.standard_normal(shape)) * amplitude).real
    return h / h.std() * D


def cut_by_plane(shape, contact_fraction, seed=0, cut=8):
    """Gap between a rough surface and a plane that cuts off its lowest part; the cut part is the contact."""
    h = rough_heights(shape, seed, cut)
    return np.maximum(h - np.quantile(h, contact_fraction), 0.0)


def gap_between_pixels(before, a, b, after):
    """Gap midway between the pixels a and b of a column, as documented: a cubic with limits."""
    smaller = np.minimum(a, b)
    bends = np.stack([before - 2 * a + b, a - 2 * b + after])
    cubic = (a + b) / 2 - bends.sum(axis=0) / 16
    least = np.maximum(bends.min(axis=0), 0)
    limited = (a + b) / 2 - (least + np.minimum(bends.max(axis=0), 4 * least)) / 16
    middle = np.maximum(cubic, np.minimum(limited, 0.88 * smaller))
    return np.clip(middle, 0.1 * smaller, 4 * smaller)
