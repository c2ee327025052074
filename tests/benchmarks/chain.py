"""Whole studies against the plain way: the same face, loads and pixels by femseal and by other programs.

    python tests/benchmarks/chain.py --sizes 512 1024 --records chain.jsonl --write

A self-affine face (Hurst 0.8, longest wave a quarter of the face, shortest 8 pixels, rms slope 0.25, H = 0.14 E* h′),
periodic along both axes, is loaded to 0.3 H and unloaded. The plain way, `plain_way.py`, takes the contact by Tamaas or
ContactMechanics and the flow by scikit-fem with pyamg or PARDISO, of all pixels (deterministic). Errors are
exp(rms ln(Q/Q_ref)) − 1 over the loads that leak more than 1e-3 of the first; the reference is Richardson's limit of femseal's deterministic solutions on two and four times
the pixels a side, from gaps sampled anew. The tolerance of each peer's contact is the loosest that changes the
leakage of a face of 256² by a quarter of its error at most.

Each run is a process of its own with one thread, compilation before; times are CPU times, medians of runs that take
turns; memory is the peak above that before the study. `scaling.py` adds the growth with size. `--records` keeps what is
computed and goes on from there; `--quick` takes one small face; `--write` puts tables and pictures beside this file,
where the documentation takes them from.
"""

from __future__ import annotations

import argparse
import json
from pathlib import Path

import numpy as np
import scaling
from chain_tasks import LOADING, UNLOADING, worker
from common import call, kept, machine, rows, save_report

HERE = Path(__file__).parent
PACKAGES = {
    "Tamaas": "tamaas",
    "ContactMechanics": "ContactMechanics",
    "scikit-fem": "scikit-fem",
    "pyamg": "pyamg",
    "pypardiso": "pypardiso",
}
STUDIES = ("deterministic",)
#: Solvers of the flow of the plain way, and the modules that they need.
FLOWS = {"pyamg": "pyamg", "PARDISO": "pypardiso"}
#: Contacts of the plain way with the tolerances that are tried, and those of them that are as their manuals have them.
TOLERANCES = {
    "Tamaas": (1e-2, 1e-3, 1e-4, 1e-5),
    "ContactMechanics": (1e-1, 1e-2, 1e-3, 1e-4),
    "ContactMechanics from bearing area": (1e-1, 1e-2, 1e-3, 1e-4),
}
MANUAL = ("Tamaas", "ContactMechanics")
#: A peer's run that takes longer is not repeated [s].
PATIENCE = 60.0
#: What a tolerance may change of the leakage, in shares of its error at the tightest one.
TOLERANCE_SHARE = 0.25


def run(options, *tasks):
    """Records of tasks, by one process unless they are known already."""
    tasks = list(tasks)

    def computed():
        return {"tasks": tasks, "found": call(__file__, ["--worker", json.dumps(tasks)], 1)}

    return kept({"tasks": tasks}, ["tasks"], options.records, computed)["found"]


def error(k, exact):
    """exp(rms ln(k/k_ref)) − 1 over the states that leak more than 1e-3 of the first."""
    k, exact = np.array(k), np.array(exact)
    chosen = exact > 1e-3 * exact[0]
    with np.errstate(divide="ignore"):
        return float(np.expm1(np.sqrt(np.mean(np.log(k[chosen] / exact[chosen]) ** 2))))


