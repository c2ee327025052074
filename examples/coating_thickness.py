"""Compute the force that a silver-plated ring needs, as a function of the thickness of its plating.

    python examples/coating_thickness.py OUT

The ring of `silver_ring.toml` is computed with platings of 5 to 100 µm, with solid silver, and without a plating. The
script writes coating_thickness.csv and a picture into the folder OUT. It takes about four minutes on one core.
"""

from __future__ import annotations

import argparse
import csv
import tomllib
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from matplotlib.figure import Figure

import femseal as fs
from femseal.case import Case, parse_case

CASE = Path(__file__).parent / "silver_ring.toml"
#: Thicknesses of the plating [µm]; the last one stands for solid silver.
THICKNESSES = (5.0, 10.0, 20.0, 50.0, 100.0, 1e4)
#: Contact area of the ring [m²].
AREA = np.pi / 4 * (51.8e-3**2 - 50e-3**2)
#: Factor on the forces with which the bare ring is computed.
MORE_FORCE = 2.5


class Need(NamedTuple):
    """Smallest force [kN] at which the ring meets the limit, and both ends of the 95 % interval of this force.

    A value is inf if the largest force of the run is not enough, and 0 if the smallest force is already enough.
    """

    computed: float
    lower: float
    upper: float


def ring(thickness: float | None, face: dict[str, Any] | None = None) -> Case:
    """Return the case of the ring with a plating of the given thickness [µm], or without a plating (None).

    The bare ring is pressed with larger forces.

    face : keys of the table [face] that are replaced.
    """
    data = tomllib.loads(CASE.read_text(encoding="utf-8"))
    data["face"] |= face or {}
    # the force in assembly needs no unloading, and few realisations, as the interval is mostly that of the surface
    load = data["load"]
    del load["unload_from"], load["unloading"]
    data["stochastic"]["realisations"] = 5
    if thickness is not None:
        data["material"]["coating"]["thickness"] = f"{thickness:g} um"
        return parse_case(data)
    del data["material"]["coating"]
    load["loading"] = [f"{MORE_FORCE * kilonewtons(force):g} kN" for force in load["loading"]]
    return parse_case(data)


def kilonewtons(force: str) -> float:
    """Return the number of a force such as '2 kN'."""
    return float(force.removesuffix("kN"))


def needed_force(case: Case) -> Need:
    """Run a case, and return the force at which the ring meets its leakage limit."""
    results = fs.run(case, workers=1)
    need = results.verdicts[0].assembly
    return Need(*(AREA * 1e-3 * pressure for pressure in (need.computed, need.low, need.value)))


def draw(needs: dict[float, Need], path: Path) -> None:
    """Draw the force against the thickness of the plating, with the 95 % interval."""
    from femseal.plots.style import PAGE, STYLES, style

    thicknesses = [t for t in needs if t <= 100]
    lower, computed, upper = (
        np.array([getattr(needs[t], name) for t in thicknesses])
        for name in ("lower", "computed", "upper")
    )
    solid = needs[max(needs)]
    colour = STYLES[0]["color"]
    with style():
        figure = Figure(figsize=(PAGE, 0.75 * PAGE), layout="constrained")
        axes = figure.subplots()
        axes.fill_between(
            thicknesses, lower, upper, color=colour, alpha=0.16, lw=0, label="95 % interval"
        )
        axes.plot(thicknesses, computed, "o-", color=colour, label="as computed")
        axes.axhline(solid.computed, color=colour, ls=":", label="solid silver, as computed")
        axes.set(
            xscale="log",
            ylim=(0, None),
            xlabel="thickness of the silver [µm]",
            ylabel="force that the limit needs [kN]",
        )
        axes.set_xticks(thicknesses, [f"{t:g}" for t in thicknesses])
        axes.minorticks_off()
        axes.legend()
        figure.savefig(path, dpi=300)


def main() -> None:
    """Compute all rings, and write the table and the picture."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("out", type=Path)
    out = parser.parse_args().out
    out.mkdir(parents=True, exist_ok=True)
    needs: dict[float, Need] = {}
    with (out / "coating_thickness.csv").open("w", encoding="utf-8", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(["thickness [um]", "force [kN]", "by lower end [kN]", "by upper end [kN]"])
        for thickness in (*THICKNESSES, None):
            need = needed_force(ring(thickness))
            needs[thickness or 0.0] = need
            writer.writerow([thickness or 0, *(f"{force:.3g}" for force in need)])
            file.flush()
    bare = needs.pop(0.0)
    draw(needs, out / "coating_thickness.png")
    print(f"without silver: {bare.computed:.3g} kN, with the whole interval {bare.upper:.3g} kN")


if __name__ == "__main__":
    main()
