"""What a run will compute, and about how long and in how much memory, before it is started."""

from __future__ import annotations

import numpy as np

from .case import Case, Prepared
from .quantities import to_text
from .scales import Partition
from .studies import seal_cells
from .studies.costs import deterministic_cost, stochastic_cost, two_scale_cost


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
    if prepared.choice:
        lines.append(f"method     {prepared.method}: {prepared.choice}")
    costs = [(0.0, 150e6)]
    if "deterministic" in prepared.methods:
        lines.append(f"determin.  {steps} contact and {steps} flow solutions of {pixels} unknowns")
        costs.append(deterministic_cost(steps, surface.shape))
    if prepared.cells is not None:
        m1, m2 = prepared.cells
        if "two-scale" in prepared.methods:
            links = m1 * m2 + (m1 - 1) * m2
            lines.append(
                f"two-scale  {m1} × {m2} cells of {surface.shape[0] // m1} × {surface.shape[1] // m2} pixels: "
                f"{steps * m1 * m2} contact and {steps * links} flow solutions"
            )
            costs.append(two_scale_cost(steps, surface.shape, prepared.cells))
        if prepared.sampling is not None:
            sampling = prepared.sampling
            n1, n2 = seal_cells(Partition(surface.shape, surface.spacing, prepared.cells), sampling)
            lines.append(
                f"stochastic {sampling.library_cells} library cells ({sampling.pressure}), "
                f"{sampling.realisations} seals of {n1} × {n2} links, "
                f"{to_text(n2 * surface.size[1] / m2, 'm', 3)} long"
            )
            costs.append(stochastic_cost(steps, surface.shape, prepared.cells, sampling, (n1, n2)))
    seconds, memory = (sum(cost) for cost in zip(*costs, strict=True))
    workers = "one core; two cores take about half"
    lines.append(f"expected   about {seconds:.0f} s on {workers}, {memory / 1e9:.1f} GB")
    return lines
