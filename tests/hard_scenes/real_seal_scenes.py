"""Hard scenes of real seals: fluids that carry nearly all of the load, or none of it, and seats with a form."""

from __future__ import annotations

from functools import partial
from typing import Any

import numpy as np
from chain_scenes import D, E, chain_face, chain_scene
from hard_scene import HardScene
from judges import Exactly, Falling, Near

from femseal.flow import Spiral, cell_permeability
from femseal.flow.spiral import spiral_flow
from femseal.fluids import IdealGas
from femseal.studies import Sampling
from femseal.studies.drawn_study import stochastic
from femseal.studies.face_study import deterministic
from femseal.studies.piece_study import two_scale
from femseal.topography import CrownedSeat, Seat, TiltedSeat, Topography

H = 2.5e9
LOAD = 1e8

scene = partial(HardScene, stage="chain")


def _leakage(heights: np.ndarray, **given: Any) -> np.ndarray:
    """Leakage of a face free along x1 whose fluid presses it apart [m²/s]."""
    base = {
        "boundary": ("free", "periodic"),
        "fluid_pressure": "acts",
        "hardness": H,
        "loading": (LOAD,),
    }
    return deterministic(chain_scene(heights, **base | given)).leakage


def _open() -> float:
    """Steps without leakage and with, of five, if the fluid's pressure is 2.1 times the second of the loads."""
    loads = (5e7, LOAD, 1.1e8, 2e8, 4e8)
    found = _leakage(chain_face(), loading=loads, inlet_pressure=2.1 * LOAD)
    return float(np.isnan(found[:2]).sum() + 10 * (found[2:] > 0).sum())


def _growing() -> np.ndarray:
    """Leakage per pressure drop, falling from p_in = 1.6 p̄ down to none."""
    heights = chain_face((48, 64))
    pressures = LOAD * np.array([1.6, 1.2, 0.8, 0.3, 0.1, 1e-3])
    return np.array([_leakage(heights, inlet_pressure=p)[0] / p for p in pressures])


def _little() -> float:
    heights = chain_face((48, 64))
    acts, ignored = (
        _leakage(heights, inlet_pressure=1.0, fluid_pressure=a)[0] for a in ("acts", "ignored")
    )
    return float(acts / ignored)


def _contact_alone() -> float:
    """Mean contact pressure over the load, p_in being three times the load which the contact carries alone."""
    made = chain_scene(chain_face((48, 64)), boundary=("free", "periodic"), fluid_pressure="acts", hardness=np.inf,
                       loading=(LOAD,), inlet_pressure=3 * LOAD, nominal="contact")  # fmt: skip
    return float(deterministic(made).contact_pressure[0].mean() / LOAD)


def _methods() -> float:
    """Two scales over the deterministic leakage, with a gas at 700 bar that carries half of the load."""
    gas = IdealGas(viscosity=18e-6, molar_mass=28e-3, temperature=293.15)
    given = {"boundary": ("free", "periodic"), "fluid_pressure": "acts", "hardness": H, "loading": (LOAD,),
             "fluid": gas, "inlet_pressure": 7e7, "outlet_pressure": 1e5}  # fmt: skip
    made = chain_scene(chain_face((64, 64)), **given)
    return float(two_scale(made, (4, 4)).leakage[0] / deterministic(made).leakage[0])


def _equal_pieces() -> float:
    """Drawn seals of pieces all alike under p_in = p̄, over those of a load lower by half of it."""
    piece = chain_face((16, 16), rng=8)
    base = {"boundary": ("free", "periodic"), "hardness": H}
    sampling = Sampling(length=128 * D, realisations=2, seed=1, breadth=128 * D)
    found = [
        stochastic(chain_scene(np.tile(piece, (4, 4)), loading=(load,), inlet_pressure=LOAD, **base | more), (4, 4),
                   sampling).leakage[0, 0]
        for load, more in ((LOAD, {"fluid_pressure": "acts"}), (0.5 * LOAD, {"fluid_pressure": "ignored"}))
    ]  # fmt: skip
    return float(found[0] / found[1])


def _rows(seat: Seat, force: float, hardness: float = np.inf, n: int = 512) -> np.ndarray:
    """Contact pressure of the rows of a smooth seat under a force per length."""
    face = seat.on(Topography(np.zeros((n, 2)), (D, D), (False, True)))
    made = chain_scene(
        face.heights, boundary=("free", "periodic"), hardness=hardness, loading=(force / (n * D),)
    )
    return deterministic(made).row_pressure[0]


def _edge() -> float:
    """Fraction of the load on the inlet's half of a seat that is tilted by 1°."""
    rows = _rows(TiltedSeat(np.radians(1.0)), 1e4)
    return float(rows[:256].sum() / rows.sum())


