"""Open area near full contact: why that of Persson's theory is 4/3 of what comes out.

At full contact the pressure of a Gaussian face is Gaussian with a mean square of (E*h′/2)² about p̄, and its negative
part covers ½ erfc(√2 p̄/E*h′). Persson's open area is twice that. Solved without tension, a round pit of pressure
−p₀ + c r² opens as a penny crack without stress at its edge, to 3/2 of the area under tension: the edge where
∫ p r/√(a² − r²) dr = 0 has a² = 3p₀/2c. So the open area tends to 3/4 of Persson's, which Johnson, Greenwood &
Higginson found in the same way for one wave (Int. J. Mech. Sci. 27, 1985, 383).
"""

from __future__ import annotations

import numpy as np

from .faces import MODULUS, SLOPE, rough

#: Loads p̄/E*h′, up to where one spot in a thousand is open.
LOADS = (0.5, 1.0, 1.25, 1.5)


def full_contact_pressure(gap0, spacing):
    """Deviation from p̄ of the pressure that flattens a periodic gap (n1, n2) [m]: of each wave E*|q|/2 its height."""
    q = (
        2
        * np.pi
        * np.hypot(np.fft.fftfreq(gap0.shape[0], spacing[0])[:, None], np.fft.fftfreq(gap0.shape[1], spacing[1]))
    )
    return np.fft.ifft2(-MODULUS / 2 * q * np.fft.fft2(gap0)).real


def open_area(n=512, pixels_per_wave=16, waves=8, seeds=range(4), loads=LOADS):
    """Open area, corrected for its edges, and area under tension at full contact, means over faces.

    `persson` is erfc(√2 p̄/E*h′). `kurtosis` is that of the full contact pressure, 3 where it is Gaussian.
    """
    from femseal import solve_contact

    found, tension, kurtosis = np.zeros((3, len(seeds), len(loads)))
    for s, seed in enumerate(seeds):
        gap0, body = rough(n, pixels_per_wave=pixels_per_wave, waves=waves, rng=seed)
        full = full_contact_pressure(gap0, body.spacing)
        kurtosis[s] = np.mean((full / full.std()) ** 4)
        for i, load in enumerate(loads):
            mean = load * MODULUS * SLOPE
            tension[s, i] = np.mean(full + mean < 0)
            found[s, i] = 1 - solve_contact(gap0, body, pressure=mean).area_fraction_corrected
    from scipy.special import erfc

    load = np.array(loads)
    return {
        "n": n,
        "pixels": pixels_per_wave,
        "waves": waves,
        "faces": len(seeds),
        "load": load,
        "open": found.mean(axis=0),
        "tension": tension.mean(axis=0),
        "persson": erfc(np.sqrt(2) * load),
        "spread": (found / found.mean(axis=0)).std(axis=0),
        "kurtosis": float(kurtosis.mean()),
    }


#: Grid, pixels per shortest wave and longest waves on a side: finer pixels on the same faces, then more waves.
VARIANTS = ((256, 8, 8), (512, 16, 8), (1024, 32, 8), (256, 16, 4), (1024, 16, 16))


def open_areas(variants=VARIANTS, seeds=range(6)):
    return [open_area(*variant, seeds=seeds) for variant in variants]


def draw(records, ax):
    for r in records:
        label = f"{r['pixels']} pixels per shortest wave, {r['waves']} longest waves"
        ax.plot(r["load"], r["open"] / r["tension"], "o-", ms=3, label=label)
    ax.axhline(2, color="k", ls="--", label="Persson")
    ax.axhline(1.5, color="k", ls=":", label="penny cracks, 3/2")
    ax.set(xlabel="p̄ / E*h′", ylabel="open area / area under tension", title="open area near full contact")
    ax.legend(fontsize=6)


def line(records):
    largest = max(records, key=lambda r: r["waves"])
    one = list(largest["load"]).index(1.0)

    def ratios(values, load):
        return ", ".join(f"{v:.2f}" for v in values) + f" at {', '.join(f'{x:g}' for x in load)}"

    variants = "; ".join(
        f"{r['pixels']} pixels per shortest wave, {r['waves']} longest waves a side: "
        f"{(r['open'] / r['tension'])[one]:.3f} at 1, "
        f"tension over theory {(2 * r['tension'] / r['persson'])[one]:.2f}"
        for r in records
    )
    share = ratios(largest["open"] / largest["persson"], largest["load"])
    crack = ratios(largest["open"] / largest["tension"], largest["load"])
    return [
        "Open area erfc(√2 p̄/E*h′) towards full contact, twice the area under tension",
        "Persson, J. Chem. Phys. 115, 2001, 3840; penny cracks: Johnson, Greenwood & Higginson, Int. J. Mech. Sci. 27, "
        "1985, 383",
        f"open area over Persson's {share}, p̄/E*h′; over the area under tension {crack}: it tends to 3/2 of that, as "
        f"penny cracks do, thus to 3/4 of Persson's. Means of {largest['faces']} faces. {variants}",
    ]
