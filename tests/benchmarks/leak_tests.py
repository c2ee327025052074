"""Test whether a calibration recovers the parameters of synthetic leak tests: hardness, shortest wave and factor.

    python tests/benchmarks/leak_tests.py --tests 1
    python tests/benchmarks/leak_tests.py --write

Each test has its own generated surface of 160² points, self-affine or turned. The hidden hardness lies between
1/1.4 and 1.4 times the hardness of the case, the hidden shortest wave between 1 and 2.5 times 8 pixels, and the
hidden factor between 0.5 and 2. Each computed leakage is multiplied by the factor and by 1 + 0.1 times a
standard normal number. Leakages below 1e-4 of the first leakage count as below the detection limit. The
calibration is given only the case and the file with the test.
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
    """Return the case of a seed."""
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
    """Generate a synthetic test and calibrate it; return the true values, the posterior, and what its regions contain."""
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
        measured = f"{value:.6g}" if value > limit else f"< {limit:.3g}"
        lines.append(f"{step.pressure / 1e6:g}, {step.branch}, {peak}, {measured}")
    (folder / "test.csv").write_text("\n".join(lines), encoding="utf-8")
    calibration = fs.calibrate(case, folder / "test.csv", workers=workers)
    low, high = np.log(calibration.density.ranges).T
    cube = (np.log(truth) - low) / (high - low)
    cube = np.vstack([cube, (np.log(calibration.samples) - low) / (high - low)])
    factor = np.log(calibration.density.quantities(cube)[:, 2:])
    density = calibration.density.factor_density(cube[:, :2]).log_density(factor)[:, 0]
    return {
        "seed": seed,
        "kind": FACES[seed % 2]["kind"],
        "truth": truth,
        "found": [
            (estimate.median, estimate.lower, estimate.upper)
            for estimate in calibration.posterior.values()
        ],
        "joint": bool(np.mean(density[1:] < density[0]) > 0.1),
        "rows": len(calibration.test.steps),
        "sealed": int(calibration.test.sealed.sum()),
        "scenes": len(calibration.scenes),
    }


def summary(tests: list[dict[str, Any]]) -> list[str]:
    """Return the cells of a row with the heads `SUMMARY` for some tests."""
    errors = [hardness_error(test) for test in tests]
    contained = [sum(test["joint"] for test in tests)]
    for n in range(3):
        contained.append(
            sum(test["found"][n][1] <= test["truth"][n] <= test["found"][n][2] for test in tests)
        )
    close = sum(error <= 0.05 for error in errors)
    return [len(tests), *contained, close, f"{np.median(errors):.2g}", f"{max(errors):.2g}"]


def hardness_error(test: dict[str, Any]) -> float:
    """Compute the relative error of the median hardness of a test."""
    return abs(test["found"][0][0] / test["truth"][0] - 1)


def row_of_test(test: dict[str, Any]) -> list[str]:
    """Return the cells of a row with the heads `HEAD` for a test."""
    line = [test["seed"], test["kind"], f"{test['rows']}, {test['sealed']}", test["scenes"]]
    for n, unit in enumerate((1e9, 1e-6, 1.0)):
        median, low, high = (f"{value / unit:.3g}" for value in test["found"][n])
        line += [f"{test['truth'][n] / unit:.3g}", f"{median} ({low} to {high})"]
    return [*line, "yes" if test["joint"] else "no"]


def main() -> None:
    """Solve and calibrate the tests, and print and write the tables."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--tests", type=int, default=len(SEEDS))
    parser.add_argument("--workers", type=int, default=1)
    parser.add_argument("--write", action="store_true", help="write the report beside the script")
    options = parser.parse_args()
    results = []
    for seed in SEEDS[: options.tests]:
        with TemporaryDirectory() as folder:
            results.append(tried(seed, Path(folder), options.workers))
        print(results[-1], flush=True)
    counts, tests = table(SUMMARY, [summary(results)]), table(HEAD, map(row_of_test, results))
    text = f"{machine(['scipy'])}\n\nThe first table counts tests. In the second table, the ranges in brackets are 90 % credible intervals.\n\n{counts}\n\n{tests}"
    print_report(__file__, "Calibration by leak tests", text, options.write)


if __name__ == "__main__":
    main()