def _sharp() -> float:
    """A crown of 2 mm: largest pressure over Hertz's."""
    force, radius = 5e3, 2e-3
    half = np.sqrt(4 * force * radius / (np.pi * E))
    return float(_rows(CrownedSeat(radius), force).max() / (2 * force / (np.pi * half)))


def _squashed() -> float:
    """Band of a crown of 10 mm far beyond first yield, over W/H."""
    rows = _rows(CrownedSeat(1e-2), 5e4, hardness=0.2e9)
    return float(np.count_nonzero(rows) * D / (5e4 / 0.2e9))


def _spiral(
    lead: float, circumference: float | None = None, land: float = -1e-7, turns: int = 6
) -> tuple[float, float]:
    """Permeability of grooves 16 pixels apart along x2, over k22 tan²α, and k22 over k11."""
    n2 = 64
    x = np.arange(16 * turns) + 0.5
    gap = np.repeat(np.maximum(land - 1e-6 * np.cos(2 * np.pi * x / 16), 0.0)[:, None], n2, axis=1)
    plain = cell_permeability(gap, (D, D), sides="periodic")
    along = cell_permeability(gap, (D, D), axis=1, sides="periodic").value
    found = spiral_flow(gap, (D, D), Spiral(lead, circumference), plain.fluid_pressure)
    tangent = lead / (circumference or n2 * D)
    return (
        0.0 if found is None else found[0] / (along * tangent**2)
    ), along / plain.value if plain.value else np.inf


def _two_starts() -> float:
    """Two grooves beside each other over one, on closed lands."""
    return 4 * _spiral(32 * D, turns=12)[0] / _spiral(16 * D, turns=12)[0]


SCENES: tuple[HardScene, ...] = (
    scene(
        "groove around a long seal",
        what="closed lands, lead 16 µm around 1 m: permeability over k₂₂ tan²α, 3e-10 of k₂₂",
        must=Near(1.0, 0.005, "Geoffroy & Prat"),
        run=lambda: _spiral(16 * D, 1.0)[0],
    ),
    scene(
        "groove between the pixels",
        what="closed lands and a lead that is no whole number of pixels: permeability over k₂₂ tan²α",
        must=Near(1.0, 0.02, "whole pixels and a fraction of them"),
        run=lambda: _spiral(16.4 * D, 1e-3, turns=12)[0],
    ),
    scene(
        "two grooves side by side",
        what="twice the lead on closed lands: permeability over that of one start",
        must=Near(4.0, 0.02, "tan²α"),
        run=_two_starts,
    ),
    scene(
        "fluid at 2.1 times the load",
        what="five loads, of which the fluid carries the lowest two alone: open steps + 10 × leaking ones",
        must=Exactly(32.0, "open below p_in/2"),
        run=_open,
    ),
    scene(
        "fluid from 1.6 of the load to none",
        what="one face and load, p_in/p̄ from 1.6 to 0.001: leakage per drop [m²/(s·Pa)]",
        must=Falling("the less fluid pressure, the less leaks"),
        run=_growing,
    ),
    scene(
        "fluid of a pascal",
        what="p_in of 1 Pa under 100 MPa: leakage over that of a dry face",
        must=Exactly(1.0, "left out"),
        run=_little,
    ),
    scene(
        "contact carries its load alone",
        what='nominal = "contact" with a fluid at three times the load: mean contact pressure over it',
        must=Near(1.0, 1e-5, "balance"),
        run=_contact_alone,
    ),
    scene(
        "gas at 700 bar under twice its pressure",
        what="two scales over the deterministic leakage, the gas pressing the faces apart",
        must=Near(1.0, 1e-6, "one contact"),
        run=_methods,
    ),
    scene(
        "drawn pieces under their fluid's pressure",
        what="pieces all alike with p_in = p̄: leakage over that of a dry seal under half of the load",
        must=Near(1.3, 0.3, "∫k(p̄ − s)ds is above k(p̄/2): k is convex"),
        run=_equal_pieces,
    ),
    scene(
        "seat tilted by 1°",
        what="fraction of the load on the half that touches",
        must=Exactly(1.0, "one edge"),
        run=_edge,
    ),
    scene(
        "crown of 2 mm",
        what="largest pressure of a row over Hertz's, whose band is 12 pixels broad",
        must=Near(1.0, 0.03, "p₀ = 2W/(πa)"),
        run=_sharp,
    ),
    scene(
        "crown that is plastic all over",
        what="band of a soft crown over W/H",
        must=Near(1.0, 0.03, "every row carries H"),
        run=_squashed,
    ),
)
