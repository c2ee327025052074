"""Compare the flow resistance of rock fractures that are loaded to 10.3 MPa and unloaded.

In the experiment, the flow rate is constant, and the inlet pressure is proportional to the resistance, apart
from an offset of about 100 kPa. A mated fracture is modelled as a self-affine surface against a flat. Unknown
are the load over E* × rms slope, and the hardness over it. Vogler, Kling and co-workers 2018, specimen vd2.
"""

from __future__ import annotations

import numpy as np

from femseal import HalfSpace, cell_permeability, load_cycle, self_affine

LOADS = np.array([0.26, 1.03, 2.05, 3.08, 5.13, 7.19, 10.3])
OFFSET = 100.0
#: Inlet pressures [kPa] on loading, and on unloading from the highest load.
MEASURED = ((125, 156, 223, 313, 576, 914, 1810), (229, 437, 731, 983, 1370, 1630, 1810))


def resistances(scale, hardness, n=256):
    """Compute ln of the resistances on loading and unloading (2, 7), relative to the resistance at the highest load."""
    d = 1e-6
    ends = {"roll_off": n * d / 4, "cut_off": 8 * d}
    face = self_affine((n, n), (n * d, n * d), hurst=0.8, rms_slope=0.1, rng=1, **ends)
    unit, body = 1e9 * face.rms_slope, HalfSpace((n, n), (d, d), 1e9)
    loads = LOADS / LOADS[-1] * scale * unit
    cycle = {"loading": loads, "unload_from": loads[-1:], "unloading": loads[-2::-1]}
    gap0 = face.heights.max() - face.heights
    states = load_cycle(gap0, body, hardness=hardness * unit, rtol=1e-5, **cycle)
    gaps = (state.contact.gap for state in states)
    k = np.array([cell_permeability(gap, (d, d), sides="periodic").value for gap in gaps])
    with np.errstate(divide="ignore", invalid="ignore"):  # of sealed ones
        return np.log(k[6] / np.stack([k[:7], k[:5:-1]]))


def rock_fractures(scales=(0.03, 0.05, 0.07, 0.1), hardnesses=(0.12, 0.18, 0.3)):
    """Fit load and hardness to all resistances; return rise, remaining resistance and rms error."""
    theirs = np.log((np.array(MEASURED) - OFFSET) / (MEASURED[0][-1] - OFFSET))
    fits = {}
    for scale in scales:
        for hardness in hardnesses:
            ours = resistances(scale, hardness)
            if np.isfinite(ours).all():
                fits[np.sqrt(np.mean((ours - theirs) ** 2))] = ours
    best = fits[min(fits)]
    pairs = {"ours": best, "measured": theirs}
    rise = {f"rise, {name}": np.exp(-up[0]) for name, (up, _) in pairs.items()}
    left = {f"left, {name}": np.exp(down[0] - up[0]) for name, (up, down) in pairs.items()}
    return rise | left | {"rms error": np.exp(min(fits))}
