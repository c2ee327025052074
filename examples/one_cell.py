"""One cell along a load cycle
===========================

This script solves the contact of a cell at every step of a load cycle, and computes the permeability of its gap. The
cell closes at the peak load, and it opens again only at the end of the unloading.
"""

from __future__ import annotations

import numpy as np

import femseal as fs

STEEL = fs.Solid(young=210e9, poisson=0.3, yield_stress=1e9)


def cycle() -> tuple[fs.LoadCycle, np.ndarray]:
    """Return the contact states of a periodic self-affine cell, and its permeability along x1 in each state [m³]."""
    face = fs.self_affine(
        (128, 128), (100e-6, 100e-6), hurst=0.8, rms_slope=0.2, roll_off=40e-6, rng=3
    )
    body = fs.HalfSpace(face.shape, face.spacing, fs.contact_modulus(STEEL, STEEL))
    states = fs.load_cycle(
        face.gap(),
        body,
        hardness=STEEL.hardness,
        loading=[0.5e8, 1e8, 2e8, 4e8, 7e8, 10e8],
        unload_from=[10e8],
        unloading=[7e8, 4e8, 2e8, 1e8, 0.5e8],
    )
    k = [fs.cell_permeability(s.contact.gap, face.spacing, sides="periodic").value for s in states]
    return states, np.array(k)


if __name__ == "__main__":
    import matplotlib.pyplot as plt

    states, k = cycle()
    for state, value in zip(states, k, strict=True):
        contact = state.contact
        print(f"{state.name:32} contact {contact.area_fraction:6.1%}  k {value:.3g} m³")
    loading = np.array([s.unloaded_from is None for s in states])
    pressure = np.array([s.pressure for s in states]) / 1e6
    plt.semilogy(pressure[loading], k[loading], "o-", label="loading")
    plt.semilogy(pressure[~loading], k[~loading], "s--", label="unloading")
    plt.xlabel("nominal pressure [MPa]")
    plt.ylabel("permeability [m³]")
    plt.legend()
    plt.show()
