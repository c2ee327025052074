"""Compare quick estimates from the spectrum alone with the solution of contact and flow.

    python tests/benchmarks/quick_estimate.py --write

The script solves 100 surfaces of 128² to 256² points: self-affine surfaces with waves as long as the surface or
with a roll-off, bumpy surfaces with few waves, and turned surfaces. Two thirds of the surfaces yield. By the
quick estimate, the contact fractions are 5 to 60 %. The script takes about a minute.
"""

from __future__ import annotations

import sys

import numpy as np

import femseal as fs
from common import machine, print_report, table
from femseal.checks import estimate_surface
from femseal.checks.quick_estimate import LIGHT_CONTACT
from femseal.persson import persson_area

SCENES, SIZE, MODULUS = 100, 1e-3, 1.15e11
KINDS = ("self-affine", "with a roll-off", "bumpy", "turned")


def face(kind: str, rng: np.random.Generator) -> fs.Topography:
    """Generate a surface of a kind, whose shortest wave has at least eight points."""
    n = int(rng.choice([128, 192, 256]))
    made = {"hurst": rng.uniform(0.5, 1.0), "rms_slope": 10 ** rng.uniform(-2, -0.7), "rng": rng}
    grid, side = (n, n), (SIZE, SIZE)
    if kind == "self-affine":
        return fs.self_affine(grid, side, cut_off=8 * SIZE / n, **made)
    if kind == "with a roll-off":
        return fs.self_affine(
            grid, side, cut_off=8 * SIZE / n, roll_off=SIZE / rng.uniform(3, 6), **made
        )
    if kind == "bumpy":
        return fs.self_affine(grid, side, cut_off=SIZE / 12, roll_off=SIZE / 6, **made)
    grooves = fs.turned(grid, side, pitch=SIZE / int(rng.integers(4, 9)), depth=2e-6, rng=rng)
    slope = rng.uniform(0.3, 1.5) * grooves.rms_slope
    return grooves + fs.self_affine(grid, side, cut_off=8 * SIZE / n, **made | {"rms_slope": slope})


def compare(number: int) -> tuple[float, float, float, float]:
    """Return the contact fraction and the permeability [m³] of a scene, as solved and by the quick estimate."""
    rng = np.random.default_rng([2026, number])
    surface = face(KINDS[number % len(KINDS)], rng)
    stiffness = MODULUS * surface.rms_slope
    hardness = stiffness * (10 ** rng.uniform(-1, 0) if rng.random() < 2 / 3 else np.inf)
    loads = np.geomspace(1e-4 * stiffness, min(3 * stiffness, 0.98 * hardness), 2000)
    pressure = float(
        np.interp(rng.uniform(0.05, 0.6), persson_area(loads, stiffness / 2, hardness), loads)
    )
    body = fs.HalfSpace(surface.shape, surface.spacing, MODULUS)
    contact = fs.solve_contact(surface.gap(), body, pressure=pressure, hardness=hardness, rtol=1e-4)
    solved = fs.cell_permeability(contact.gap, surface.spacing, sides="periodic").value
    estimate = estimate_surface(surface, MODULUS, hardness, [pressure])
    return contact.area_fraction, solved, float(estimate.area[0]), float(estimate.permeability[0])


def line(name: str, scenes: np.ndarray) -> list[str]:
    """Return a row of the table: numbers of scenes, and factors that cover 50 and 95 % of the open scenes.

    Open scenes leak both in the solution and in the quick estimate.
    """
    area, solved, estimated_area, estimate = scenes.T
    both = (solved > 0) & (estimate > 0)
    ratio = np.log(estimate[both] / solved[both])
    factors = [f"{np.exp(np.quantile(np.abs(ratio), part)):.2g}" for part in (0.5, 0.95)]
    sealed_only_in_one = [
        int(((a == 0) & (b > 0)).sum()) for a, b in ((solved, estimate), (estimate, solved))
    ]
    contact = [f"{np.quantile(estimated_area / area, part):.2f}" for part in (0.5, 0.05, 0.95)]
    head = [name, str(len(scenes)), str(int(both.sum())), f"{np.exp(np.median(ratio)):.2g}"]
    return [
        *head,
        *factors,
        *map(str, sealed_only_in_one),
        f"{contact[0]} ({contact[1]} to {contact[2]})",
    ]


def report() -> str:
    """Solve all scenes, and write the table."""
    scenes = np.array([compare(number) for number in range(SCENES)])
    kind = np.arange(SCENES) % len(KINDS)
    head = [
        "surfaces",
        "scenes",
        "open in both",
        "median of quick estimate / solution",
        "factor that covers 50 %",
    ]
    head += [
        "factor that covers 95 %",
        "sealed only in the solution",
        "sealed only in the quick estimate",
    ]
    head += ["contact fraction, quick estimate / solution"]
    lines = [line(name, scenes[kind == n]) for n, name in enumerate(KINDS)]
    light = scenes[:, 2] < LIGHT_CONTACT
    lines += [
        line(f"contact {name} {100 * LIGHT_CONTACT:g} %", scenes[part])
        for name, part in (("below", light), ("above", ~light))
    ]
    text = (
        "The limit of 30 % refers to the contact fraction of the quick estimate. The ratio and the factors of the "
        "leakage are computed only from scenes that are open both in the quick estimate and in the solution."
    )
    return f"{machine()}\n\n{table(head, [*lines, line('all', scenes)])}\n\n{text}"


if __name__ == "__main__":
    print_report(__file__, "Quick estimates", report(), write="--write" in sys.argv)
