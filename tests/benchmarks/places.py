"""Several measured places of a face against the whole of it: does the band hold, and how wide is it.

    python tests/benchmarks/places.py --faces 40 --records places.jsonl --write

Long faces of four kinds in turn, self-affine, turned, with milling arcs and ground, are cut into 16 patches as long as
they are broad. The leakage of the whole face is the truth. From 3, 4, 6 and 8 patches drawn at random, each in contact by
itself, the leakage is that of the flow through all of them side by side, and its band is Student's interval by the
jackknife over places, pooled with the scatter that is usual. The patches are a part of the face, so that 8 of them tell of
it more than of a longer one. Faces that are in the file of records are not solved again.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np
from common import kept, machine, rows, save_report

MODULUS, PIXEL, POINTS, PATCHES = 115e9, 1e-6, 96, 16
LOADS = (0.02, 0.06, 0.12, 0.2, 0.28, 0.34)
KINDS, COUNTS = ("self-affine", "turned", "milling arcs", "ground"), (3, 4, 6, 8)
#: Least leakage in that at the first load, for each part of the table.
DEPTHS = {"down to 1/100": 1e-2, "1/100 to 1/1000": 1e-3}


def face_of(kind: str, seed: int):
    """A long face (POINTS, PATCHES · POINTS)."""
    from femseal import Topography, self_affine, turned

    shape = (POINTS, PATCHES * POINTS)
    size = (POINTS * PIXEL, PATCHES * POINTS * PIXEL)
    rough = {"hurst": 0.75, "roll_off": 32e-6, "cut_off": 8e-6, "rng": 9000 + seed}
    if kind == "self-affine":
        return self_affine(shape, size, rms_slope=0.2, **rough)
    if kind == "turned":
        fine = {"roughness": 0.3e-6, "roughness_roll_off": 24e-6, "cut_off": 8e-6, "rng": 9000 + seed}
        return turned(shape, size, pitch=24e-6, depth=0.8e-6, feed_error=0.03, depth_error=0.1, **fine)
    if kind == "ground":  # waves three times as long along the seal
        squeezed = self_affine(shape, (size[0], size[1] / 3), rms_slope=0.3, **rough)
        return Topography(squeezed.heights, (PIXEL, PIXEL)).low_pass(8e-6)
    x1, x2 = ((np.arange(n) + 0.5) * PIXEL for n in shape)
    along = x2 + np.sqrt((4 * size[0]) ** 2 - x1[:, None] ** 2)
    arcs = 0.5e-6 * np.cos(2 * np.pi * np.round(along[0, -1] / 30e-6) * along / along[0, -1])
    return Topography(arcs + self_affine(shape, size, rms_slope=0.15, **rough).heights, (PIXEL, PIXEL))


def solved(kind: str, seed: int) -> dict:
    """Truth, and leakage and band from each number of places, at every load."""
    import femseal as fs
    from femseal.budget.estimates import places_part
    from femseal.studies.face_flow import resolved_flow
    from femseal.studies.place_leakage import place_leakage

    face = face_of(kind, seed)
    hardness = 0.1 * MODULUS * face.rms_slope
    given = {"modulus": MODULUS, "hardness": hardness, "fluid": fs.Liquid(1e-3), "inlet_pressure": 1e5}
    given |= {"outlet_pressure": 0.0, "loading": tuple(hardness * x for x in LOADS)}
    truth = fs.deterministic(fs.Scene(face, **given)).leakage
    patches = [fs.Topography(z, face.spacing) for z in np.split(face.heights, PATCHES, axis=1)]
    gaps = [fs.deterministic(fs.Scene(patch, **given)).gap for patch in patches]
    rng, found = np.random.default_rng(seed), []
    for count in COUNTS:
        chosen = rng.permutation(PATCHES)[:count]
        scene = fs.Scene([patches[n] for n in chosen], **given)
        gap = np.concatenate([gaps[n] for n in chosen], axis=2)
        unit = 1e5 / 1e-3 / (POINTS * PIXEL)
        leakage = unit * np.array([resolved_flow(g, face.spacing).permeability for g in gap])
        places = place_leakage(scene, gap)
        part = places_part(leakage, places.without)
        one = {
            "leakage": leakage,
            "without": places.without,
            "lower": part.lower,
            "upper": part.upper,
            "scatter": places.scatter,
        }
        found.append({"places": count} | {name: np.asarray(values).tolist() for name, values in one.items()})
    return {"kind": kind, "seed": seed, "truth": truth.tolist(), "found": found}


def report(records: list[dict]) -> str:
    """The tables."""
    head = ["places", "leakage of", "cases", "band holds", "half-width", "error, median", "error, 90 of 100"]
    cells = []
    for depth, least in DEPTHS.items():
        most = {"down to 1/100": np.inf, "1/100 to 1/1000": 1e-2}[depth]
        for count in COUNTS:
            cells.append([f"{count}", depth, *_line([_cases(r, count, least, most) for r in records])])
    by_kind = [
        [kind, f"{count}", *_line([_cases(r, count, 1e-2, np.inf) for r in records if r["kind"] == kind])]
        for kind in KINDS
        for count in COUNTS
    ]
    faces = ", ".join(f"{sum(r['kind'] == kind for r in records)} {kind}" for kind in KINDS)
    text = f"{len(records)} faces ({faces}), {len(LOADS)} loads each. {machine({})}.\n\n"
    return text + rows(head, cells) + "\n\nBy kind, down to 1/100:\n\n" + rows(["kind", "places", *head[2:]], by_kind)


def _cases(record: dict, count: int, least: float, most: float) -> np.ndarray:
    """Whether the band holds, its half-width, and the error at the loads of such leakage (cases, 3)."""
    truth = np.array(record["truth"])
    one = next(f for f in record["found"] if f["places"] == count)
    q, low, high = (np.array(one[name], float) for name in ("leakage", "lower", "upper"))
    at = (truth >= least * truth[0]) & (truth < most * truth[0])
    half = np.where(q > 0, (high - low) / 2 / np.where(q > 0, q, 1), np.inf)
    return np.stack([(low <= truth) & (truth <= high), half, np.abs(q / truth - 1)], axis=1)[at]


def _line(cases: list[np.ndarray]) -> list[str]:
    every = np.concatenate(cases) if cases else np.empty((0, 3))
    if not len(every):
        return ["0", "", "", "", ""]
    error = np.quantile(every[:, 2], (0.5, 0.9))
    texts = (f"{every[:, 0].mean():.0%}", f"± {np.median(every[:, 1]):.0%}", *(f"{x:.0%}" for x in error))
    return [str(len(every)), *texts]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--faces", type=int, default=8)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--records", type=Path)
    parser.add_argument("--write", action="store_true")
    arguments = parser.parse_args()
    records = []
    for seed in range(arguments.first, arguments.first + arguments.faces):
        task = {"kind": KINDS[seed % len(KINDS)], "seed": seed}
        records.append(kept(task, task, arguments.records, lambda task=task: solved(**task)))
    text = report(records)
    print(text)
    if arguments.write:
        save_report(__file__, "Several measured places", text)


if __name__ == "__main__":
    main()
