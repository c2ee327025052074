"""At which load the finish of a metal seal stops mattering.

SAE paper 650312, "Metal-to-Metal and Metal Gasketed Seals", 1965 (abstract): to ignore the surface finish the stress
must be about 2.75 times the yield strength σ_y of the weaker material; with asperities controlled in magnitude and
direction it may be considerably less; extremely fine finishes without radial asperities seal below σ_y. In femseal a
hardness H stands for yielding of asperities; here H = 2.75 σ_y.
"""

from __future__ import annotations

import numpy as np

from .faces import MODULUS

YIELD = 400e6
HARDNESS = 2.75 * YIELD
RMS = (0.1e-6, 0.3e-6, 1e-6, 3e-6)
LOADS = (0.02, 0.05, 0.1, 0.15, 0.2, 0.25, 0.3, 0.35, 0.4, 0.45, 0.5, 0.55, 0.6, 0.7, 0.8, 0.9, 0.95, 0.98)
KINDS = ("isotropic", "grooves along the flow", "isotropic with a scratch along the flow")
SPACING = 2e-6


def heights(kind, rms, n):
    """Heights (n, n) [m] of a face of 2 µm pixels; flow is along x1.

    Grooves are those of a turning tool with an eighth of the side as feed, and a tenth of isotropic roughness; the
    scratch is 5 rms heights deep and 16 µm wide to 1/e on each side.
    """
    from femseal import self_affine, turned

    side = n * SPACING
    rough = self_affine((n, n), (side, side), hurst=0.8, rms_height=1.0, roll_off=side / 8, cut_off=8 * SPACING, rng=1)
    if kind == KINDS[1]:
        lay = turned(
            (n, n),
            (side, side),
            pitch=side / 8,
            depth=4e-6,
            depth_error=0.2,
            feed_error=0.1,
            cut_off=8 * SPACING,
            rng=2,
        )
        return rms * ((lay.heights.T - lay.heights.mean()) / lay.heights.std() + 0.1 * rough.heights)
    x = (np.arange(n) + 0.5 - n / 2) * SPACING
    scratch = 5 * np.exp(-((x / (8 * SPACING)) ** 2)) if kind == KINDS[2] else 0.0
    return rms * (rough.heights - scratch)


def leakage_of_finishes(n=256, kinds=KINDS, rms=RMS, loads=LOADS):
    """Permeability (loads,) [m³] at mean pressures p̄ = load × H, by kind and rms height, 0 from closing on."""
    from femseal import HalfSpace, cell_permeability, solve_contact

    body = HalfSpace((n, n), (SPACING, SPACING), MODULUS)
    records = []
    for kind in kinds:
        for height in rms:
            gap0 = -heights(kind, height, n)
            k = np.zeros(len(loads))
            for i, load in enumerate(loads):
                gap = solve_contact(gap0, body, pressure=load * HARDNESS, hardness=HARDNESS, rtol=1e-5).gap
                k[i] = cell_permeability(gap, body.spacing, sides="periodic", rtol=1e-4).value
                if k[i] == 0:
                    break
            closed = int(np.argmin(k > 0)) if not k.all() else len(loads)
            bracket = (np.r_[0, loads][closed], np.r_[loads, 1.0][closed])
            records.append({"kind": kind, "rms": height, "load": np.array(loads), "k": k, "closing": bracket})
    return records


def in_yield_strengths(bracket):
    return f"{bracket[0] * HARDNESS / YIELD:.2f}–{bracket[1] * HARDNESS / YIELD:.2f}"


def draw(records, ax):
    for kind, style in zip(KINDS, ("-", "--", ":"), strict=True):
        for color, r in enumerate(q for q in records if q["kind"] == kind):
            shown = r["k"] > 0
            label = f"{r['rms'] * 1e6:g} µm" if kind == KINDS[0] else kind if color == 3 else None
            ax.semilogy(r["load"][shown] * HARDNESS / YIELD, r["k"][shown], f"C{color}{style}", label=label)
    ax.axvline(HARDNESS / YIELD, color="k", lw=1)
    ax.set(
        xlabel="p̄ / σ_y (line: H)", ylabel="permeability [m³]", ylim=(1e-25, None), title="finishes of four rms heights"
    )
    ax.legend(fontsize=6)


def line(records):
    figures = "; ".join(
        f"{kind}: "
        + ", ".join(
            f"{in_yield_strengths(r['closing'])} at {r['rms'] * 1e6:g} µm" for r in records if r["kind"] == kind
        )
        for kind in KINDS
    )
    return [
        "To ignore the finish, mean pressure ≈ 2.75 σ_y; considerably less where asperities are controlled in magnitude "
        "and direction; below σ_y for very fine finishes without radial asperities",
        "SAE 650312, 1965 (abstract)",
        f"loads p̄/σ_y between which the face closes, H = 2.75 σ_y, by rms height: {figures}. The upper limit is built in: "
        "at p̄ = H everything touches",
    ]
