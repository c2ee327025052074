"""From a dry flat patch to a real seal: what the fluid pressure and the form of a seat do to leakage.

    python tests/benchmarks/patch_to_seal.py --write

Fluid pressure: contact and flow solved in turn (`studies.fluid_coupling`) over the dry leakage, and the dry leakage at the
effective pressure p̄ − p_f, which tiles of broad seals take. Seats: crowns under a force per length. Chain: drawn seals
against the deterministic solution of 20 scenes of other seeds with everything on.
"""

from __future__ import annotations

import argparse
import sys
from dataclasses import replace
from pathlib import Path

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
import numpy as np
from common import machine, rows, save_report

import femseal as fs
from femseal.face.piece_flow import Failed, FlowSettings
from femseal.seal.layouts import RectangularLayout
from femseal.studies.fluid_coupling import FluidPressure

E, D, N = 115e9, 1e-6, 256
LOADS, DROPS = (0.02, 0.08, 0.2), (0.1, 0.3, 1.0)
OIL = fs.Liquid(1e-3)


def face(kind, seed, shape=(N, N)):
    """A face of one of two finishes; four long waves broad."""
    size = (shape[0] * D, shape[1] * D)
    if kind == "self-affine":
        return fs.self_affine(shape, size, hurst=0.75, rms_slope=0.2, roll_off=64 * D, cut_off=8 * D, rng=seed)
    return fs.turned(shape, size, pitch=64 * D, depth=1.2e-6, feed_error=0.03, depth_error=0.1, roughness=0.3e-6,
                     roughness_roll_off=36 * D, cut_off=8 * D, rng=seed)  # fmt: skip


def permeability(contact, spacing):
    return fs.cell_permeability(contact.gap, spacing, sides="periodic").value


def coupled(surface, hardness, load, drop):
    """Coupled over dry permeability, rounds, and that of effective pressures over the dry one."""
    gap0 = surface.heights.max() - surface.heights
    body = fs.HalfSpace(surface.shape, surface.spacing, E, ("free", "periodic"))
    fluid = FluidPressure(OIL, drop * load, 0.0, "total", FlowSettings())
    found = fluid.contact(gap0, body, pressure=load, hardness=hardness)
    parts = load - drop * load * (np.arange(8) + 0.5) / 8
    states = fs.load_cycle(gap0, body, hardness=hardness, loading=sorted([*parts, load]))
    k = [permeability(state.contact, surface.spacing) for state in states]
    wet = np.nan if isinstance(found.flow, Failed) else found.flow.permeability
    return wet / k[-1], found.rounds, np.mean(k[:-1]) / k[-1]


def fluid_pressures():
    """Lines of the table of fluid pressures."""
    lines = []
    for load in LOADS:
        for drop in DROPS:
            cells = [f"{load:g}", f"{drop:g}"]
            for kind, seeds in (("self-affine", (5, 6, 7)), ("turned", (5, 6, 7))):
                faces = [face(kind, seed) for seed in seeds]
                hardnesses = [0.1 * E * one.rms_slope for one in faces]
                found = np.array([coupled(f, h, load * h, drop) for f, h in zip(faces, hardnesses, strict=True)])
                cells += [" / ".join(f"{v:.3g}" for v in found[:, n]) for n in (0, 2)] + [f"{found[:, 1].max():.0f}"]
            lines.append(cells)
    return lines


def seats():
    """Lines of the table of crowns."""
    turned, forces = face("turned", 6, (1024, 256)), np.array([20e3, 50e3, 100e3, 200e3, 400e3])
    scene = fs.Scene(turned, E, 2.8e9, OIL, 1e6, 0.0, loading=tuple(forces / turned.size[0]), fluid_pressure="ignored")
    found = [fs.deterministic(scene)]
    found += [fs.deterministic(replace(scene, surface=fs.CrownedSeat(r).on(turned))) for r in (0.2, 0.05, 0.01)]
    return [
        [
            f"{force / 1e3:g}",
            *(f"{1e18 * 1e-9 * one.leakage[n]:.3g} ({1e3 * one.band_breadth[n]:.2f})" for one in found),
        ]
        for n, force in enumerate(forces)
    ]


