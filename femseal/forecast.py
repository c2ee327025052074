"""What a run will compute, and about how long and in how much memory, before it is started."""

from __future__ import annotations

import numpy as np

from .case import Case, Prepared
from .quantities import to_text
from .studies import Sampling

#: Seconds of one core for one contact solution and one flow solution of n pixels, fitted to 32² … 512² on a 2-core
#: x86-64 machine; good to a factor of two.
_CONTACT_SECONDS = (4e-4, 3.0e-7, 1.0)
_FLOW_SECONDS = (2e-4, 4.4e-10, 1.75)


def _seconds(model: tuple[float, float, float], pixels: float) -> float:
    base, factor, power = model
    return base + factor * pixels**power * (np.log2(pixels) / 10 if power == 1.0 else 1.0)


def deterministic_cost(steps: int, points: tuple[int, int]) -> tuple[float, float]:
    """Expected time on one core [s] and memory [byte] of the deterministic solution."""
    pixels = points[0] * points[1]
    seconds = steps * (_seconds(_CONTACT_SECONDS, pixels) * 2 + _seconds(_FLOW_SECONDS, pixels))
    return seconds, 8.0 * pixels * (steps * 4 + 60 + 3 * np.log2(pixels))


def two_scale_cost(steps: int, points: tuple[int, int], cells: tuple[int, int]) -> tuple[float, float]:
    """Expected time on one core [s] and memory [byte] of the two-scale solution."""
    pixels, (m1, m2) = points[0] * points[1], cells
    window, links = pixels // (m1 * m2), m1 * m2 + (m1 - 1) * m2
    seconds = steps * (m1 * m2 * _seconds(_CONTACT_SECONDS, window) + links * _seconds(_FLOW_SECONDS, window))
    return seconds, 8.0 * pixels * steps * 4


def stochastic_cost(
    steps: int, points: tuple[int, int], cells: tuple[int, int], sampling: Sampling, links: int
) -> tuple[float, float]:
    """Expected time on one core [s] and memory [byte] of a library and of the seals, `links` long, drawn from it."""
    pixels, m1 = points[0] * points[1], cells[0]
    window = pixels // (m1 * cells[1])
    axes = 2 if sampling.pressure == "place" else 1
    once = axes * _seconds(_CONTACT_SECONDS, window) + 2 * _seconds(_FLOW_SECONDS, window)
    seconds = steps * sampling.library_cells * once
    seconds += sampling.realisations * steps * 3e-6 * m1 * links * max(1.0, np.log2(min(m1, links)))
    return seconds, 8.0 * (pixels * steps * 3 + m1 * links * steps * 4)


def links_along(prepared: Prepared) -> int:
    """Links of a drawn seal along its length."""
    assert prepared.cells is not None
    assert prepared.sampling is not None
    width = prepared.scene.surface.size[1] / prepared.cells[1]
    return max(1, round(prepared.sampling.length / width))


def describe(case: Case, prepared: Prepared) -> list[str]:
    """Lines that say what a run of the case computes: surface, steps, cells, unknowns, expected time and memory."""
    scene, report = prepared.scene, prepared.conditioning
    surface, steps = scene.surface, len(scene.steps)
    pixels = int(np.prod(surface.shape))
    lines = [
        f"case       {case.title or '(no title)'}: valid",
        f"surface    {surface}",
        f"           {report.undefined_share:.2%} undefined points and {report.spikes} in spikes filled, shortest wave "
        f"{to_text(report.shortest_wavelength, 'm', 3)}, "
        f"H/(E*·slope) {scene.hardness / scene.modulus / surface.rms_slope:.3g}",
        f"load       {steps} states: {len(scene.loading)} loading, "
        f"{steps - len({*scene.loading, *scene.unload_from})} unloading from {len(scene.unload_from)} peaks, "
        f"up to {to_text(max((*scene.loading, *scene.unload_from)), 'Pa', 3)}",
    ]
    if overlap := prepared.overlap:
        size = " × ".join(to_text(length, "m", 3) for length in overlap.size)
        resampled = ", the second resampled" if overlap.resampled else ""
        lines.insert(3, f"           two faces overlap on {size}, {overlap.share:.0%} of the first{resampled}")
    costs = [(0.0, 150e6)]
    if "deterministic" in case.methods:
        lines.append(f"determin.  {steps} contact and {steps} flow solutions of {pixels} unknowns")
        costs.append(deterministic_cost(steps, surface.shape))
    if prepared.cells is not None:
        m1, m2 = prepared.cells
        if "two-scale" in case.methods:
            links = m1 * m2 + (m1 - 1) * m2
            lines.append(
                f"two-scale  {m1} × {m2} cells of {surface.shape[0] // m1} × {surface.shape[1] // m2} pixels: "
                f"{steps * m1 * m2} contact and {steps * links} flow solutions"
            )
            costs.append(two_scale_cost(steps, surface.shape, prepared.cells))
        if prepared.sampling is not None:
            sampling = prepared.sampling
            n2 = links_along(prepared)
            lines.append(
                f"stochastic {sampling.library_cells} library cells ({sampling.pressure}), "
                f"{sampling.realisations} seals of {m1} × {n2} links, "
                f"{to_text(n2 * surface.size[1] / m2, 'm', 3)} long"
            )
            costs.append(stochastic_cost(steps, surface.shape, prepared.cells, sampling, n2))
    seconds, memory = (sum(cost) for cost in zip(*costs, strict=True))
    workers = "one core; two cores take about half"
    lines.append(f"expected   about {seconds:.0f} s on {workers}, {memory / 1e9:.1f} GB")
    return lines
