"""Whether a calibration finds what made a leak test: hidden hardness, shortest wave and factor of synthetic tests.

    python tests/benchmarks/leak_tests.py --write

Every test is of a generated face of its own of 160² points, self-affine or turned, solved with a hardness within 1.4 times to
either side of that of its case, a shortest wave of 1 to 2.5 times 8 pixels, multiplied by a factor from 0.5 to 2 and, row by row, by
1 + 0.1 times a standard normal number. What leaks less than 1e-4 of the first is below the detection limit. The calibration knows
the case and the file with the test, and nothing of the hidden values.
"""

from __future__ import annotations

import argparse
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
from common import machine, rows, save_report

#: Seeds of the tests.
SEEDS = (*range(250_401, 250_411), *range(270_401, 270_421))
#: Heads of the counts of tests whose regions hold the truth.
SUMMARY = ["tests", "truth in the joint 90 % region", "in that of the hardness", "of the shortest wave", "of the factor",
           "median hardness within 5 %", "its error in the median", "at most"]  # fmt: skip
LOADING, PEAKS, UNLOADING = (
    (60, 120, 200, 300, 400, 500, 600, 700, 800, 900, 1000),
    (300, 700),
    (600, 400, 300, 200, 120, 60),
)
HARDNESS, NOISE, LIMIT = 3e9, 0.1, 1e-4
FACES = {
    "self-affine": 'kind = "self-affine"\nrms_slope = 0.2\nroll_off = "50 um"',
    "turned": 'kind = "turned"\npitch = "53.333 um"\ndepth = "0.6 um"\nfeed_error = 0.03\nroughness = "0.5 um"\n'
    'roughness_roll_off = "40 um"',
}


def case_text(seed: int) -> tuple[str, str]:
    """Kind of the face and case file of a seed."""
    kind = list(FACES)[seed % 2]
    loads = "".join(
        f"{name} = {[f'{p} MPa' for p in values]}\n"
        for name, values in (("loading", LOADING), ("unload_from", PEAKS), ("unloading", UNLOADING))
    )
    return kind, (
        f'method = "deterministic"\nseed = {seed}\n[face]\n{FACES[kind]}\npoints = [160, 160]\n'
        f'size = ["160 um", "160 um"]\n[material]\nyoung = "210 GPa"\nhardness = "{HARDNESS / 1e9} GPa"\n'
        f'[load]\n{loads}[fluid]\nkind = "liquid"\nviscosity = "1 mPa*s"\ninlet_pressure = "10 MPa"\n'
    )


def tried(seed: int, folder: Path, workers: int) -> dict[str, Any]:
    """A synthetic test, calibrated: truth, posterior, and whether its regions hold the truth."""
    import femseal as fs
    from femseal.calibration.calibrating import with_values

    rng = np.random.default_rng(seed)
    kind, text = case_text(seed)
    (folder / "case.toml").write_text(text, encoding="utf-8")
    case = fs.load_case(folder / "case.toml")
    truth = np.array([HARDNESS * 1.4 ** rng.uniform(-1, 1), 8e-6 * 2.5 ** rng.uniform(0, 1), 2 ** rng.uniform(-1, 1)])
    solved = case.model_copy(update={"output": case.output.model_copy(update={"budget": False})})
    results = fs.run(with_values(solved, *truth[:2]), workers=1)
    leakage = results.leakage.values * truth[2] * (1 + NOISE * rng.standard_normal(len(results.steps)))
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
    density = found.density.log_density(np.vstack([cube, (np.log(found.samples) - low) / (high - low)]))
    return {
        "seed": seed,
        "kind": kind,
        "truth": truth,
        "found": [(one.median, one.lower, one.upper) for one in found.posterior.values()],
        "joint": bool(np.mean(density[1:] < density[0]) > 0.1),
        "rows": len(found.test.steps),
        "sealed": int(found.test.sealed.sum()),
        "scenes": len(found.scenes),
        "notes": found.notes,
    }


def within(one: dict[str, Any], n: int) -> bool:
    """Whether the region of a quantity holds its truth."""
    return bool(one["found"][n][1] <= one["truth"][n] <= one["found"][n][2])


def hardness_errors(found: list[dict[str, Any]]) -> list[float]:
    """Relative error of the median hardness of every test."""
    return [abs(one["found"][0][0] / one["truth"][0] - 1) for one in found]


def summary(found: list[dict[str, Any]]) -> list[str]:
    """The line of `SUMMARY` for some tests."""
    errors = hardness_errors(found)
    held = [sum(one["joint"] for one in found), *(sum(within(one, n) for one in found) for n in range(3))]
    close = sum(error <= 0.05 for error in errors)
    return [
        str(len(found)),
        *map(str, held),
        str(close),
        f"{100 * np.median(errors):.2g} %",
        f"{100 * max(errors):.2g} %",
    ]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--tests", type=int, default=len(SEEDS))
    parser.add_argument("--workers", type=int, default=1)
    parser.add_argument("--write", action="store_true")
    options = parser.parse_args()
    found = []
    for seed in SEEDS[: options.tests]:
        with TemporaryDirectory() as folder:
            found.append(tried(seed, Path(folder), options.workers))
        print(found[-1], flush=True)
    errors = hardness_errors(found)
    heads = ["seed", "face", "rows, below the limit", "scenes", "hardness [GPa]", "found", "error", "wave [µm]", "found",
             "factor", "found", "in the joint region"]  # fmt: skip
    cells = []
    for one, error in zip(found, errors, strict=True):
        line = [str(one["seed"]), one["kind"], f"{one['rows']}, {one['sealed']}", str(one["scenes"])]
        for n, size in enumerate((1e9, 1e-6, 1.0)):
            median, low, high = (value / size for value in one["found"][n])
            line += [f"{one['truth'][n] / size:.3g}", f"{median:.3g} ({low:.3g} to {high:.3g})"]
            line += [f"{100 * error:.2g} %"] if n == 0 else []
        cells.append([*line, "yes" if one["joint"] else "no"])
    counts = [summary(found[:10])] + ([summary(found)] if len(found) > 10 else [])
    report = "\n".join(
        [
            machine({"scipy": "scipy"}),
            "",
            "In brackets: 90 % regions.",
            "",
            rows(SUMMARY, counts),
            "",
            rows(heads, cells),
        ]
    )
    print(report)
    if options.write:
        save_report(__file__, "Calibration by leak tests", report)


if __name__ == "__main__":
    main()
