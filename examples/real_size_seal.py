"""A seal of real size
===================

The seal is 0.1 m long, and three times as wide as the small surface that represents it. Each of its tiles takes the
permeability of a randomly chosen cell of the surface, at the pressure of the tile and with its load history.
"""

from __future__ import annotations

import femseal as fs


def scene() -> fs.Scene:
    """Return the input of the study: a surface of 0.18 mm × 0.18 mm on steel, loaded to 400 MPa and unloaded."""
    steel = fs.Solid(young=210e9, poisson=0.3, yield_stress=1e9)
    surface = fs.self_affine(
        (192, 192), (180e-6, 180e-6), hurst=0.8, rms_slope=0.2, roll_off=40e-6, rng=5
    )
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


def drawn_seal(
    length: float = 0.1, breadth: float = 0.54e-3, realisations: int | None = None
) -> fs.StochasticResult:
    """Simulate seals of a given length and width [m].

    By default, the number of realisations is chosen so that the 95 % interval is accurate.
    """
    return fs.stochastic(scene(), None, fs.Sampling(length, realisations, seed=1, breadth=breadth))


if __name__ == "__main__":
    result = drawn_seal()
    print(f"{result.tiles}, {len(result.leakage)} realisations, cells: {result.cells.cut.shape}")
    for step, median, spread in zip(
        result.steps, result.quantile(0.5), result.realisation_spread, strict=True
    ):
        print(
            f"{step.name:32} {median * 1e6:.3g} mL/(m·s), a seal scatters by {100 * spread:.1g} %"
        )
    picture = result.plot()
    picture.savefig("real_size_seal.png")
