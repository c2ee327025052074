"""Drawn seals against whole faces: calibration of their bands, and how these hold elsewhere.

    python drawn_seals.py solve ROWS.csv SHAPE FIRST LAST   # scenes of seeds from FIRST to LAST − 1
    python drawn_seals.py calibrate ROWS.csv …              # femseal/studies/drawn_seals.csv
    python drawn_seals.py report ROWS.csv …                 # drawn_seals.md, of rows of other seeds

A scene is a whole face, whose deterministic leakage is the truth, and a patch of it, from which
seals are drawn. A shape is "in-place": as broad as the patch and four times as long; "broad":
twice and four times as broad; "ring" and "mesh": as "broad", on a ring so large that it is
straight, and on triangles.
"""

from __future__ import annotations

import sys
import tempfile
import warnings
from dataclasses import replace
from itertools import product
from pathlib import Path

import numpy as np

import femseal as fs
from common import BAND_HEAD, band_cells, machine, print_report, read_rows, table, write_rows
from drawn_scenes import Drawn
from femseal.budget import error_budget
from femseal.loads import first_known
from femseal.seal import AnnularLayout, MeshLayout
from femseal.studies import drawn_error

SURFACES = ("self-affine", "turned", "ground", "bumps")
#: Length and breadth of the whole face in sides of the patch.
SIDES = {"in-place": ((4, 1),), "broad": ((4, 2), (8, 4)), "ring": ((4, 2),), "mesh": ((4, 2),)}
#: Decades of the leakage below that of the first load.
DECADES = ((-1.0, 1.0), (1.0, 2.0), (2.0, 3.0), (-1.0, 2.0))
#: Inlet pressure of a fluid that acts, in parts of the lowest load.
ACTS = (0.1, 0.6)
TOLD = """Leakage of drawn seals over that of the whole face, at the loads at which it leaks so many
decades less than at the first; fraction of these loads whose truth the 95 % band of the budget
holds, and the median half-width of the band as a factor. In every other scene a fluid acts."""


def scene_of(surface, seed, length, breadth):
    """A whole face and the patch of it under the same loads; in every other a fluid acts."""
    drawn = Drawn(surface, seed, length, 0 if breadth == 1 else 96, breadth)
    rng = np.random.default_rng([seed, length, breadth])
    whole, n = drawn.scene(), drawn.numbers["points"]
    acts = seed % 2 == 1
    inlet = rng.uniform(*ACTS) * min(whole.steps.pressures) if acts else 1e7
    whole = replace(whole, fluid_pressure="acts" if acts else "ignored", inlet_pressure=inlet)
    heights = np.ascontiguousarray(whole.surface.heights[:n, :n])
    patch = fs.Topography(heights, whole.surface.spacing, (False, False)).detrend()
    return whole, replace(whole, surface=patch)


def mesh_of(size, side, folder):
    """A rectangle of triangles [m], with its inlet and outlet, as a file."""
    import meshio
    from skfem import MeshTri

    lines = (np.linspace(0, length, max(2, round(length / side)) + 1) for length in size)
    made = MeshTri.init_tensor(*lines)
    x1 = made.p[0][made.facets]
    ends = [made.facets.T[np.isclose(x1, at).all(axis=0)] for at in (0.0, size[0])]
    tags = [np.repeat([1, 2], len(ends[0])), np.full(made.nelements, 3)]
    mesh = meshio.Mesh(
        np.pad(made.p.T, ((0, 0), (0, 1))),
        [("line", np.concatenate(ends)), ("triangle", made.t.T)],
        cell_data={"gmsh:physical": tags, "gmsh:geometrical": tags},
        field_data={
            "inlet": np.array([1, 1]),
            "outlet": np.array([2, 1]),
            "seal": np.array([3, 2]),
        },
    )
    path = Path(folder) / "rectangle.msh"
    mesh.write(path, file_format="gmsh22", binary=False)
    return path


def drawn_of(shape, patch, size, folder):
    """Seals of a shape, as large as the whole face."""
    if shape == "ring":
        ring = AnnularLayout(20 * size[0], 21 * size[0])
        return fs.stochastic(replace(patch, layout=ring), None, fs.Sampling(None, seed=1))
    if shape == "mesh":
        path = mesh_of(size, patch.surface.size[0] / 4, folder)
        layout = MeshLayout(path, "m", "inlet", "outlet", lay="x2")
        return fs.stochastic(replace(patch, layout=layout), None, fs.Sampling(None, seed=1))
    wide = None if shape == "in-place" else size[0]
    return fs.stochastic(patch, None, fs.Sampling(size[1], seed=1, breadth=wide))


