"""Compare contact areas with theories in their limiting cases: Persson, Greenwood & Williamson."""

from __future__ import annotations

import numpy as np
from scipy.optimize import brentq

from femseal import HalfSpace, solve_contact

from .faces import MODULUS, SLOPE, rough


def small_loads(n=1024, loads=(0.005, 0.01, 0.02, 0.05), seeds=(1, 2)):
    """Compute κ, the corrected contact fraction over p̄/E*h′, as a mean over surfaces with 16 pixels per shortest wave."""
    kappa = np.zeros((len(seeds), len(loads)))
    for s, seed in enumerate(seeds):
        gap0, body = rough(n, pixels_per_wave=16, waves=4, rng=seed)
        for i, load in enumerate(loads):
            contact = solve_contact(gap0, body, pressure=load * MODULUS * SLOPE)
            kappa[s, i] = contact.area_fraction_corrected / load
    return {"load": np.array(loads), "κ": kappa.mean(axis=0)}


def greenwood_williamson(n=2048, across=8, spreads=(4e-3, 1e-3, 2.5e-4)):
    """Compare the contact area of summits with exponential heights with the theory of Greenwood & Williamson.

    The summits have the same radius and stand on a square lattice. The theory is evaluated by sums over their
    random heights, not by expectations, at the load at which half of the summits touch. The spread of the
    heights is given in periods of the lattice. "interacting" is the area of the theory in which summits also
    push each other down.
    """
    period = n // across * 1e-6
    radius = 4 * period
    x = (np.arange(n // across) + 0.5) * 1e-6 - period / 2
    paraboloid = np.tile((x[:, None] ** 2 + x**2) / (2 * radius), (across, across))
    body = HalfSpace((n, n), (1e-6, 1e-6), MODULUS)
    nominal = (across * period) ** 2
    records = []
    for spread in spreads:
        drawn = np.random.default_rng(1).exponential(size=(across, across))
        height = spread * period * drawn
        depth = np.maximum(height - np.median(height), 0)
        force = np.sum(hertz(depth, radius))
        pushed = interacting_depth(height, radius, force, body)
        gap0 = paraboloid - height.repeat(n // across, 0).repeat(n // across, 1)
        area = solve_contact(gap0, body, pressure=force / nominal).area_fraction_corrected
        theory, interacting = (np.pi * radius * np.sum(d) / nominal for d in (depth, pushed))
        ratios = {"area over theory": area / theory, "interacting": interacting / theory}
        records.append({"spread": spread} | ratios)
    return records


def hertz(depth, radius):
    """Compute the force on a sphere [N] from its depth [m]."""
    return 4 / 3 * MODULUS * np.sqrt(radius) * depth**1.5


def interacting_depth(height, radius, force, body):
    """Compute the depth (m, m) [m] of each Hertz contact of a lattice of summits under a total force [N].

    The force on a summit acts on all other summits as a point force. By its periodic images, it also acts on
    the summit itself: the displacement is −3.9002649 F/(πE*L) on a square of side L.
    """
    step = body.shape[0] // height.shape[0]
    point = np.zeros(body.shape)
    point[0, 0] = 1 / np.prod(body.spacing)
    influence = body.displacement(point)[::step, ::step].copy()
    influence[0, 0] = -3.9002649 / (np.pi * body.modulus * body.shape[0] * body.spacing[0])
    forces = np.zeros_like(height)
    for _ in range(100):
        free = height - np.fft.ifft2(np.fft.fft2(influence) * np.fft.fft2(forces)).real

        def carried(level, free=free):
            """Compute the forces on the summits for a level of the flat."""
            return hertz(np.maximum(free - level, 0), radius)

        def missing(level, carried=carried):
            """Compute the difference between the carried force and the given force."""
            return carried(level).sum() - force

        level = brentq(missing, free.min() - 10 * np.ptp(height), free.max())
        before, forces = forces, (forces + carried(level)) / 2
        if np.abs(forces - before).max() < 1e-9 * force:
            break
    return np.maximum(free - level, 0)
