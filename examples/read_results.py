"""Results of a case
=================

This script reads a results folder: the table of results, single numbers by name, the pictures and the report. To create
the folder, run ``femseal run examples/turned_seal.toml -o results/turned_seal``.
"""

from __future__ import annotations

import sys
from pathlib import Path

import femseal as fs


def loading_over_unloading(results: fs.Results) -> dict[float, float]:
    """Divide the leakage on loading by the leakage on unloading from the highest peak load.

    The keys of the result are the nominal pressures [Pa].
    """
    leakage = dict(zip(results.steps, results.leakage.values, strict=True))
    peak = max(step.pressure for step in leakage)
    loading = {
        step.pressure: value for step, value in leakage.items() if step.unloaded_from is None
    }
    return {
        step.pressure: float(loading[step.pressure] / value)
        for step, value in leakage.items()
        if step.unloaded_from == peak and value > 0 and step.pressure in loading
    }


if __name__ == "__main__":
    import rich

    try:
        results = fs.open_results(Path(sys.argv[1] if len(sys.argv) > 1 else "results/turned_seal"))
    except fs.InputError as error:
        sys.exit(f"{error}\nusage: python read_results.py DIR")
    rich.print(results.table())
    for pressure, ratio in loading_over_unloading(results).items():
        print(f"{pressure / 1e6:g} MPa: {ratio:.3g} times less after the peak")
    highest = results.dataset["nominal_pressure"].argmax("step")
    print(f"leakage at the peak: {float(results.leakage[highest]):.4g} m²/s")
    print("page:", fs.write_report(results))
    leakage, cells = results.plot(), results.plot_cells()
    leakage.savefig("leakage.png")
    cells.savefig("cells.png")
