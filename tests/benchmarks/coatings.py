"""Test the compliance of coated bodies, and measure the cost of their contact and the effect of a constrained coating.

    python tests/benchmarks/coatings.py --write

The compliance is compared with closed forms and with finite elements.
"""

from __future__ import annotations

import argparse
import sys
import time
from functools import partial
from pathlib import Path

import numpy as np

import femseal as fs
from common import machine_and_time, print_report, table
from femseal.checks import constrained_hardness_ratio
from femseal.contact.layered import layer_factor
from femseal.contact.linear_laws import contact_law
from femseal.contact.tangent_sequence import _tangent_from_depth
from femseal.contact.yield_line import YieldLine

sys.path.insert(0, str(Path(__file__).parents[1]))
from coated_block import block_compliance, with_ratio

STEEL, INCONEL, SILVER = (
    fs.named_solid(name)
    for name in ("steel 304/316, annealed", "Inconel 718, aged", "silver, annealed")
)
RATIOS = (0.25, 1.5, 5.0)
TIMES_WAVE = np.geomspace(0.05, 8.0, 10)


def closed_forms():
    """Tabulate the largest relative error of S, the compliance factor of a layer, against closed forms."""
    t = np.geomspace(0.05, 15, 200)
    same = fs.Coated(STEEL, STEEL, 1.0)
    incompressible = fs.Coated(None, fs.Solid(1e6, 0.5), 1.0)
    sinh_form = (np.sinh(2 * t) - 2 * t) / (np.cosh(2 * t) + 1 + 2 * t**2)
    lines = [
        ("layer of the material of its substrate, S = 1", same, t, 1.0),
        (
            "incompressible layer on a rigid base, (sinh 2t − 2t)/(cosh 2t + 1 + 2t²)",
            incompressible,
            t,
            sinh_form,
        ),
    ]
    for ratio in RATIOS:
        substrate, layer = with_ratio(ratio)
        body = fs.Coated(substrate, layer, 1.0)
        thin = layer.plane_modulus / substrate.plane_modulus
        name = f"layer {ratio:g} times as stiff"
        lines.append((f"{name}, thick (t = 30)", body, np.array([30.0]), 1.0))
        lines.append((f"{name}, thin (t = 1e-9)", body, np.array([1e-9]), thin))
    rows = []
    for name, body, times, exact in lines:
        error = np.abs(layer_factor(body, times) / exact - 1).max()
        rows.append([name, f"{error:.1e}"])
    return table(["closed form", "largest relative error"], rows)


def finite_elements():
    """Tabulate the compliance by the formula divided by the compliance by finite elements in plane strain."""
    rows = []
    for ratio in RATIOS:
        substrate, layer = with_ratio(ratio)
        values = []
        for t in TIMES_WAVE:
            body = fs.Coated(substrate, layer, t)  # the wave number is 1
            kernel = 2 * layer_factor(body, np.array(t)) / layer.plane_modulus
            values.append(f"{kernel / block_compliance(ratio, t):.4f}")
        rows.append([f"{ratio:g}", *values])
    return table(["shear modulus, layer / substrate", *(f"t = {t:.2g}" for t in TIMES_WAVE)], rows)


def rough(n, rms_slope=0.1):
    """A self-affine surface with pixels of 1 µm, and its undeformed gap."""
    side = n * 1e-6
    surface = fs.self_affine(
        (n, n), (side, side), hurst=0.8, rms_slope=rms_slope, rng=3, roll_off=6e-5
    )
    return surface, surface.heights.max() - surface.heights


def fastest(functions, repeats):
    """Call functions in turn; return the smallest CPU time of each function [s] and its last result."""
    times = np.full((repeats, len(functions)), np.inf)
    results = [None] * len(functions)
    for i in range(repeats):
        for j, function in enumerate(functions):
            start = time.process_time()
            results[j] = function()
            times[i, j] = time.process_time() - start
    return times.min(axis=0), results


def solve(gap0, half_space, law, pressure, deformation=None):
    """Solve one contact."""
    return fs.solve_contact(
        gap0, half_space, pressure=pressure, hardness=law, deformation=deformation
    )


def with_prescribed_tangents(gap0, half_space, law, pressure, contact):
    """Prepare a contact with a linear law of each point, the tangent of a curved law in a known solution."""
    first = YieldLine(np.full(gap0.shape, SILVER.hardness), np.zeros(gap0.shape))
    line, depth = _tangent_from_depth(law, first, contact.plastic_deformation)
    tangents = fs.LinearHardening(line.hardness, line.slope)
    return partial(solve, gap0 + depth, half_space, tangents, pressure)


