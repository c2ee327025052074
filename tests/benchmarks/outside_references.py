"""Findings that others published or compute: what came out of femseal on the same problem.

    python tests/benchmarks/outside_references.py --write

Each module of `references` is one problem: what is measured, its line of the table and its picture;
`test_outside_references.py` beside it asserts the numbers on smaller grids. Nothing is downloaded; a peer that is not
installed is named as absent. `--write` puts table and pictures beside this file, where the documentation takes them from.
"""

from __future__ import annotations

import argparse
import sys
import time
from pathlib import Path

from common import machine, rows, save_report
from references import (
    ball_on_cone,
    bearing,
    critical_area,
    cut_faces,
    finishes,
    open_area,
    programs,
    rock_fractures,
    saddle,
    theories,
    turned_copper,
)

HERE = Path(__file__).parent
PACKAGES = {"Tamaas": "tamaas", "ContactMechanics": "ContactMechanics", "reynoldsflow": "reynoldsflow"}


def critical_areas():
    return {
        "critical": critical_area.critical_area(),
        "resolution": critical_area.resolution(),
        "near": critical_area.flow_near_closing(),
        "factor": critical_area.flow_factor(),
    }


#: By name: what is measured, lines of the table made of it, pictures of it by name.
REFERENCES = {
    "bearing area": (bearing.bearing_area, lambda r: [bearing.line(r)], {"bearing_area": bearing.draw}),
    "saddle point": (saddle.saddle_point, lambda r: [saddle.line(r)], {"saddle_point": saddle.draw}),
    "critical area": (
        critical_areas,
        critical_area.lines,
        {"critical_area": critical_area.draw, "near_closing": critical_area.draw_flow},
    ),
    "finishes": (finishes.leakage_of_finishes, lambda r: [finishes.line(r)], {"finishes": finishes.draw}),
    "ball on a cone": (
        ball_on_cone.leakage_of_seat,
        lambda r: [ball_on_cone.line(r)],
        {"ball_on_cone": ball_on_cone.draw},
    ),
    "other programs": (programs.fields, programs.lines, {}),
    "small loads": (theories.persson, lambda r: [theories.persson_line(r)], {"persson": theories.draw_persson}),
    "open area": (open_area.open_areas, lambda r: [open_area.line(r)], {"open_area": open_area.draw}),
    "cut faces": (cut_faces.cut_faces, lambda r: [cut_faces.line(r)], {}),
    "turned copper": (turned_copper.turned_copper, lambda r: [turned_copper.line(r)], {}),
    "rock fractures": (
        rock_fractures.rock_fractures,
        lambda r: [rock_fractures.line(r)],
        {"rock": rock_fractures.draw},
    ),
    "summits": (theories.greenwood_williamson, lambda r: [theories.greenwood_williamson_line(r)], {}),
}


def save_picture(draw, record, name):
    import matplotlib.pyplot as plt

    figure, ax = plt.subplots(figsize=(5, 3.6), layout="constrained")
    draw(record, ax)
    ax.grid(alpha=0.3)
    figure.savefig(HERE / f"outside_references_{name}.png", dpi=80)
    plt.close(figure)


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--write", action="store_true", help="write table and pictures")
    options = parser.parse_args()
    cells, pictures = [], []
    for name, (measure, lines, draws) in REFERENCES.items():
        start = time.process_time()
        record = measure()
        print(f"{name}: {time.process_time() - start:.0f} s of one core", file=sys.stderr, flush=True)
        cells += lines(record)
        for picture, draw in draws.items():
            pictures.append(f"![{picture.replace('_', ' ')}](outside_references_{picture}.png)")
            if options.write:
                save_picture(draw, record, picture)
    table = rows(["claim", "source", "what came out"], cells)
    minutes = time.process_time() / 60
    text = f"{machine(PACKAGES)}. Measured in {minutes:.0f} minutes of one core.\n\n{table}"
    print(text)
    if options.write:
        save_report(__file__, "Outside references", "\n\n".join([text, *pictures]))


if __name__ == "__main__":
    main()
