"""What a process of `chain.py` does: a study of a face by femseal or the plain way, with its time and memory.

A study is a task, a dictionary, and returns a dictionary: leakage as permeability [m³] of the face at all states, seconds
of CPU time, and megabytes.
"""

from __future__ import annotations

import time

import numpy as np
from common import forget_peak, resident
from flow import sampled, waves

MODULUS, PIXEL, SLOPE = 115e9, 1e-6, 0.25
HARDNESS = 0.14 * MODULUS * SLOPE
#: Nominal pressures in shares of the hardness, the one to unload from, and the stops on the way down.
LOADING, PEAKS, UNLOADING = (0.02, 0.05, 0.1, 0.2, 0.3), (0.3,), (0.15, 0.05, 0.01)
VISCOSITY, DROP = 1e-3, 1e7


def heights(n, pixels, shift):
    """Face whose shortest wave is 8 of n pixels, sampled at pixels², the first at `shift` spacings from the origin [m]."""
    c = waves(n)
    k = np.arange(c.shape[0]) - c.shape[0] // 2
    slope = np.sqrt(np.sum(np.abs(c) ** 2 * (k[:, None] ** 2 + k**2))) * 2 * np.pi / (n * PIXEL)
    return sampled(c, pixels, shift) * SLOPE / slope


def loads(shares):
    return tuple(HARDNESS * share for share in shares)


def scene_of(n, pixels):
    from femseal import Liquid, Scene, Topography

    return Scene(
        surface=Topography(heights(n, pixels, 0.5), (n * PIXEL / pixels,) * 2),
        modulus=MODULUS,
        hardness=HARDNESS,
        fluid=Liquid(viscosity=VISCOSITY, density=1000.0),
        inlet_pressure=DROP,
        outlet_pressure=0.0,
        loading=loads(LOADING),
        unload_from=loads(PEAKS),
        unloading=loads(UNLOADING),
        boundary=("periodic", "periodic"),
    )


def own_study(task, n, pixels):
    """A study by femseal, or its contact alone."""
    from femseal import HalfSpace, deterministic
    from femseal.contact import PerfectlyPlastic, load_states

    scene, size = scene_of(n, pixels), n * PIXEL

    def contact():
        body = HalfSpace(scene.surface.shape, scene.surface.spacing, MODULUS, scene.boundary)
        gap0 = scene.surface.heights.max() - scene.surface.heights
        states = load_states(
            gap0, body, scene.steps, law=PerfectlyPlastic(HARDNESS), rtol=scene.rtol, take=lambda state: np.nan
        )
        return np.array(list(states))

    studies = {
        "deterministic": lambda: deterministic(scene).leakage,
        "contact": contact,
    }
    start = time.process_time()
    leakage = studies[task["study"]]()
    return {"seconds": time.process_time() - start, "k": (leakage * VISCOSITY * size / DROP).tolist()}


def reference(task, n, pixels):
    """Flow through the contact of all states by femseal; no state is kept."""
    from femseal import HalfSpace
    from femseal.contact import PerfectlyPlastic, load_states
    from femseal.studies.face_flow import resolved_flow

    scene = scene_of(n, pixels)
    surface = scene.surface
    body = HalfSpace(surface.shape, surface.spacing, MODULUS, scene.boundary)

    def flow(state):
        return resolved_flow(state.contact.gap, surface.spacing).permeability

    gap0 = surface.heights.max() - surface.heights
    return {"k": list(load_states(gap0, body, scene.steps, law=PerfectlyPlastic(HARDNESS), rtol=1e-6, take=flow))}


def plain_study(task, n, pixels):
    """Contact by a peer and all flows of the task: permeability and seconds of each part."""
    import plain_way

    z, k, seconds = heights(n, pixels, 0.0), {}, {}
    clock = time.process_time
    start = clock()
    solve = plain_way.CONTACTS[task["contact"]](z.shape, n * PIXEL / pixels, MODULUS, HARDNESS, task["tolerance"])
    try:
        gaps = plain_way.gaps_of_cycle(solve, z.max() - z, loads(LOADING), loads(PEAKS), loads(UNLOADING))
    except RuntimeError as failure:
        return {"failure": str(failure), "seconds": {"contact": clock() - start}}
    seconds["contact"] = clock() - start
    for solver in task["flows"]:
        start = clock()
        flow = plain_way.PlainFlow(z.shape, True, solver)
        k[solver] = [flow(plain_way.closed_ring(gap)) for gap in gaps]
        seconds[solver] = clock() - start
        del flow
    return {"seconds": seconds, "k": k}


DOES = {"femseal": own_study, "reference": reference, "plain": plain_study}


def worker(tasks):
    """Tasks of one kind in this process, one after the other: first on a small face, by which code is compiled."""
    records = []
    for task in tasks:
        does = DOES[task["does"]]
        does(task, 64, 64)
        forget_peak()
        before = resident("VmRSS")
        found = does(task, task["n"], task["pixels"])
        records.append({"task": task} | found | {"megabytes": (resident("VmHWM") - before) / 2**20})
    return records
