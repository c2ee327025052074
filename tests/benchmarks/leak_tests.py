"""Whether a calibration finds what made a leak test: hardness, shortest wave and factor.

    python tests/benchmarks/leak_tests.py --tests 1
    python tests/benchmarks/leak_tests.py --write

Every test is of a generated face of its own of 160² points, self-affine or turned, solved with a
hardness within 1.4 times to either side of that of its case, a shortest wave of 1 to 2.5 times 8
pixels, multiplied by a factor from 0.5 to 2 and, row by row, by 1 + 0.1 times a standard normal
number. What leaks less than 1e-4 of the first is below the detection limit. The calibration knows
the case and the file with the test, and nothing of the hidden values.
"""

from __future__ import annotations

import argparse
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

import femseal as fs
from common import machine, print_report, table
from femseal.calibration.calibrating import with_values
from femseal.case import Case, parse_case

#: Seeds of the tests.
SEEDS = (*range(250_401, 250_411), *range(270_401, 270_421))
#: Heads of the counts of tests whose regions hold the truth, and of the tests.
SUMMARY = ["tests", "true values in the joint 90 % region", "hardness in its 90 % region"]
SUMMARY += ["shortest wave in its region", "factor in its region", "median hardness within 5 %"]
SUMMARY += ["median error of the hardness", "largest error of the hardness"]
HEAD = [
    "seed",
    "surface",
    "rows, of which below the detection limit",
    "scenes",
    "true hardness [GPa]",
    "calibrated hardness [GPa]",
]
HEAD += ["true shortest wave [µm]", "calibrated shortest wave [µm]"]
HEAD += ["true factor", "calibrated factor", "true values in the joint region"]
LOADING, PEAKS, UNLOADING = (
    (60, 120, 200, 300, 400, 500, 600, 700, 800, 900, 1000),
    (300, 700),
    (600, 400, 300, 200, 120, 60),
)
HARDNESS, NOISE, LIMIT = 3e9, 0.1, 1e-4
FACES = (
    {"kind": "self-affine", "rms_slope": 0.2, "roll_off": "50 um"},
    {
        "kind": "turned",
        "pitch": "53.333 um",
        "depth": "0.6 um",
        "feed_error": 0.03,
        "roughness": "0.5 um",
        "roughness_roll_off": "40 um",
    },
)


def case_of(seed: int) -> Case:
    """The case of a seed."""
    size, loads = ["160 um", "160 um"], {"loading": LOADING, "unload_from": PEAKS}
    loads |= {"unloading": UNLOADING}
    return parse_case(
        {
            "method": "deterministic",
            "seed": seed,
            "face": FACES[seed % 2] | {"points": [160, 160], "size": size},
            "material": {"young": "210 GPa", "hardness": f"{HARDNESS} Pa"},
            "load": {name: [f"{p} MPa" for p in values] for name, values in loads.items()},
            "fluid": {"kind": "liquid", "viscosity": "1 mPa*s", "inlet_pressure": "10 MPa"},
        }
    )


def tried(seed: int, folder: Path, workers: int) -> dict[str, Any]:
    """A synthetic test, calibrated: truth, posterior, and whether its regions hold the truth."""
    rng = np.random.default_rng(seed)
    case = case_of(seed)
    truth = np.array(
        [
            HARDNESS * 1.4 ** rng.uniform(-1, 1),
            8e-6 * 2.5 ** rng.uniform(0, 1),
            2 ** rng.uniform(-1, 1),
        ]
    )
    solved = case.model_copy(update={"output": case.output.model_copy(update={"budget": False})})
    results = fs.run(with_values(solved, *truth[:2]), workers=1)
    leakage = (
        results.leakage.values * truth[2] * (1 + NOISE * rng.standard_normal(len(results.steps)))
    )
    limit = LIMIT * leakage[0]
    lines = ["pressure [MPa], branch, unloaded from [MPa], leakage [m²/s]"]
    for step, value in zip(results.steps, leakage, strict=True):
        peak = "" if step.unloaded_from is None else f"{step.unloaded_from / 1e6:g}"
        told = f"{value:.6g}" if value > limit else f"< {limit:.3g}"
        lines.append(f"{step.pressure / 1e6:g}, {step.branch}, {peak}, {told}")
    (folder / "test.csv").write_text("\n".join(lines), encoding="utf-8")
    found = fs.calibrate(case, folder / "test.csv", workers=workers)
    low, high = np.log(found.density.ranges).T
    cube = (np.log(truth) - low) / (high - low)
    cube = np.vstack([cube, (np.log(found.samples) - low) / (high - low)])
    factor = np.log(found.density.quantities(cube)[:, 2:])
    density = found.density.factor_density(cube[:, :2]).log_density(factor)[:, 0]
    return {
        "seed": seed,
        "kind": FACES[seed % 2]["kind"],
        "truth": truth,
        "found": [(one.median, one.lower, one.upper) for one in found.posterior.values()],
        "joint": bool(np.mean(density[1:] < density[0]) > 0.1),
        "rows": len(found.test.steps),
        "sealed": int(found.test.sealed.sum()),
        "scenes": len(found.scenes),
    }


def summary(found: list[dict[str, Any]]) -> list[str]:
    """The line of `SUMMARY` for some tests."""
    errors = [hardness_error(one) for one in found]
    held = [sum(one["joint"] for one in found)]
    for n in range(3):
        held.append(
            sum(one["found"][n][1] <= one["truth"][n] <= one["found"][n][2] for one in found)
        )
    close = sum(error <= 0.05 for error in errors)
    return [len(found), *held, close, f"{np.median(errors):.2g}", f"{max(errors):.2g}"]


def hardness_error(one: dict[str, Any]) -> float:
    """Relative error of the median hardness of a test."""
    return abs(one["found"][0][0] / one["truth"][0] - 1)


def told(one: dict[str, Any]) -> list[str]:
    """The line of `HEAD` for a test."""
    line = [one["seed"], one["kind"], f"{one['rows']}, {one['sealed']}", one["scenes"]]
    for n, unit in enumerate((1e9, 1e-6, 1.0)):
        median, low, high = (f"{value / unit:.3g}" for value in one["found"][n])
        line += [f"{one['truth'][n] / unit:.3g}", f"{median} ({low} to {high})"]
    return [*line, "yes" if one["joint"] else "no"]


def main() -> None:
    """Solve and calibrate the tests, and print and write the tables."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--tests", type=int, default=len(SEEDS))
    parser.add_argument("--workers", type=int, default=1)
    parser.add_argument("--write", action="store_true", help="write the report beside the script")
    given = parser.parse_args()
    found = []
    for seed in SEEDS[: given.tests]:
        with TemporaryDirectory() as folder:
            found.append(tried(seed, Path(folder), given.workers))
        print(found[-1], flush=True)
    counts, tests = table(SUMMARY, [summary(found)]), table(HEAD, map(told, found))
    text = f"{machine(['scipy'])}\n\nThe first table counts tests. In the second table, the values in brackets are 90 % regions.\n\n{counts}\n\n{tests}"
    print_report(__file__, "Calibration by leak tests", text, given.write)


if __name__ == "__main__":
    main()
