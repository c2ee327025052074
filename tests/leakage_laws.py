"""Leakages that are power laws of the contact pressure, on loading and on unloading, for tests of several rooms."""

import numpy as np

from femseal.loads import LoadProgramme

STEPS = LoadProgramme.of(
    [1e7, 3e7, 1e8, 4e8, 9e8], unload_from=[4e8, 9e8], unloading=[3e8, 1e8, 3e7, 1e7]
)
#: On loading L = A p^−3, on unloading from Q_A it grows with p^−½ from there.
FALL, RISE = 3.0, 0.5


def power_law(amplitudes, steps=STEPS):
    """Leakages (seals, steps) of the two power laws; exact between steps too, because they are straight in log–log."""
    p = steps.pressures
    top = p[steps.peak_indices]
    law = np.where(steps.on_loading, p**-FALL, top**-FALL * (p / top) ** -RISE)
    return np.asarray(amplitudes, dtype=float)[:, None] * law
