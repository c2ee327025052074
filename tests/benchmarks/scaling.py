"""Growth of time and memory with size: contact and flow of faces, and networks of links; part of `chain.py`.

    python tests/benchmarks/scaling.py

Faces are those of `chain.py`, under a tenth of the hardness; the flow is through that contact. Networks are square, of
log-normal links with a standard deviation of ln k of 1, 35 % of them closed. Times are CPU times, medians; memory is the
peak above that before. A solver is left out of sizes at which the size before says that it would take too long.
"""

from __future__ import annotations

import argparse
import json
import time
from functools import partial
from pathlib import Path

import numpy as np
from common import call, forget_peak, kept, resident, rows

#: Mean pressure over the hardness.
LOAD = 0.1
#: Pixels a side, and links.
PIXELS, LINKS = (64, 128, 256, 512, 1024, 2048, 4096), tuple(10**k for k in range(2, 8))
#: Sizes up to these share a process.
SMALL = {"contact": 512, "flow": 512, "network": 10_000}
#: Time that a solution may take by what the size before took [s].
PATIENCE = 60.0


def contact_solver(name, n, tolerances):
    """A function that solves the contact of a face of n² pixels."""
    import chain_tasks as chain

    z = chain.heights(n, n, 0.5)
    gap0, load = z.max() - z, LOAD * chain.HARDNESS
    if name == "femseal":
        from femseal import HalfSpace, solve_contact

        body = HalfSpace(z.shape, (chain.PIXEL,) * 2, chain.MODULUS)
        return lambda: solve_contact(gap0, body, pressure=load, hardness=chain.HARDNESS, rtol=1e-5)
    import plain_way

    solve = plain_way.CONTACTS[name](z.shape, chain.PIXEL, chain.MODULUS, chain.HARDNESS, tolerances[name])
    return lambda: solve(gap0, load)


def flow_solver(name, n, tolerances):
    """A function that solves the flow through the contact of a face of n² pixels."""
    gap = contact_solver("femseal", n, tolerances)().gap
    if name == "femseal":
        from femseal import cell_permeability

        return lambda: cell_permeability(gap, (1.0, 1.0), sides="periodic")
    import plain_way

    ring = plain_way.closed_ring(gap)
    return lambda: plain_way.PlainFlow(gap.shape, True, name)(ring)