def solved_rows(shape, seeds):
    """A row for each step of each scene."""
    with tempfile.TemporaryDirectory() as folder:
        for seed, sides, surface in product(seeds, SIDES[shape], SURFACES):
            try:
                yield from of_scene(shape, surface, seed, *sides, folder)
            except fs.FemsealError as reason:
                print(shape, surface, seed, reason, file=sys.stderr)


def of_scene(shape, surface, seed, length, breadth, folder):
    """The rows of one scene."""
    whole, patch = scene_of(surface, seed, length, breadth)
    truth = fs.deterministic(whole).leakage
    if not np.nanmax(truth, initial=0.0) > 0:
        return
    drawn = drawn_of(shape, patch, whole.surface.size, folder)
    q = drawn.quantile(0.5)
    budget = error_budget(patch, drawn)
    first = truth[first_known(truth)]
    columns = {"leakage": q / first, "truth": truth / first}
    columns |= {"lower": budget.lower / first, "upper": budget.upper / first}
    columns |= {"decades": drawn_error.decades(q)}
    columns |= {"difficulty": drawn_error.difficulty(whole.steps, q)}
    same = {"kind": "in place" if drawn.tiles.in_place else "anywhere", "shape": shape}
    same |= {"surface": surface, "scene": f"{surface} {seed} {breadth}"}
    for s in np.flatnonzero(np.isfinite(q) & np.isfinite(truth)):
        yield same | {"step": s} | {name: f"{value[s]:.6g}" for name, value in columns.items()}


def calibrated(rows):
    """Rows of the calibration set: distances to a truth not below the floor of the bands."""
    for row in rows:
        leakage, truth = float(row["leakage"]), float(row["truth"])
        if leakage > 0:
            floor = 10.0 ** -drawn_error.FLOOR_DECADES[row["kind"]]
            off = leakage / truth if truth >= floor else max(leakage / floor, 1.0)
            names = ("kind", "surface", "scene", "step")
            same = {name: row[name] for name in names} | {"log_ratio": f"{np.log(off):.4g}"}
            yield same | {name: row[name] for name in ("decades", "difficulty")}


def report(rows):
    """Quantiles of leakage over truth, and bands, by shape and decades."""
    lines = []
    for shape in SIDES:
        for low, high in DECADES:
            chosen = [
                row
                for row in rows
                if row["shape"] == shape and low <= decades_of(row["truth"]) < high
            ]
            if chosen:
                scenes = len({row["scene"] for row in chosen})
                decades = f"{max(low, 0):g} to {high:g}"
                lines.append([shape, decades, scenes, *band_cells(chosen)])
    return f"{TOLD}\n\n{table(['shape', 'decades', 'scenes', *BAND_HEAD], lines)}"


def decades_of(ratio):
    """Decades that a leakage has fallen."""
    return -np.log10(float(ratio)) if float(ratio) > 0 else np.inf


def commands(script, title, solve, kinds, told):
    """What both scripts of the calibration set do: solve rows, calibrate their kinds, report."""
    warnings.simplefilter("ignore")
    command, *paths = sys.argv[1:] or ["--help"]
    if command == "solve":
        write_rows(paths[0], solve(paths[1:]))
    elif command == "calibrate":
        rows = [row for row in read_rows(paths) if row["kind"] in kinds]
        anew = {row["kind"] for row in rows}
        known = read_rows([drawn_error.CALIBRATION])
        others = [row for row in known if row["kind"] not in anew]
        write_rows(drawn_error.CALIBRATION, [*others, *calibrated(rows)])
    elif command == "report":
        print_report(script, title, f"{machine()}\n\n{told(read_rows(paths))}", write=True)
    else:
        print(sys.modules["__main__"].__doc__)


if __name__ == "__main__":
    commands(
        __file__,
        "Drawn seals against whole faces",
        lambda given: solved_rows(given[0], range(*map(int, given[1:]))),
        ("in place", "anywhere"),
        report,
    )
