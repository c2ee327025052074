"""Leakage of faces whose short waves are cut off and continued, against that of the faces with all of their waves.

    python tests/benchmarks/continued_spectrum.py [faces]

Self-affine faces with waves down to 0.5 µm; a map of 64² pixels has those down to 2.5 µm, and a case continues it to 1 µm.
"""

import sys
from dataclasses import replace
from math import inf
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

import femseal as fs
from femseal.case.case import parse_case

SIZE = (64e-6, 64e-6)
CASE = {
    "method": "deterministic",
    "material": {"young": "210 GPa", "hardness": "4 GPa"},
    "load": {"loading": ["20 MPa", "100 MPa", "300 MPa"]},
    "contact": {"boundary": ["mirror", "mirror"]},
    "fluid": {"kind": "liquid", "viscosity": "1 mPa*s", "inlet_pressure": "1 MPa", "outlet_pressure": "0.1 MPa"},
}


def main(faces: int) -> None:
    """Print how often the band holds the leakage, and the distances of ln(leakage) with and without continued waves."""
    rows = []
    for seed in range(faces):
        hurst, slope = (0.6, 0.8, 0.9)[seed % 3], (0.1, 0.2, 0.4)[seed // 3 % 3]
        truth = fs.self_affine(
            (1024, 1024), SIZE, hurst=hurst, rms_slope=slope, roll_off=32e-6, cut_off=0.5e-6, rng=seed
        )
        with TemporaryDirectory() as folder:
            np.save(Path(folder) / "face.npy", truth.low_pass(2.5e-6).resample((64, 64)).heights)
            face = {"kind": "file", "path": "face.npy", "size": ["64 um", "64 um"], "height_unit": "m"}
            surface = {"detrend": 0, "spikes": inf}
            case = CASE | {"seed": seed, "face": face, "output": {"pictures": False}}
            try:
                found = fs.run(parse_case(case | {"surface": surface | {"continue_spectrum": "1 um"}}, Path(folder)))
            except fs.InputError as error:
                print(f"face {seed}: {error}")
                continue
            measured = fs.run(parse_case(case | {"surface": surface, "output": {"budget": False}}, Path(folder)))
        whole = fs.Topography(truth.heights, truth.spacing, (False, False))
        q, budget = fs.deterministic(replace(found.scene, surface=whole)).leakage, found.budget
        off = [np.abs(np.log(r.leakage.values / q)) for r in (found, measured)]
        rows.append([(budget.lower <= q) & (q <= budget.upper), *off, budget.half_width()])
    inside, continued, measured, width = np.array(rows, float).transpose(1, 0, 2).reshape(4, -1)
    print(
        f"{len(rows)} faces, {inside.size} loads: in the band {inside.sum():.0f}, its half-width {np.median(width):.3f}"
    )
    for name, off in (("continued", continued), ("as measured", measured)):
        print(f"{name}: |ln(leakage/truth)| {np.median(off):.3f} in the median, {off.max():.3f} at most")


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 27)