def exact_permeability(options, n, finest):
    """Richardson's limit of the permeability at all states, by refinements `finest` and half of it; the order is two."""
    tasks = ({"does": "reference", "n": n, "pixels": n * r} for r in (finest // 2, finest))
    coarse, fine = (np.array(run(options, task)[0]["k"]) for task in tasks)
    return fine + (fine - coarse) / 3


def present():
    """Contacts and flows of the plain way whose programs are installed."""
    from importlib.util import find_spec

    flows = [name for name, module in FLOWS.items() if find_spec(module)]
    return [name for name in TOLERANCES if find_spec(name.split()[0].replace("Tamaas", "tamaas"))], flows


def curve_points(options, n):
    """Error against time of a face of n²: records of all methods, with label, seconds and error."""
    exact = exact_permeability(options, n, 8)
    points = []
    for pixels in (n // 2, n, 2 * n, 4 * n):
        for record in run(options, {"does": "femseal", "study": "deterministic", "n": n, "pixels": pixels}):
            points.append(
                {
                    "label": f"femseal, {record['task']['study']}",
                    "pixels": pixels,
                    "tolerance": None,
                    "seconds": record["seconds"],
                    "k": record["k"],
                    "error": error(record["k"], exact),
                }
            )
    contacts, flows = present()
    for name in contacts:
        for pixels in (n, 2 * n):
            at_first = of(points, f"{name}, {flows[0]}", n)
            tolerances = TOLERANCES[name] if pixels == n else [loosest(at_first)["tolerance"]]
            tasks = [
                {"does": "plain", "contact": name, "tolerance": t, "flows": flows, "n": n, "pixels": pixels}
                for t in tolerances
            ]
            for record in run(options, *tasks):
                for flow in flows if "k" in record else ():
                    seconds, k = record["seconds"]["contact"] + record["seconds"][flow], record["k"][flow]
                    points.append(
                        {
                            "label": f"{name}, {flow}",
                            "pixels": pixels,
                            "tolerance": record["task"]["tolerance"],
                            "seconds": seconds,
                            "k": k,
                            "error": error(k, exact),
                        }
                    )
    return points


def of(points, label, pixels=None):
    return [p for p in points if p["label"] == label and pixels in (None, p["pixels"])]


def loosest(points):
    """The point of the loosest tolerance whose leakage is that of the tightest but for a small part of its error."""
    tightest = min(points, key=lambda p: p["tolerance"])
    near = (p for p in points if error(p["k"], tightest["k"]) <= TOLERANCE_SHARE * tightest["error"])
    return max(near, key=lambda p: p["tolerance"])


def studies_of(options, n, tolerances):
    """All studies of a face of n² pixels: medians of femseal and of each peer."""
    exact, flows = exact_permeability(options, n, options.finest), present()[1]
    turns = {}
    for turn in range(options.repeats):
        for study in (*STUDIES, "contact"):
            task = {"does": "femseal", "study": study, "n": n, "pixels": n, "turn": turn}
            turns.setdefault(study, []).extend(run(options, task))
        for name, tolerance in tolerances.items():
            # a peer's turn of minutes is not repeated
            if turn == 0 or sum(turns[name][0]["seconds"].values()) < PATIENCE:
                task = {
                    "does": "plain",
                    "contact": name,
                    "tolerance": tolerance,
                    "flows": flows,
                    "n": n,
                    "pixels": n,
                    "turn": turn,
                }
                turns.setdefault(name, []).extend(run(options, task))
    curve = [
        (r["seconds"], error(r["k"], exact))
        for pixels in (n // 2, n, 2 * n)
        for r in run(options, {"does": "femseal", "study": "deterministic", "n": n, "pixels": pixels})
    ]
    own = {
        study: {
            "seconds": float(np.median([r["seconds"] for r in turns[study]])),
            "megabytes": turns[study][0]["megabytes"],
            "error": error(turns[study][0]["k"], exact),
        }
        for study in (*STUDIES, "contact")
    }
    plain = {}
    for name in tolerances:
        first = turns[name][0]
        if "failure" in first:
            plain[name] = {"failure": first["failure"]}
            continue
        plain[name] = {
            "seconds": {part: float(np.median([r["seconds"][part] for r in turns[name]])) for part in first["seconds"]},
            "error": {part: error(k, exact) for part, k in first["k"].items()},
            "megabytes": first["megabytes"],
        }
    return {"n": n, "own": own, "plain": plain, "curve": curve}


# --- what the tables say ---


def seconds_at(wanted, curve):
    """Time that femseal takes to a wanted error, between its (seconds, error) on several pixels; NaN beyond the finest.

    Where the wanted error is more than that on the fewest pixels, it is the time on these.
    """
    seconds, errors = np.array(sorted(curve)).T
    errors = np.minimum.accumulate(errors)
    if wanted < errors[-1]:
        return np.nan
    return float(np.exp(np.interp(np.log(wanted), np.log(errors[::-1]), np.log(seconds[::-1]))))


def ratios(found):
    """Records of every whole study by a peer beside that by femseal: on the same pixels, and to the same error."""
    records = []
    for size in found:
        for study in STUDIES:
            for name, plain in size["plain"].items():
                if "failure" in plain:
                    continue
                for part in (p for p in plain["seconds"] if p in FLOWS):
                    own, contact, flow = size["own"], plain["seconds"]["contact"], plain["seconds"][part]
                    at = seconds_at(plain["error"][part], size["curve"])
                    records.append(
                        {
                            "n": size["n"],
                            "study": study,
                            "contact": name,
                            "flow": part,
                            "own": own[study]["seconds"],
                            "own contact": own["contact"]["seconds"],
                            "own error": own[study]["error"],
                            "seconds": (contact, flow),
                            "error": plain["error"][part],
                            "ratio": (contact + flow) / own[study]["seconds"],
                            "ratio at error": (contact + flow) / at,
                        }
                    )
    return records


def study_table(records):
    head = [
        "pixels",
        "study",
        "femseal [s] (contact)",
        "error",
        "plain way: contact, flow",
        "contact + flow [s]",
        "error",
        "ratio, same pixels",
        "ratio, same error",
    ]
    cells = [
        [
            f"{r['n']}²",
            r["study"],
            f"{r['own']:.3g} ({r['own contact']:.3g})",
            f"{r['own error']:.2%}",
            f"{r['contact']}, {r['flow']}",
            f"{r['seconds'][0]:.3g} + {r['seconds'][1]:.3g}",
            f"{r['error']:.2%}",
            f"{r['ratio']:.3g}×",
            f"{r['ratio at error']:.3g}×".replace("nan×", "–"),
        ]
        for r in records
    ]
    return rows(head, cells)


def least_table(records):
    """The smallest ratios of each study."""
    manual, better = ([r for r in records if (r["contact"] in MANUAL) == is_manual] for is_manual in (True, False))
    cells = []
    for study in STUDIES:
        line = [study]
        for chosen in (manual, better):
            for which in ("ratio", "ratio at error"):
                known = [r for r in chosen if r["study"] == study and np.isfinite(r[which])]
                r = min(known, key=lambda r: r[which], default=None)
                line.append(
                    "–" if r is None else f"{r[which]:.3g}× ({r['n']}², {r['contact'].split()[0]}, {r['flow']})"
                )
        cells.append(line)
    head = ["least ratio", "as in the manuals, same pixels", "same error", "better start, same pixels", "same error"]
    return rows(head, cells)


def same_error_table(points):
    """Each peer at its loosest tolerance, and the time that femseal takes to the same error."""
    curve = [(p["seconds"], p["error"]) for p in of(points, "femseal, deterministic")]
    cells = []
    for label in dict.fromkeys(p["label"] for p in points if p["tolerance"] is not None):
        for pixels in sorted({p["pixels"] for p in of(points, label)}):
            peer = loosest(of(points, label, pixels))
            own = seconds_at(peer["error"], curve)
            cells.append(
                [
                    label,
                    f"{pixels}²",
                    f"{peer['tolerance']:g}",
                    f"{peer['error']:.2%}",
                    f"{peer['seconds']:.3g}",
                    f"{own:.3g}",
                    f"{peer['seconds'] / own:.3g}×",
                ]
            )
    head = [
        "plain way: contact, flow",
        "pixels",
        "tolerance of the contact",
        "error",
        "time [s]",
        "femseal to that error [s]",
        "ratio",
    ]
    return rows(head, cells)


def memory_sentence(found):
    words = []
    for size in found:
        own = ", ".join(f"{study} {size['own'][study]['megabytes']:.0f}" for study in STUDIES)
        peers = ", ".join(f"{name} {p['megabytes']:.0f}" for name, p in size["plain"].items() if "megabytes" in p)
        words.append(f"{size['n']}²: femseal {own}; all studies of the plain way {peers}")
    return "; ".join(words)


def draw_points(points, n, path):
    """Error against time of everything."""
    import matplotlib.pyplot as plt

    figure, ax = plt.subplots(figsize=(8.5, 6.2), layout="constrained")
    colours = dict(zip(["femseal", *TOLERANCES], ("C0", "C1", "C3", "C4"), strict=True))
    styles = {"deterministic": "o-", "pyamg": "^-", "PARDISO": "v--"}
    for label in dict.fromkeys(p["label"] for p in points):
        who, how = label.split(", ")
        for pixels in [None] if who == "femseal" else sorted({p["pixels"] for p in of(points, label)}):
            line = of(points, label, pixels)
            ax.loglog(
                [p["seconds"] for p in line],
                [p["error"] for p in line],
                styles[how],
                color=colours[who],
                ms=5,
                lw=1.2,
                mfc="none" if pixels == 2 * n else None,
                label=label if pixels in (None, n) else None,
            )
            if who == "femseal":
                for p in line:
                    ax.annotate(
                        f"{p['pixels']}²",
                        (p["seconds"], p["error"]),
                        xytext=(4, 5),
                        textcoords="offset points",
                        fontsize=7,
                        color=colours[who],
                    )
    ax.set(
        xlabel=f"CPU time of the study, {len(LOADING) + len(UNLOADING)} load states [s]", ylabel="error of the leakage"
    )
    title = f"peers: several tolerances of the contact, filled on {n}², hollow on {2 * n}² pixels; femseal: pixels"
    ax.set_title(title, fontsize=9)
    ax.grid(alpha=0.3, which="both", lw=0.4)
    figure.legend(loc="outside lower center", ncols=3, fontsize=8)
    figure.savefig(path, dpi=90)
    plt.close(figure)


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--sizes", type=int, nargs="+", default=[512, 1024])
    parser.add_argument("--curve", type=int, default=256, help="pixels a side of the face of error against time")
    parser.add_argument("--finest", type=int, default=4, help="finest refinement of the reference of the studies")
    parser.add_argument("--repeats", type=int, default=3)
    parser.add_argument("--most-pixels", type=int, default=4096, help="pixels a side up to which growth is measured")
    parser.add_argument("--most-links", type=int, default=10_000_000, help="links up to which growth is measured")
    parser.add_argument("--quick", action="store_true", help="faces of 64² and 128², one run each, small networks")
    parser.add_argument("--records", type=Path, help="file in which results are kept")
    parser.add_argument("--write", action="store_true", help="write tables and pictures")
    parser.add_argument("--worker", help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.worker:
        print(json.dumps(worker(json.loads(options.worker))))
        return
    if options.quick:
        options.sizes, options.curve, options.repeats = [128], 64, 1
        options.most_pixels, options.most_links = 256, 10_000
    points = curve_points(options, options.curve)
    labels = {name: f"{name}, pyamg" for name in TOLERANCES}
    tolerances = {
        name: loosest(of(points, label, options.curve))["tolerance"]
        for name, label in labels.items()
        if of(points, label)
    }
    found = [studies_of(options, n, tolerances) for n in options.sizes]
    records = ratios(found)
    grown = scaling.all_records(tolerances, present()[1], options.records, options.most_pixels, options.most_links)
    failures = [
        f"{name}, {size['n']}²: {p['failure']}" for size in found for name, p in size["plain"].items() if "failure" in p
    ]
    chosen = ", ".join(f"{name} {tolerance:g}" for name, tolerance in tolerances.items())
    text = f"""{machine(PACKAGES)}.

{study_table(records)}

{least_table(records)}

Tolerances of the contact: {chosen}. Failures: {"; ".join(failures) or "none"}.

Peak memory [MB]: {memory_sentence(found)}.

The same error on a face of {options.curve}² pixels with 8 pixels per shortest wave, contact and flow of all pixels; femseal's time is
interpolated between those on {options.curve // 2}², {options.curve}², … pixels, "nan" where its error is larger on all of them:

{same_error_table(points)}

Growth with size, peak memory in brackets; "–": would have taken more than {scaling.PATIENCE:g} s:

{scaling.table(grown)}"""
    print(text)
    if options.write:
        draw_points(points, options.curve, HERE / "chain.png")
        scaling.draw(grown, HERE / "scaling.png")
        pictures = "![error over time](chain.png)\n\n![time and memory over size](scaling.png)"
        save_report(__file__, "Whole studies", f"{text}\n\n{pictures}")


if __name__ == "__main__":
    main()
