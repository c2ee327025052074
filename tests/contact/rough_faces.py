"""Rough faces of contacts."""

import numpy as np

D = 1e-6


def rough_face(shape, slope=0.2, seed=0, spacing=(D, D), cut=6):
    """Self-affine heights of the given rms slope, waves longer than `cut` of the finer pixels."""
    q = np.hypot(*np.ix_(*map(np.fft.fftfreq, shape, spacing)))
    roll_off = 4 / np.max(np.multiply(shape, spacing))
    waves = (q > 0) & (q * min(spacing) <= 1 / cut)
    amplitude = np.where(waves, np.maximum(q, roll_off) ** -1.8, 0.0)
    noise = np.random.default_rng(seed).standard_normal(shape)
    h = np.fft.ifft2(np.fft.fft2(noise) * amplitude).real
    slopes = [np.diff(h, axis=a) / spacing[a] for a in (0, 1)]
    rms = np.sqrt(sum((s**2).mean() for s in slopes if s.size))
    return h * slope / rms if rms > 0 else 0 * h
