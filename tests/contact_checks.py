"""References of contact: complementarity from the fields alone, and the least energy by scipy."""

import numpy as np
from scipy.optimize import minimize


def residual(contact, gap0, displacement=None, hardness=np.inf):
    """‖p − clip(p − c(v − δ), 0, H)‖/‖p‖ of the returned fields, nothing taken from the solver's own."""
    p, body = contact.pressure, contact.half_space
    u = displacement(p, body) if displacement else body.displacement(p)
    spacing = [d for n, d in zip(body.shape, body.spacing, strict=True) if n > 1 or p.size == 1]
    c = np.pi * body.modulus / (4 * np.prod(spacing) ** (1 / len(spacing)))
    projected = np.clip(p - c * (u + gap0 - contact.approach), 0, hardness)
    return np.linalg.norm(p - projected) / np.linalg.norm(p)


def least_energy(k, gap, mean, most, stress=4e9, length=1e-6):
    """Pressures p under which ½pKp + hp is least, 0 ≤ p ≤ `most`, mean p given, by SLSQP in units of its size."""
    n, k, gap, mean = gap.size, k * stress / length, gap / length, mean / stress
    found = minimize(
        lambda p: (0.5 * p @ k @ p + gap @ p, k @ p + gap),
        np.full(n, mean),
        jac=True,
        method="SLSQP",
        bounds=[(0, h) for h in np.minimum(np.broadcast_to(most, n) / stress, mean * n)],
        constraints={
            "type": "eq",
            "fun": lambda p: p.mean() - mean,
            "jac": lambda p: np.full(n, 1 / n),
        },
        options={"ftol": 1e-15, "maxiter": 500},
    )
    return stress * found.x