def chain():
    """Ratios of leakage to the deterministic one with everything on, by kind of face."""
    lines = []
    for kind in ("self-affine", "turned"):
        ratios, effect = [], []
        for seed in range(30, 40):
            rough = face(kind, seed, (N, 2 * N))
            hardness = 0.1 * E * rough.rms_slope
            loads = tuple(hardness * np.array([0.02, 0.08, 0.2]))
            law = fs.LinearHardening(hardness, 1e15)
            crown = fs.CrownedSeat(0.05).on(rough)
            scene = fs.Scene(crown, E, law, OIL, 0.5 * loads[0], 0.0, loading=loads, unload_from=loads[2:],
                             unloading=loads[1::-1])  # fmt: skip
            truth = fs.deterministic(scene).leakage
            plain = fs.deterministic(replace(scene, surface=rough, hardness=hardness, fluid_pressure="ignored"))
            sampling = fs.Sampling(length=2 * N * D, realisations=2, seed=1)
            found = fs.stochastic(scene, (4, 8), sampling).quantile(0.5)
            open_ = truth > 1e-3 * truth[0]
            ratios.append(found[open_] / truth[open_])
            effect.append(truth[open_] / plain.leakage[open_])
        all_ = np.concatenate(ratios)
        lines.append([kind, "drawn seals", f"{np.median(all_):.3f}", f"{all_.min():.3f}–{all_.max():.3f}"])
        all_ = np.concatenate(effect)
        lines.append(
            [
                kind,
                "everything on over a dry flat patch",
                f"{np.median(all_):.3f}",
                f"{all_.min():.2g}–{all_.max():.3g}",
            ]
        )
    return lines


def spirals(picture=None):
    """Lines of the table of leads: radial and whole permeability [m³] of a turned face around 12.6 mm, and the tensor's."""
    rough = face("turned", 6, (512, 256))
    loads = tuple(0.1 * E * rough.rms_slope * np.array([0.05, 0.1, 0.15, 0.2, 0.25, 0.3, 0.4, 0.5, 0.6]))
    around, lead = 2 * np.pi * 2e-3, 64 * D
    given = {"loading": loads, "fluid_pressure": "ignored", "boundary": ("periodic", "periodic")}
    lays = ("x2", {"kind": "spiral", "lead": lead, "circumference": around})
    scenes = [
        fs.Scene(rough, E, 0.1 * E * rough.rms_slope, OIL, 1e6, 0.0, layout=RectangularLayout(lay), **given)
        for lay in lays
    ]
    rings, wound = (fs.deterministic(scene) for scene in scenes)
    factor = OIL.viscosity * rough.size[0] / 1e6
    along = [fs.cell_permeability(gap, rough.spacing, axis=1, sides="periodic").value for gap in wound.gap]
    table = np.array([rings.leakage * factor, np.array(along) * (lead / around) ** 2, wound.leakage * factor])
    if picture is not None:
        _, ax = plt.subplots(figsize=(5.2, 3.6), layout="constrained")
        shown = np.where(table > 0, table, np.nan)
        ax.semilogy(np.array(loads) / 1e6, shown[2], "k-", lw=2, label="spiral, resolved")
        ax.semilogy(np.array(loads) / 1e6, shown[0], "C0o--", label="rings: radial leakage alone")
        ax.semilogy(np.array(loads) / 1e6, shown[1], "C1s:", label="along the groove, $k_{22}\\,\\tan^2\\alpha$")
        ax.set(xlabel="nominal pressure [MPa]", ylabel="permeability across the seal [m³]")
        ax.legend(frameon=False)
        plt.savefig(picture, dpi=150)
    return [[f"{p / 1e6:.0f}", *(f"{v:.3g}" for v in row)] for p, row in zip(loads, table.T, strict=True)]


