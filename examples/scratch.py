"""A scratch across a valve seat
=============================

This script presses a lapped seat with a scratch from inlet to outlet, and computes how much hydrogen leaks for
each width and depth of the scratch.

In a test of a hydrogen valve, repeated closing damaged the contact surfaces (JSME Materials and Mechanics
Conference 2011, OS0804-1, abstract). The leakage was practically zero until the damaged area was 100 µm wide
and 2 µm deep, and then increased rapidly. The authors state that the physical meaning of these limits is not
understood.

The picture shows the same rapid increase. A wide, shallow scratch is pressed flat: with the cosine profile used
here, a scratch of width w closes elastically under a pressure p if it is not deeper than p w/(1.85 E*). In a
slightly deeper scratch, the roughness still blocks the flow. At larger depths, the leakage grows with the cube
of the depth. With the roughness and the loads assumed here, a scratch must be 0.5 to 1.3 µm deep to add 0.01
mL/min. A scratch 100 µm wide and 2 µm deep leaks at all of these loads. To press it flat would take 4 GPa,
which is more than the hardness of the steel.

The limits found in the test cannot be predicted, because the abstract states neither the roughness and the
contact pressure of the seat nor the smallest leakage that could be measured. Nor does it say whether the damage
crossed the whole seat. Gas slip is neglected.
"""

from __future__ import annotations

import numpy as np

import femseal as fs

STEEL = fs.Solid(young=210e9, poisson=0.3, yield_stress=1e9)
MODULUS = fs.contact_modulus(STEEL, STEEL)
HYDROGEN = fs.IdealGas(viscosity=8.8e-6, molar_mass=2.016e-3, temperature=293.15, slip=False)
INLET, OUTLET = 1e6, 1e5  # Pa, absolute
#: Width of the seat along the leakage and its circumference [m].
SEAT = (0.2e-3, 10e-3)
PRESSURES = (200e6, 400e6, 800e6)
WIDTHS = (25e-6, 50e-6, 100e-6, 200e-6)
DEPTHS = np.geomspace(0.2e-6, 4e-6, 10)
#: Leakage that counts as a leak [m³/s], 0.01 mL/min.
LIMIT = 0.01e-6 / 60


def lapped_seat() -> fs.Topography:
    """Return a part of the seat without a scratch: 100 µm along the leakage, 400 µm along the circumference."""
    return fs.self_affine(
        (64, 256), (100e-6, 400e-6), hurst=0.8, rms_height=0.1e-6, roll_off=50e-6, rng=1
    )


def scratched(seat: fs.Topography, width: float, depth: float) -> fs.Topography:
    """Return the seat with a scratch along x1, whose profile is one period of a cosine."""
    x = (np.arange(seat.shape[1]) + 0.5) * seat.spacing[1] - seat.size[1] / 2
    profile = np.where(np.abs(x) < width / 2, (1 + np.cos(2 * np.pi * x / width)) / 2, 0.0)
    return seat.with_heights(seat.heights - depth * profile)


def conductance(seat: fs.Topography, pressure: float) -> float:
    """Return the conductance [m³] of a part of the seat: permeability times length over width of the seat."""
    body = fs.HalfSpace(seat.shape, seat.spacing, MODULUS)
    contact = fs.solve_contact(seat.gap(), body, pressure=pressure, hardness=STEEL.hardness)
    k = fs.cell_permeability(contact.gap, seat.spacing, sides="periodic").value
    return k * seat.size[1] / SEAT[0]


def leakages(pressure: float) -> tuple[float, np.ndarray]:
    """Return the leakage of the seat [m³/s] without a scratch, and for each scratch as an array (width, depth)."""
    strip = fs.RectangularSeal(SEAT, (1, 1))
    ends = {"inlet_pressure": INLET, "outlet_pressure": OUTLET}
    whole = fs.seal_leakage(strip, 1e-18, HYDROGEN, **ends)
    per_conductance = whole.volume_rate / (1e-18 * SEAT[1] / SEAT[0])
    seat = lapped_seat()
    smooth = conductance(seat, pressure)
    parts = SEAT[1] / seat.size[1]  # number of such parts in the circumference
    conductances = [
        [
            (parts - 1) * smooth + conductance(scratched(seat, width, depth), pressure)
            for depth in DEPTHS
        ]
        for width in WIDTHS
    ]
    return parts * smooth * per_conductance, np.array(conductances) * per_conductance


def leaking_depth(leakage: np.ndarray, seat_leakage: float) -> float:
    """Return the depth [m] at which the leakage added by a scratch reaches `LIMIT`; NaN if it never does."""
    added = leakage - seat_leakage
    number = int(np.argmax(added > LIMIT))
    if number == 0:
        return np.nan
    low, high = np.log(np.maximum(added[number - 1 : number + 1], 1e-3 * LIMIT))
    fraction = (np.log(LIMIT) - low) / (high - low)
    return float(DEPTHS[number - 1] * (DEPTHS[number] / DEPTHS[number - 1]) ** fraction)


if __name__ == "__main__":
    import matplotlib.pyplot as plt

    ml_per_minute = 1e-6 / 60
    figure, panels = plt.subplots(
        1, len(PRESSURES), figsize=(9.5, 3.6), sharey=True, layout="constrained"
    )
    print("pressure  width   adds 0.01 mL/min from   closes elastically up to")
    for axes, pressure in zip(panels, PRESSURES, strict=True):
        seat_leakage, leakage = leakages(pressure)
        for width, row in zip(WIDTHS, leakage, strict=True):
            depth = leaking_depth(row, seat_leakage)
            closed = pressure * width / (1.85 * MODULUS)
            load = f"{pressure / 1e6:4.0f} MPa {width * 1e6:4.0f} µm"
            print(f"{load} {depth * 1e6:16.2f} µm {closed * 1e6:21.2f} µm")
            added = np.maximum(row - seat_leakage, 0) / ml_per_minute
            axes.loglog(DEPTHS * 1e6, added, "o-", ms=3, label=f"{width * 1e6:.0f} µm wide")
        axes.axhline(seat_leakage / ml_per_minute, color="grey", ls="--", label="seat alone")
        tight = "" if seat_leakage else ", seat alone is tight"
        axes.set(
            title=f"{pressure / 1e6:.0f} MPa{tight}",
            xlabel="depth of the scratch [µm]",
            ylim=(1e-5, None),
        )
        axes.set_xticks([0.2, 0.5, 1, 2, 4], ["0.2", "0.5", "1", "2", "4"])
        axes.minorticks_off()
    panels[0].set_ylabel("leakage that the scratch adds [mL/min]")
    panels[0].legend()
    plt.show()