def cost():
    """Tabulate the CPU time of contacts with a coating, divided by the time of contacts of solid silver.

    The surface is loaded, and unloaded to half of the pressure. Where points yield through the coating, the loading is
    repeated with the tangents of the solution as a linear law.
    """
    hardness = SILVER.hardness
    rows = []
    for n, repeats in ((128, 15), (512, 5)):
        surface, gap0 = rough(n)
        bare = fs.HalfSpace(surface.shape, surface.spacing, (SILVER, INCONEL))
        for thickness in (20e-6, 1e-6, 0.3e-6):
            body = fs.Coated(STEEL, SILVER, thickness)
            coated = fs.HalfSpace(surface.shape, surface.spacing, (body, INCONEL))
            law = fs.CoatedLaw.of(body)
            for load in (0.02, 0.3, 0.8):
                pressure = load * hardness
                loading = (
                    partial(solve, gap0, bare, hardness, pressure),
                    partial(solve, gap0, coated, law, pressure),
                )
                times, (plain, contact) = fastest(loading, repeats)
                unloading = (
                    partial(solve, gap0, bare, hardness, pressure / 2, plain.plastic_deformation),
                    partial(solve, gap0, coated, law, pressure / 2, contact.plastic_deformation),
                )
                half, _ = fastest(unloading, repeats)
                through = np.mean(contact.plastic_deformation > thickness)
                pairs = f"{plain.fft_pairs}, {contact.fft_pairs}"
                prescribed = "–"
                if through:
                    linear = with_prescribed_tangents(gap0, coated, law, pressure, contact)
                    (plain_time, linear_time), (_, known) = fastest((loading[0], linear), repeats)
                    pairs += f", {known.fft_pairs}"
                    prescribed = f"{linear_time / plain_time:.2f}"
                rows.append(
                    [
                        f"{n}²",
                        f"{thickness * 1e6:g} µm",
                        f"{load:g}",
                        f"{through:.1%}" if through else "0",
                        pairs,
                        f"{times[1] / times[0]:.2f}",
                        prescribed,
                        f"{half[1] / half[0]:.2f}",
                    ]
                )
    head = ["points", "thickness", "pressure / hardness", "points yielded through the coating"]
    head += [
        "FFT pairs: solid silver, coating, prescribed tangents",
        "time ratio, loading",
        "time ratio, loading with prescribed tangents",
        "time ratio, unloading",
    ]
    return table(head, rows)


def constraint():
    """Tabulate how the leakage of a turned surface on silver changes with the hardness, and estimate the constraint.

    Returns two tables. The first one shows the leakage with a higher hardness or a lower load. The second one shows the
    size of the contact patches, and the rise of the hardness for several thicknesses.
    """
    surface = fs.turned(
        (192, 384), (900e-6, 1.8e-3), pitch=150e-6, depth=5.9e-6, roughness=0.84e-6,
        roughness_roll_off=90e-6, feed_error=0.03, depth_error=0.1, rng=1,
    )  # fmt: skip
    body = fs.Coated(INCONEL, SILVER, 30e-6)
    pressures = (20e6, 40e6, 60e6)

    def solve_face(factor=1.0, load_factor=1.0):
        """Solve the surface with the hardness and the load multiplied by factors."""
        scene = fs.Scene(
            surface=surface,
            modulus=(STEEL, body),
            hardness=contact_law(265e6 * factor),
            fluid=fs.Liquid(viscosity=1e-3, density=1000.0),
            inlet_pressure=1e6,
            outlet_pressure=0.0,
            loading=[load_factor * p for p in pressures],
        )
        return fs.deterministic(scene)

    plain = solve_face()

    def ratios(face):
        pairs = zip(np.abs(face.leakage), np.abs(plain.leakage), strict=True)
        return [f"{a / b:.2f}" if b > 0 else "–" for a, b in pairs]

    rows = []
    for factor in (1.2, 1.44, 2.5):
        rows.append([f"hardness multiplied by {factor:g}", *ratios(solve_face(factor))])
        rows.append([f"load divided by {factor:g}", *ratios(solve_face(1.0, 1 / factor))])
    loads = [f"{p / 1e6:g} MPa" for p in pressures]
    leakages = table(["change", *loads], rows)
    distances = [state.edge_distance for state in plain.states]
    rows = [["mean distance from the edge [µm]", *(f"{1e6 * d:.1f}" for d in distances)]]
    for thickness in (30e-6, 10e-6, 5e-6, 3e-6, 1e-6):
        rises = [f"{constrained_hardness_ratio(d, thickness):.2f}" for d in distances]
        rows.append([f"rise for a thickness of {1e6 * thickness:g} µm", *rises])
    return leakages, table(["", *loads], rows)


def main():
    """Run all parts of the benchmark, and print and write the report."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--write", action="store_true", help="write the report beside the script")
    options = parser.parse_args()
    leakages, rises = constraint()
    text = [
        "## Closed forms\n\nS is the compliance of a coated body, divided by the compliance of a half-space of the "
        "layer's material. It is a function of t = qd, where q is the wavenumber and d is the thickness of the layer.",
        closed_forms(),
        "## Finite elements\n\nThe table compares the formula with a finite-element model of a layered block in plane "
        "strain (scikit-fem, quadratic elements). It shows the compliance from the formula "
        "divided by the compliance of the block. Poisson's ratio is 0.37 for the layer and 0.3 for the substrate.",
        finite_elements(),
        "## Cost\n\nThe last three columns compare the CPU times of two contacts: silver-coated steel on Inconel, "
        "relative to solid silver on Inconel. The surface is self-affine with an rms slope of 0.1. "
        "The surface is unloaded to half of the pressure. With prescribed tangents, the tangents of the curve of hardness "
        "against depth at the solution are prescribed as a linear contact law of each point, so that no curve is followed.",
        cost(),
        "## Constraint\n\nA turned steel surface (Ra 1.6 µm, feed 150 µm) is pressed against a silver coating with a "
        "thickness of 30 µm and a hardness of 265 MPa. Either the hardness was multiplied by a factor, or the load was divided by the same "
        "factor. The table shows the leakage relative to its value at the original hardness and "
        "load. "
        '"–" means that the surface is sealed with the original hardness and load.',
        leakages,
        "The next table shows the mean distance of the points that yield from the edge of their contact patch, and an "
        "upper bound on the factor by which the constraint raises the hardness, for several thicknesses of the "
        "coating.",
        rises,
    ]
    report = "\n\n".join([machine_and_time(["scikit-fem"]), *text])
    print_report(__file__, "Coatings", report, options.write)


if __name__ == "__main__":
    main()
