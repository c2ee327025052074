"""Compare femseal with published results and with other programs on the same problems.

    python tests/benchmarks/outside_references.py "bearing area"
    python tests/benchmarks/outside_references.py --write
    python tests/benchmarks/outside_references.py handbook --write

The last command writes only the section of the report on the exponents of a handbook. Each function of
`references` solves one problem. `test_outside_references.py` asserts the results on smaller grids. Nothing is
downloaded. Programs that are not installed are left out.
"""

from __future__ import annotations

import argparse
import sys
import time
from functools import partial
from pathlib import Path

import numpy as np

from common import machine_and_time, print_report, table
from peers import present
from references.bearing import bearing_area
from references.critical_area import critical_area, flow_near_closing, resolution
from references.cut_faces import cut_faces
from references.finishes import closing_loads
from references.handbook import CLAIMED, RMS, handbook_exponents, range_text
from references.open_area import open_areas
from references.programs import contact_fields, flow_fields
from references.rock_fractures import rock_fractures
from references.saddle import saddle_point
from references.theories import greenwood_williamson, small_loads
from references.turned_copper import turned_copper

DAPP = "Dapp, Lücke, Persson & Müser, Phys. Rev. Lett. 108, 2012, 244301; Wang & Müser, 2021"
PROGRAMS = ("Tamaas", "ContactMechanics")
#: Problem, claim, source, and what measures it.
REFERENCES = [
    ("bearing area", "A soft material is cut off where the bearing area is p̄/H",
     "limit of the model; test of ContactMechanics", partial(bearing_area, ratios=(0.1, 1e-4))),
    ("saddle point", "The resistance of a saddle point is ∝ (L_c − L)^−3.45 near closing",
     "Dapp & Müser, EPL 109, 2015, 44001", saddle_point),
    ("critical area", "Elastic isotropic surfaces close at a contact area of 0.415 ± 0.02",
     DAPP, critical_area),
    ("pixels", "This area does not depend on the number of pixels per shortest wave", DAPP, resolution),
    ("near closing", "Near closing, the last constriction determines the flow, ∝ (p_c − p)^3.45",
     "Dapp & Müser, Sci. Rep. 6, 2016, 19513 (abstract)", flow_near_closing),
    ("finishes", "From p̄ ≈ 2.75 σ_y on, the finish does not matter; limits by finish and rms height [m]",
     "SAE 650312, 1965 (abstract)", closing_loads),
    *((peer, f"Fields of {peer}", "same run", partial(contact_fields, peer))
      for peer in present(PROGRAMS)),
    *((peer, "Flow through a contact, on finer grids", "reynoldsflow, same run", flow_fields)
      for peer in present(["reynoldsflow"])),
    ("small loads", "At small loads, the contact area is κ p̄/E*h′ with √(8/π) = 1.60 < κ < √(2π) = 2.51",
     "Persson, J. Chem. Phys. 115, 2001, 3840; Bush, Gibson & Thomas, Wear 35, 1975, 87",
     small_loads),
    ("open area", "Open area towards full contact: erfc(√2 p̄/E*h′); 3/4 of it for penny-shaped cracks",
     "Persson 2001; Johnson, Greenwood & Higginson, Int. J. Mech. Sci. 27, 1985, 383",
     open_areas),
    ("cut faces", "K/m₀^1.5 of surfaces cut off at 30 % contact, between reservoirs and periodic",
     "public repository of reynoldsflow, ten surfaces each", cut_faces),
    ("copper", "Radial leakage of turned copper gaskets ends near 50 MPa; range [Pa]",
     "Matsuzaki and co-workers 2006, 2013", turned_copper),
    ("rock", "Fractures of granodiorite keep most of their resistance to flow when unloaded",
     "Vogler and co-workers, Kling and co-workers 2018", rock_fractures),
    ("summits", "Contact area of summits at distances that are large compared with their contacts",
     "Greenwood & Williamson, Proc. R. Soc. A 295, 1966, 300", greenwood_williamson),
]  # fmt: skip


#: Heading of the section on the exponents of a handbook, and its name on the command line.
HANDBOOK_HEADING, HANDBOOK = "## Exponents of a handbook", "handbook"


def handbook_section():
    """Write the section of the report with the exponents of pressure, hardness and finish."""
    exponents_of_faces = handbook_exponents()
    heights = ", ".join(f"{1e6 * rms:g}" for rms in RMS)
    head = ["face", "p̄/H", "−∂ ln k/∂ ln p", "∂ ln k/∂ ln H", "∂ ln k/∂ ln Sq"]
    cells = [["NSWC-11, static seals", "", *(f"{value:g}" for value in CLAIMED.values())]]
    for (kind, load), values in exponents_of_faces.items():
        cells.append([kind, f"{load:g}", *(range_text(values[name]) for name in CLAIMED)])
    text = (
        f"Permeability k across the lay of turned and ground faces, on first loading. Each range covers rms heights "
        f"Sq of {heights} µm. Each value is the mean of three surfaces of 256² points with E* = 115 GPa, H = 2.8 GPa "
        "and 60 µm between the marks. To vary Sq, all heights are multiplied by the same factor. "
        '"1 sealed" means that a surface is sealed at this load for one of the rms heights.'
    )
    return f"{HANDBOOK_HEADING}\n\n{text}\n\n{table(head, cells)}\n"


def write_section(section):
    """Replace the last section of the report, on the exponents of a handbook."""
    path = Path(__file__).with_suffix(".md")
    rest, _, _ = path.read_text(encoding="utf-8").partition(HANDBOOK_HEADING)
    path.write_text(f"{rest.rstrip()}\n\n{section}", encoding="utf-8")


def text_of_records(records):
    """Write records as a text with names, and with numbers of three digits."""
    if isinstance(records, list):
        return "; ".join(map(text_of_records, records))
    pairs = []
    for name, value in records.items():
        words = [f"{n:g}" if isinstance(n, float) else str(n) for n in np.atleast_1d(name)]
        numbers = [f"{v:.3g}" for v in np.atleast_1d(value)]
        pairs.append(f"{', '.join(words)} {', '.join(numbers)}")
    return ", ".join(pairs)


def main():
    """Solve the problems, and print and write the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("problem", nargs="*", help="only these")
    parser.add_argument("--write", action="store_true", help="write the report beside the script")
    options = parser.parse_args()
    if options.problem == [HANDBOOK]:
        section = handbook_section()
        print(section)
        if options.write:
            write_section(section)
        return
    cells = []
    for name, claim, source, measure in REFERENCES:
        if not options.problem or name in options.problem:
            cells.append([claim, source, text_of_records(measure())])
            print(f"{name}: {time.process_time():.0f} s", file=sys.stderr, flush=True)
    head = ["published result, or other program", "source", "result of femseal"]
    intro = machine_and_time(("tamaas", "ContactMechanics", "reynoldsflow"))
    text = f"{intro}\n\n{table(head, cells)}"
    if not options.problem:
        text += f"\n\n{handbook_section().rstrip()}"
    print_report(__file__, "Outside references", text, options.write and not options.problem)


if __name__ == "__main__":
    main()
