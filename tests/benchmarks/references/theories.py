"""Theories of contact where they are right in a limit: Persson, Bush, Gibson & Thomas, Greenwood & Williamson."""

from __future__ import annotations

import numpy as np

from .faces import MODULUS, SLOPE, rough


def persson(n=1024, loads=(0.005, 0.01, 0.02, 0.05, 0.1, 0.2, 0.5), seeds=(1, 2)):
    """Area fraction, corrected for its edges, at p̄ over E*h′, mean of faces with 16 pixels per shortest wave."""
    from femseal import solve_contact

    area = np.zeros(len(loads))
    for seed in seeds:
        gap0, body = rough(n, pixels_per_wave=16, waves=4, rng=seed)
        for i, load in enumerate(loads):
            contact = solve_contact(gap0, body, pressure=load * MODULUS * SLOPE)
            area[i] += contact.area_fraction_corrected / len(seeds)
    return {"n": n, "load": np.array(loads), "area": area}


def greenwood_williamson(n=2048, across=8, spreads=(4e-3, 1e-3, 2.5e-4), rng=1):
    """Contact area against that of Greenwood & Williamson, for summits of one radius with exponential heights.

    The summits stand on a square lattice and keep their drawn heights, so that the sums over summits, not their
    expectations, are compared, at the load at which half of the summits touch. Spreads of the heights are over the
    period of the lattice: the smaller, the farther summits are apart beside their contacts. `interacting` is the
    theory's area where summits also push each other down.
    """
    from femseal import HalfSpace, solve_contact

    period = n // across * 1e-6
    radius = 4 * period
    x = (np.arange(n // across) + 0.5) * 1e-6 - period / 2
    paraboloid = np.tile((x[:, None] ** 2 + x**2) / (2 * radius), (across, across))
    body = HalfSpace((n, n), (1e-6, 1e-6), MODULUS)
    nominal = (across * period) ** 2
    records = []
    for spread in spreads:
        height = spread * period * np.random.default_rng(rng).exponential(size=(across, across))
        depth = np.maximum(height - np.median(height), 0)
        load = 4 / 3 * MODULUS * np.sqrt(radius) * np.sum(depth**1.5) / nominal
        theory = np.pi * radius * np.sum(depth) / nominal
        pushed = interacting_depth(height, radius, load * nominal, body)
        gap0 = paraboloid - height.repeat(n // across, 0).repeat(n // across, 1)
        area = solve_contact(gap0, body, pressure=load).area_fraction_corrected
        records.append(
            {
                "spread": spread,
                "load": load / MODULUS,
                "area": area,
                "theory": float(theory),
                "interacting": float(np.pi * radius * np.sum(pushed) / nominal),
            }
        )
    return records


def interacting_depth(height, radius, force, body):
    """Depth (m, m) [m] of each Hertz contact of a lattice of summits under a total force [N].

    The force of a summit pushes the others down as a point force, and itself by its periodic images, which is
    −3.9002649 F/(πE*L) of a square of side L.
    """
    from scipy.optimize import brentq

    step = body.shape[0] // height.shape[0]
    point = np.zeros(body.shape)
    point[0, 0] = 1 / np.prod(body.spacing)
    influence = body.displacement(point)[::step, ::step].copy()
    influence[0, 0] = -3.9002649 / (np.pi * body.modulus * body.shape[0] * body.spacing[0])
    forces = np.zeros_like(height)
    for _ in range(100):
        free = height - np.fft.ifft2(np.fft.fft2(influence) * np.fft.fft2(forces)).real

        def carried(level, free=free):
            return 4 / 3 * body.modulus * np.sqrt(radius) * np.maximum(free - level, 0) ** 1.5

        level = brentq(lambda z, f=carried: f(z).sum() - force, free.min() - 10 * np.ptp(height), free.max())
        before, forces = forces, (forces + carried(level)) / 2
        if np.abs(forces - before).max() < 1e-9 * force:
            break
    return np.maximum(free - level, 0)


def draw_persson(record, ax):
    from scipy.special import erf

    load, area = record["load"], record["area"]
    ax.semilogx(load, area / load, "o-", label=f"femseal, {record['n']}²")
    ax.semilogx(load, erf(np.sqrt(2) * load) / load, "k--", label="Persson")
    ax.axhline(np.sqrt(2 * np.pi), color="k", ls=":", label="√(2π), Bush, Gibson & Thomas")
    ax.set(xlabel="p̄ / E*h′", ylabel="contact area / (p̄/E*h′)", title="contact area of a self-affine face")
    ax.legend()


def persson_line(record):
    load, area = record["load"], record["area"]
    light = ", ".join(f"{k:.2f}" for k in (area / load)[:4])
    return [
        "Contact area κ p̄/E*h′ at small loads, √(8/π) = 1.60 < κ < √(2π) = 2.51",
        "Persson, J. Chem. Phys. 115, 2001, 3840; Bush, Gibson & Thomas, Wear 35, 1975, 87",
        f"κ = {light} at p̄/E*h′ = {', '.join(f'{x:g}' for x in load[:4])}, {record['n']}², two faces",
    ]


def greenwood_williamson_line(records):
    figures = ", ".join(
        f"{r['area'] / r['theory']:.3f} at {r['spread']:g} (interacting: {r['interacting'] / r['theory']:.3f})"
        for r in records
    )
    return [
        "Contact area of summits far apart beside their contacts",
        "Greenwood & Williamson, Proc. R. Soc. A 295, 1966, 300",
        f"area over the theory's: {figures}, by the spread of heights over the distance of summits. What is missing is that "
        "summits push each other down: with that as point forces the theory has the same area. Both tend to 1 as 1 − c√spread",
    ]
