"""A seal of real size
===================

A seal 0.1 m long, drawn from a library of a few dozen windows of a small face that are followed along the load cycle.
"""

from __future__ import annotations

import femseal as fs


def scene() -> fs.Scene:
    """The combined roughness of two steel faces, 0.18 mm wide, loaded to 400 MPa and unloaded."""
    steel = fs.Solid(young=210e9, poisson=0.3, yield_stress=1e9)
    surface = fs.self_affine((192, 192), (180e-6, 180e-6), hurst=0.8, rms_slope=0.2, roll_off=40e-6, rng=5)
    return fs.Scene(
        surface=surface,
        modulus=fs.contact_modulus(steel, steel),
        hardness=steel.hardness,
        fluid=fs.Liquid(viscosity=1e-3),
        inlet_pressure=10e6,
        outlet_pressure=0.0,
        loading=(50e6, 150e6, 400e6),
        unload_from=(400e6,),
        unloading=(150e6, 50e6),
    )


def drawn_seal(length: float = 0.1, realisations: int = 4, library_cells: int = 24) -> fs.StochasticResult:
    """Every link of a seal of this length [m] under the nominal pressure, windows of 30 µm."""
    sampling = fs.Sampling(
        length=length, realisations=realisations, library_cells=library_cells, seed=1, pressure="uniform"
    )
    return fs.stochastic(scene(), (6, 6), sampling)


if __name__ == "__main__":
    result = drawn_seal()
    cells = result.seal.cells
    print(f"{cells[0]} × {cells[1]} windows, {len(result.leakage)} realisations")
    for step, median, spread in zip(result.steps, result.quantile(0.5), result.realisation_spread, strict=True):
        print(f"{step.name:32} {median * 1e6:.3g} mL/(m·s), a seal scatters by {100 * spread:.1g} %")
    picture = result.plot()
    picture.savefig("real_size_seal.png")
