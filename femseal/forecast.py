"""What a run will compute, and about how long and in how much memory, before it is started."""

from __future__ import annotations

import numpy as np

from .case import Case, Prepared
from .quantities import to_text

#: Seconds of one core for one contact solution and one flow solution of n pixels, fitted to 32² … 512² on a 2-core
#: x86-64 machine; good to a factor of two.
_CONTACT_SECONDS = (4e-4, 3.0e-7, 1.0)
_FLOW_SECONDS = (2e-4, 4.4e-10, 1.75)


def _seconds(model: tuple[float, float, float], pixels: float) -> float:
    base, factor, power = model
    return base + factor * pixels**power * (np.log2(pixels) / 10 if power == 1.0 else 1.0)


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
    seconds, memory = 0.0, 150e6
    if "deterministic" in case.methods:
        lines.append(f"determin.  {steps} contact and {steps} flow solutions of {pixels} unknowns")
        seconds += steps * (_seconds(_CONTACT_SECONDS, pixels) * 2 + _seconds(_FLOW_SECONDS, pixels))
        memory += 8.0 * pixels * (steps * 4 + 60 + 3 * np.log2(pixels))
    if prepared.cells is not None:
        m1, m2 = prepared.cells
        window = pixels // (m1 * m2)
        once = _seconds(_CONTACT_SECONDS, window), _seconds(_FLOW_SECONDS, window)
        if "two-scale" in case.methods:
            links = m1 * m2 + (m1 - 1) * m2
            lines.append(
                f"two-scale  {m1} × {m2} cells of {surface.shape[0] // m1} × {surface.shape[1] // m2} pixels: "
                f"{steps * m1 * m2} contact and {steps * links} flow solutions"
            )
            seconds += steps * (m1 * m2 * once[0] + links * once[1])
            memory += 8.0 * pixels * steps * 4
        if prepared.sampling is not None:
            sampling = prepared.sampling
            width = surface.size[1] / m2
            n2 = max(1, round(sampling.length / width))
            axes = 2 if sampling.pressure == "place" else 1
            lines.append(
                f"stochastic {sampling.library_cells} library cells ({sampling.pressure}), "
                f"{sampling.realisations} seals of {m1} × {n2} links, {to_text(n2 * width, 'm', 3)} long"
            )
            seconds += steps * sampling.library_cells * (axes * once[0] + 2 * once[1])
            seconds += sampling.realisations * steps * 3e-6 * m1 * n2 * max(1.0, np.log2(min(m1, n2)))
            memory += 8.0 * (pixels * steps * 3 + m1 * n2 * steps * 4)
    workers = "one core; two cores take about half"
    lines.append(f"expected   about {seconds:.0f} s on {workers}, {memory / 1e9:.1f} GB")
    return lines
