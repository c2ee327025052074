"""Find how large a generated surface must be for a seal from a drawing, and how many points its marks need.

    python tests/benchmarks/drawing_sizes.py

The ring of the tutorial is made of turned soft copper. It is 1.8 mm wide and has marks every 0.15 mm. Its
leakage is computed from generated surfaces of several sizes and seeds. The script prints a table of the leakage
and of the ends of its 95 % interval, as geometric means over the seeds, and of the largest leakage divided by
the smallest leakage. It takes about half an hour on one core.
"""

import argparse
import tomllib

import numpy as np

import femseal as fs
from femseal.case.reading import parse_case
from femseal.preparation.case_of_drawing import case_of_drawing
from femseal.preparation.drawing_values import read_drawing

DRAWING = {
    "ra": "1.6um",
    "pitch": "0.15mm",
    "inner_diameter": "50mm",
    "outer_diameter": "53.6mm",
    "hardness": "0.5 GPa",
    "force": "36 kN",
}
#: Marks across and along the surface, and points per mark.
SIZES = ((2, 4), (4, 8), (8, 8), (8, 16), (12, 6), (12, 12), (12, 24), (12, 36))
POINTS_PER_MARK = 24
FINER = (16, 24, 32, 48)
#: Nominal pressures [MPa] of the table.
PRESSURES = (40, 60, 80)


def solved(across, along, per_mark, seed):
    """Compute the leakage of the ring and the ends of its interval [mbar·L/s] at `PRESSURES`.

    The axes of the result are (leakage, lower end or upper end; pressure).
    """
    tables = tomllib.loads(case_of_drawing(read_drawing(DRAWING, None)))
    tables["seed"] = seed
    tables["face"]["points"] = [across * per_mark, along * per_mark]
    tables["face"]["size"] = [f"{across * 150} um", f"{along * 150} um"]
    tables["stochastic"]["breadth"] = "1.8 mm"
    if across == 12:
        del tables["stochastic"]["breadth"]
    tables["load"] = {"loading": [f"{p} MPa" for p in (20, *PRESSURES)]}
    tables["output"] = dict.fromkeys(("pictures", "report", "fields"), False)
    results = fs.run(parse_case(tables | {"output": tables["output"] | {"paraview": "none"}}))
    factor = results.leak_basis.factor(fs.base.leak_units.LEAK_UNITS["mbar·L/s"])
    budget = results.budget
    return np.array([results.leakage.values, budget.lower, budget.upper])[:, 1:] / factor


def line(label, results):
    """Print a row of the table from results with the axes (seed; leakage, lower end or upper end; pressure)."""
    leakage, lower, upper = (np.array([result[n] for result in results]) for n in range(3))
    mean = np.exp(np.log(leakage).mean(axis=0))
    below = np.exp(np.log(leakage / lower).mean(axis=0))
    above = np.exp(np.log(upper / leakage).mean(axis=0))
    scatter = leakage.max(axis=0) / leakage.min(axis=0)
    texts = [
        f"{q:.2g} (÷ {b:.2g}, × {a:.2g}; {s:.2g})"
        for q, b, a, s in zip(mean, below, above, scatter, strict=True)
    ]
    print(f"| {label} | {' | '.join(texts)} |", flush=True)


def main():
    """Compute all sizes and numbers of points, and print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seeds", type=int, default=3)
    seeds = range(1, parser.parse_args().seeds + 1)
    print(f"| surface | {' | '.join(f'{p} MPa' for p in PRESSURES)} |")
    for across, along in SIZES:
        results = [solved(across, along, POINTS_PER_MARK, seed) for seed in seeds]
        line(f"{across} × {along} marks", results)
    for per_mark in FINER:
        line(f"{per_mark} points per mark", [solved(12, 24, per_mark, seed) for seed in seeds])


if __name__ == "__main__":
    main()
