"""Fields of other programs on the same problem; each program is imported only where it is asked for."""

from __future__ import annotations

import numpy as np

from .faces import MODULUS, SLOPE, rough


def tamaas_fields(gap0, body, pressure, hardness):
    """Pressure and gap by Tamaas (Polonsky & Keer with Rey's preconditioning), elastic only."""
    import tamaas

    tamaas.set_log_level(tamaas.LogLevel.error)
    tamaas.initialize(1)
    model = tamaas.Model(tamaas.model_type.basic_2d, list(np.multiply(body.shape, body.spacing)), list(body.shape))
    model.E, model.nu = body.modulus, 0.0
    solver = tamaas.PolonskyKeerRey(model, np.ascontiguousarray(-gap0), 1e-12)
    solver.max_iter = 3000
    solver.solve(pressure)
    gap = np.array(model.displacement) + gap0
    return np.array(model.traction), gap - gap.min()


def contactmechanics_fields(gap0, body, pressure, hardness):
    """Pressure and raw gap by ContactMechanics (constrained conjugate gradients)."""
    from ContactMechanics import PeriodicFFTElasticHalfSpace
    from ContactMechanics.Optimization.ConstrainedConjugateGradients import constrained_conjugate_gradients
    from SurfaceTopography import Topography

    sizes = tuple(np.multiply(body.shape, body.spacing))
    pixel = float(np.prod(body.spacing))
    result = constrained_conjugate_gradients(
        PeriodicFFTElasticHalfSpace(body.shape, body.modulus, sizes),
        Topography(np.array(-gap0), sizes),
        external_force=pressure * sizes[0] * sizes[1],
        pentol=1e-15,
        maxiter=3000,
        **({} if np.isinf(hardness) else {"hardness": hardness * pixel}),
    )
    return np.asarray(result.jac) / pixel, np.asarray(result.x) + gap0 - result.offset


CONTACT_PEERS = {"Tamaas": tamaas_fields, "ContactMechanics": contactmechanics_fields}
MODULES = {"Tamaas": "tamaas", "ContactMechanics": "ContactMechanics"}


def contact_fields(peer, n=256, pressures=(200e6, 1e9), hardnesses=(np.inf, 4e9)):
    """Largest difference of the pressure over the largest, of the raw gap over the rms height, pixels otherwise."""
    from femseal import solve_contact

    gap0, body = rough(n)
    records = []
    for hardness in hardnesses:
        if peer == "Tamaas" and np.isfinite(hardness):
            continue
        for pressure in pressures:
            own = solve_contact(gap0, body, pressure=pressure, hardness=hardness, rtol=1e-10)
            theirs, gap = CONTACT_PEERS[peer](gap0, body, pressure, hardness)
            records.append(
                {
                    "hardness": hardness,
                    "mean": pressure,
                    "pressure": float(np.abs(theirs - own.pressure).max() / own.pressure.max()),
                    "gap": float(np.abs(gap - own.raw_gap).max() / gap0.std()),
                    "otherwise": int(np.count_nonzero((theirs > 0) != (own.pressure > 0))),
                }
            )
    return records


def flow_fields(n=128, refinements=(1, 2, 4), pressure=200e6, hardness=4e9):
    """Flow through a contact by reynoldsflow, which takes the gap constant on each pixel, on finer and finer grids.

    Records of the relative difference of the permeability, and the largest and rms difference of the fluid pressure
    over its drop, to ours.
    """
    from reynoldsflow.transport import compute_total_flux, solve_fluid_problem

    from femseal import HalfSpace, cell_permeability, self_affine, solve_contact

    size = n * 1e-6
    records = []
    for refinement in refinements:
        m = refinement * n
        face = self_affine((m, m), (size, size), hurst=0.8, rms_slope=SLOPE, roll_off=size / 8, cut_off=8e-6, rng=1)
        body = HalfSpace((m, m), face.spacing, MODULUS)
        gap = solve_contact(-face.heights, body, pressure=pressure, hardness=hardness, rtol=1e-8).gap
        highest = gap.max()
        kept, theirs, flux = solve_fluid_problem(gap / highest)
        value = abs(compute_total_flux(kept, flux, m)[0]) * highest**3 / 12
        record = {"hardness": hardness, "pixels": 8 * refinement}
        own = cell_permeability(gap, face.spacing, sides="periodic", rtol=1e-10, field_rtol=1e-8)
        # the inlet is at pressure 1 here, at 0 there
        difference = (1 - own.fluid_pressure) - theirs
        if np.nanmean(np.abs(difference)) > np.nanmean(np.abs(own.fluid_pressure - theirs)):
            difference = own.fluid_pressure - theirs
        record["value"] = own.value / value - 1
        record["largest"] = float(np.nanmax(np.abs(difference)))
        record["rms"] = float(np.sqrt(np.nanmean(difference**2)))
        record["otherwise"] = int(np.count_nonzero(np.isfinite(own.fluid_pressure) != np.isfinite(theirs)))
        records.append(record)
    return records


def present(module):
    """Whether a peer is installed."""
    from importlib.util import find_spec

    return find_spec(module) is not None


def contact_line(peer, records):
    figures = "; ".join(
        f"{'elastic' if np.isinf(h) else f'H = {h / 1e9:g} GPa'}: "
        f"pressure {max(r['pressure'] for r in records if r['hardness'] == h):.0e} of the largest, "
        f"gap {max(r['gap'] for r in records if r['hardness'] == h):.0e} of the rms height, "
        f"{sum(r['otherwise'] for r in records if r['hardness'] == h)} pixels touch in one only"
        for h in sorted({r["hardness"] for r in records}, reverse=True)
    )
    return [f"Fields of {peer}, largest difference at 0.2 and 1 GPa, 256²", f"{peer}, same run", figures]


def flow_line(records):
    figures = "; ".join(
        f"{r['pixels']} pixels per shortest wave: permeability {100 * r['value']:.2g} %, "
        f"fluid pressure {r['rms']:.0e} of the drop in the mean square, {r['largest']:.2g} at most"
        for r in records
    )
    figures += ". The largest difference hardly falls: likely in bays beside contact, which they join otherwise"
    return [
        "Flow through a contact with H = 4 GPa as by reynoldsflow, on finer grids",
        "reynoldsflow, same run",
        figures,
    ]


def fields():
    """Records by peer that is installed."""
    found = {peer: contact_fields(peer) for peer in CONTACT_PEERS if present(MODULES[peer])}
    if present("reynoldsflow"):
        found["reynoldsflow"] = flow_fields()
    return found


def lines(records):
    return [flow_line(r) if peer == "reynoldsflow" else contact_line(peer, r) for peer, r in records.items()]
