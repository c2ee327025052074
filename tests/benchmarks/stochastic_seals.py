"""Compare stochastic seals with whole surfaces: calibrate their intervals, and test the intervals on other scenes.

    python stochastic_seals.py solve ROWS.csv SHAPE FIRST LAST   # scenes of seeds from FIRST to LAST − 1
    python stochastic_seals.py calibrate ROWS.csv …              # femseal/studies/interval_calibration.csv
    python stochastic_seals.py report ROWS.csv …                 # stochastic_seals.md, from rows of other seeds

A scene is a whole surface, whose deterministic leakage is the true leakage, and two patches of it. Seals are
simulated from each patch, and from both patches together. A shape is one of:

    in-place   as wide as the patch and four times as long
    broad      twice as wide as the patch and four times as long
    broader    four times as wide as the patch and eight times as long
    ring       as "broad", on a ring that is so large that it is straight
    mesh       as "broad", on a mesh of triangles
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
from common import machine, print_report, read_rows, table, write_rows
from drawn_scenes import KINDS, Drawn
from femseal.budget import error_budget
from femseal.loads import first_known
from femseal.seal import AnnularLayout, MeshLayout
from femseal.studies import patch_interval
from femseal.studies.patch_state import PatchState
from femseal.topography import Patches
from interval_tables import by_half_decade, by_surface, of_patches

SURFACES = tuple(kind for kind in KINDS if kind != "filtered")
#: Length and breadth of the whole face in sides of the patch.
SIDES = {"in-place": ((4, 1),), "broad": ((4, 2),), "broader": ((8, 4),)}
SIDES |= {"ring": ((4, 2),), "mesh": ((4, 2),)}
#: Decades of the leakage below that of the first load.
DECADES = ((-1.0, 1.0), (1.0, 2.0), (2.0, 3.0), (-1.0, 2.0))
#: The patches of a whole face.
PATCHES = ("first", "second", "both")
#: Inlet pressure of a fluid that acts, in parts of the lowest load.
ACTS = (0.1, 0.6)
INTRODUCTION = """Seals were simulated from a single patch. The table shows their leakage divided by the leakage of the whole surface. The loads
are grouped by how many decades the leakage of the whole surface has fallen below its value at the first load. In every third
scene, the fluid pressure acts on the surfaces."""
SURFACES_TEXT = """Each interval was computed from one patch. The table shows at which fraction of
the loads it contains the true leakage. The first group consists of the simulations that were used for the calibration.
In the second group, the same simulations are judged by a calibration without surfaces of their kind. The third group
consists of simulations that were not used for the calibration."""
HALF_DECADES_TEXT = """In the next table, the loads are grouped by how many decades the true leakage has fallen below its
value at the first load. The column "half-width" contains the median factor between the leakage and an end of its
interval, without intervals that begin at 0. For "two patches", two patches of the same surface are used together."""
#: Names of shapes in the report.
SHAPE_NAMES = {"in-place": "as wide as the patch", "broad": "twice as wide"}
#: Kinds of drawn seals that this script calibrates.
KINDS_OF_SEALS = ("in order", "at random")
#: Heads of `ratio_cells`.
RATIO_HEAD = ["loads", "5 %", "25 %", "50 %", "75 %", "95 %"]


def scene_of(surface, seed, length, breadth):
    """Return the scene of a whole surface, and its patches: two separate patches, and both patches together.

    In every third scene, a fluid pressure acts on the surfaces. The second patch is far from the first patch.
    """
    side = 0 if breadth == 1 and seed % 3 == 0 else 96
    drawn = Drawn(surface, seed, length, side, breadth)
    rng = np.random.default_rng([seed, length, breadth])
    whole, n = drawn.scene(), drawn.numbers["points"]
    acts = seed % 3 == 1
    inlet = rng.uniform(*ACTS) * min(whole.steps.pressures) if acts else 1e7
    whole = replace(whole, fluid_pressure="acts" if acts else "ignored", inlet_pressure=inlet)
    corners = (0, 0), ((breadth // 2) * n, (length // 2) * n)
    patches = []
    for a, b in corners:
        heights = np.ascontiguousarray(whole.surface.heights[a : a + n, b : b + n])
        patches.append(fs.Topography(heights, whole.surface.spacing, (False, False)).detrend())
    return whole, [*patches, Patches(patches)]


def mesh_of(size, side, folder):
    """Write a rectangle of triangles [m] with its inlet and outlet to a file, and return the path."""
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
    """Simulate seals of a shape, as large as the whole surface."""
    if shape == "ring":
        ring = AnnularLayout(20 * size[0], 21 * size[0])
        return fs.stochastic(replace(patch, layout=ring), None, fs.Sampling(None, seed=1))
    if shape == "mesh":
        path = mesh_of(size, patch.surface.size[0] / 4, folder)
        layout = MeshLayout(path, "m", "inlet", "outlet", lay="x2")
        return fs.stochastic(replace(patch, layout=layout), None, fs.Sampling(None, seed=1))
    wide = None if shape == "in-place" else size[0]
    return fs.stochastic(patch, None, fs.Sampling(size[1], seed=1, breadth=wide))


def solved_rows(shape, seeds, surfaces=SURFACES):
    """Yield a row for each load step of each scene."""
    with tempfile.TemporaryDirectory() as folder:
        for seed, sides, surface in product(seeds, SIDES[shape], surfaces):
            try:
                yield from of_scene(shape, surface, seed, *sides, folder)
            except fs.FemsealError as reason:
                print(shape, surface, seed, reason, file=sys.stderr)


def of_scene(shape, surface, seed, length, breadth, folder):
    """Yield the rows of one scene, for each patch and for both patches together."""
    whole, patches = scene_of(surface, seed, length, breadth)
    truth = fs.deterministic(whole).leakage
    if not np.nanmax(truth, initial=0.0) > 0:
        return
    same = {"shape": shape, "surface": surface, "scene": f"{surface} {seed} {breadth}"}
    for name, patch in zip(PATCHES, patches, strict=True):
        part = replace(whole, surface=patch)
        drawn = drawn_of(shape, part, whole.surface.size, folder)
        kind = {"kind": "in order" if drawn.tiles.in_order else "at random"}
        budget = error_budget(part, drawn)
        yield from state_rows(kind | same | {"patch": name}, part, drawn, budget, truth)


def state_rows(same, scene, study, budget, truth):
    """Yield a row for each load step of a study: its contact state, its leakage and the true leakage.

    Leakages are divided by the leakage of an open seal.
    """
    q, steps = budget.leakage, scene.steps
    unknown = np.full(len(steps), np.nan)
    still_open = study.open_leakage(scene)
    state = getattr(study, "patch_state", None) or PatchState(*[unknown] * 3, still_open)
    known = np.isfinite(q) & np.isfinite(truth) & (still_open > 0)
    columns = {"load": steps.pressures / max(steps.pressures)}
    columns |= {"peak": steps.pressures[steps.peak_indices] / max(steps.pressures)}
    with np.errstate(divide="ignore", invalid="ignore"):
        columns |= {"leakage": q / still_open, "truth": truth / still_open}
        columns |= {"lower": budget.lower / still_open, "upper": budget.upper / still_open}
        columns |= {"decades": np.log10(truth[first_known(truth)] / truth)}
    columns |= {"carriers": state.carriers, "contact": state.contact_fraction}
    columns |= {"detours": state.detours}
    for s in np.flatnonzero(known):
        yield same | {"step": s} | {name: f"{value[s]:.4g}" for name, value in columns.items()}


def calibrated(rows):
    """Yield the rows of the calibration set: contact state, leakage and true leakage."""
    for row in rows:
        yield {name: row[name] for name in patch_interval.CALIBRATION_COLUMNS}


def report(rows):
    """Tabulate how often the intervals contain the true leakage, by shape, by kind of surface and by half decade."""
    lines = []
    for shape in SIDES:
        for low, high in DECADES:
            chosen = [
                row
                for row in of_patches(rows, single=True)
                if row["shape"] == shape and low <= float(row["decades"]) < high
            ]
            if chosen:
                scenes = len({row["scene"] for row in chosen})
                decades = f"{max(low, 0):g} to {high:g}"
                lines.append([SHAPE_NAMES.get(shape, shape), decades, scenes, *ratio_cells(chosen)])
    texts = [INTRODUCTION, table(["shape", "decades", "scenes", *RATIO_HEAD], lines)]
    for kind in KINDS_OF_SEALS:
        unseen = [row for row in rows if row["kind"] == kind]
        texts += [f"## Cells {kind}", SURFACES_TEXT, by_surface(kind, unseen)]
        texts += [
            HALF_DECADES_TEXT,
            by_half_decade(kind, unseen or patch_interval.calibration_rows(kind)),
        ]
    return "\n\n".join(texts)


def ratio_cells(rows):
    """Return the number of loads, and quantiles of leakage / true leakage."""
    q, truth = (np.array([float(row[name]) for row in rows]) for name in ("leakage", "truth"))
    with np.errstate(divide="ignore", invalid="ignore"):
        quantiles = np.nanquantile(q / truth, [0.05, 0.25, 0.5, 0.75, 0.95])
    return [str(len(rows)), *(f"{r:.2f}" for r in quantiles)]


def commands(script, title, solve, kinds, report_of):
    """Run the command line of both scripts of the calibration set: solve rows, calibrate, or write the report."""
    warnings.simplefilter("ignore")
    command, *paths = sys.argv[1:] or ["--help"]
    if command == "solve":
        write_rows(paths[0], solve(paths[1:]))
    elif command == "calibrate":
        rows = [row for row in read_rows(paths) if row["kind"] in kinds]
        anew = {row["kind"] for row in rows}
        known = read_rows([patch_interval.CALIBRATION])
        others = [row for row in known if row["kind"] not in anew]
        write_rows(patch_interval.CALIBRATION, [*others, *calibrated(rows)])
    elif command == "report":
        print_report(script, title, f"{machine()}\n\n{report_of(read_rows(paths))}", write=True)
    else:
        print(sys.modules["__main__"].__doc__)


if __name__ == "__main__":
    commands(
        __file__,
        "Leakage relative to the whole surface",
        lambda given: solved_rows(given[0], range(*map(int, given[1:]))),
        KINDS_OF_SEALS,
        report,
    )