def trapped():
    """Lines of the table of trapped liquid: leakage over that under pockets at the pressure around them."""
    loads, liquid = (0.1, 0.2, 0.3, 0.35, 0.4, 0.6), fs.Liquid(1e-3, bulk_modulus=2e9)
    columns = []
    for seed in (1, 2, 3):
        surface = fs.self_affine((N, N), (N * D, N * D), hurst=0.75, rms_slope=0.2, roll_off=16 * D, cut_off=6 * D,
                                 rng=seed)  # fmt: skip
        hardness = 0.1 * E * surface.rms_slope
        scene = fs.Scene(surface, E, hardness, liquid, 0.006 * hardness, 0.0,
                         loading=tuple(hardness * np.unique((*loads, 0.25, 0.45, 0.5))),
                         unload_from=(0.35 * hardness, 0.6 * hardness), unloading=(0.1 * hardness,))  # fmt: skip
        acts, kept = (fs.deterministic(replace(scene, fluid_pressure=how)).leakage for how in ("acts", "trapped"))
        columns.append(np.array([acts, kept]))
    lines = []
    for s, step in enumerate(scene.steps):
        if (load := round(step.pressure / hardness, 3)) not in loads:
            continue
        peak = "" if step.unloaded_from is None else f" after {step.unloaded_from / hardness:.2g}"
        cells = [
            "sealed"
            if q[0, s] == 0
            else f"{q[0, s] / q[0, 0]:.2g}, " + (f"× {q[1, s] / q[0, s]:.3g}" if q[1, s] > 0 else "not settled")
            for q in columns
        ]
        lines.append([f"{load:g}{peak}", *cells])
    return lines


def report(picture=None):
    heads = ["p̄/H", "p_in/p̄", "self-affine: coupled / dry", "effective / dry", "rounds", "turned: coupled / dry",
             "effective / dry", "rounds"]  # fmt: skip
    return "\n\n".join(
        (
            machine({}),
            "## Fluid pressure\n\nPermeability over that of the dry face under the same load, three faces each of 256² points, four long "
            "waves broad; effective: the mean of the dry one over p̄ − p_f.",
            rows(heads, fluid_pressures()),
            "## Seats\n\nA turned face of 1024 × 256 points, E* 115 GPa, H 2.8 GPa, dry: k/L1 [1e-18 m²], and the breadth of the band [mm].",
            rows(["force [N/mm]", "flat", "R = 200 mm", "R = 50 mm", "R = 10 mm"], seats()),
            "## Spirals\n\nA turned face of 512 × 256 points, eight grooves of a pitch of 64 µm, around 12.6 mm (a radius of 2 mm): permeability [m³].",
            rows(["load [MPa]", "rings", "k₂₂ tan²α", "spiral"], spirals(picture)),
            "## Trapped liquid\n\nSelf-affine faces of 256² points, sixteen long waves broad, a liquid of a bulk modulus of 2 GPa at 0.006 H: leakage "
            "over that of the first load, and how many times as much it is where closed pockets keep their liquid.",
            rows(["p̄/H", "seed 1", "seed 2", "seed 3"], trapped()),
            "## Everything on\n\nTwenty faces of other seeds, 256 × 512 points: a crown of 50 mm, hardening of 1 GPa/µm, a fluid at half of the "
            "lowest load, three loads and two of unloading; leakage over the deterministic one, of loads that leak more than 1e-3 of the first.",
            rows(["face", "method", "median", "range"], chain()),
        )
    )


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--write", action="store_true", help="write the report beside the script")
    write = parser.parse_args().write
    text = report(Path(__file__).with_name("patch_to_seal_spiral.png") if write else None)
    print(text)
    if write:
        save_report(__file__, "From patch to seal", text)
    return 0


if __name__ == "__main__":
    sys.exit(main())