def network_solver(name, count, tolerances):
    """A function that solves the flow through a square network of so many links."""
    from seal import links

    k1, k2 = links(count // 2, 1.0, 0.35)
    if name == "femseal":
        from femseal import RectangularSeal

        return lambda: RectangularSeal((1.0, 1.0), k1.shape).flow((k1, k2))
    import plain_way

    return lambda: plain_way.network_permeability(k1, k2, name)


PREPARES = {"contact": contact_solver, "flow": flow_solver, "network": network_solver}


def measure(task):
    """Records of a solver on sizes, in this process: seconds and peak memory [MB]."""
    prepare, tolerances, records = PREPARES[task["what"]], task["tolerances"], []
    prepare(task["solver"], 400 if task["what"] == "network" else 64, tolerances)()
    for size in task["sizes"]:
        solve = prepare(task["solver"], size, tolerances)
        forget_peak()
        before = resident("VmRSS")
        times = []
        while len(times) < 7 and (not times or sum(times) < 2.0):
            start = time.process_time()
            solve()
            times.append(time.process_time() - start)
        record = {"size": size, "seconds": float(np.median(times)), "megabytes": (resident("VmHWM") - before) / 2**20}
        records.append({"what": task["what"], "solver": task["solver"]} | record)
    return records


def computed(task):
    """The record of a task, by a process of its own."""
    return {"tasks": task, "found": call(__file__, ["--worker", json.dumps(task)], 1)}


def records_of(what, solver, sizes, tolerances, path):
    """Records of a solver on all sizes that it can be expected to reach."""
    found = []
    small = [size for size in sizes if size <= SMALL[what]]
    for group in [small, *([size] for size in sizes if size > SMALL[what])]:
        growth = (group[-1] / found[-1]["size"]) ** (1 if what == "network" else 2) if found else 1.0
        if found and 1.5 * growth * found[-1]["seconds"] > PATIENCE:
            break
        task = {"what": what, "solver": solver, "sizes": group, "tolerances": tolerances}
        found += kept({"tasks": task}, ["tasks"], path, partial(computed, task))["found"]
    return found


def all_records(tolerances, flows, path, most_pixels, most_links):
    """Records up to so many pixels a side and links; tolerances are those of the contacts of the plain way at hand."""
    pixels, links = [n for n in PIXELS if n <= most_pixels], [n for n in LINKS if n <= most_links]
    asked = [
        ("contact", ["femseal", *tolerances], pixels),
        ("flow", ["femseal", *flows], pixels),
        ("network", ["femseal", "SuperLU", *(f for f in flows if f == "pyamg")], links),
    ]
    return [
        r for what, names, sizes in asked for name in names for r in records_of(what, name, sizes, tolerances, path)
    ]


def power(records):
    """Power of the time in pixels or links, over the sizes of a solver from a thousandth of the largest on; NaN of one."""
    size = np.array([float(r["size"]) for r in records])
    if records[0]["what"] != "network":
        size **= 2
    seconds = np.array([r["seconds"] for r in records])
    chosen = size >= 1e-3 * size.max()
    return float(np.polyfit(np.log(size[chosen]), np.log(seconds[chosen]), 1)[0]) if chosen.sum() > 1 else np.nan


def table(records):
    texts = []
    for what in PREPARES:
        of = [r for r in records if r["what"] == what]
        names = list(dict.fromkeys(r["solver"] for r in of))
        head = ["links" if what == "network" else "pixels", *(f"{name} [s] (MB)" for name in names)]
        cells = []
        for size in sorted({r["size"] for r in of}):
            line = [f"{size:.0e}" if what == "network" else f"{size}²"]
            for name in names:
                r = next((r for r in of if r["solver"] == name and r["size"] == size), None)
                line.append("–" if r is None else f"{r['seconds']:.3g} ({r['megabytes']:.0f})")
            cells.append(line)
        powers = [power([r for r in of if r["solver"] == name]) for name in names]
        cells.append(["power of the size", *(f"{p:.2f}" for p in powers)])
        texts.append(f"{what.capitalize()}:\n\n{rows(head, cells)}")
    return "\n\n".join(texts)


def draw(records, path):
    """Time and memory over size."""
    import matplotlib.pyplot as plt

    figure, axes = plt.subplots(2, 3, figsize=(11, 6.5), layout="constrained")
    for column, what in enumerate(PREPARES):
        of = [r for r in records if r["what"] == what]
        for name, marker in zip(dict.fromkeys(r["solver"] for r in of), "os^v", strict=False):
            chosen = [r for r in of if r["solver"] == name]
            size = [r["size"] ** (1 if what == "network" else 2) for r in chosen]
            axes[0, column].loglog(size, [r["seconds"] for r in chosen], f"{marker}-", label=name, ms=4)
            large = [(s, r["megabytes"]) for s, r in zip(size, chosen, strict=True) if r["megabytes"] > 1]
            if large:
                axes[1, column].loglog(*zip(*large, strict=True), f"{marker}-", label=name, ms=4)
        axes[0, column].set_title(what)
        axes[0, column].legend(fontsize=7, loc="upper left" if what == "network" else "lower right")
        axes[1, column].set_xlabel("links" if what == "network" else "pixels")
    axes[0, 0].set_ylabel("CPU time [s]")
    axes[1, 0].set_ylabel("peak memory [MB]")
    for ax in axes.flat:
        ax.grid(alpha=0.3)
    figure.savefig(path, dpi=80)
    plt.close(figure)


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--records", type=Path, help="file in which results are kept")
    parser.add_argument("--worker", help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.worker:
        print(json.dumps(measure(json.loads(options.worker))))
        return
    print(table(all_records({}, [], options.records, PIXELS[-1], LINKS[-1])))


if __name__ == "__main__":
    main()
