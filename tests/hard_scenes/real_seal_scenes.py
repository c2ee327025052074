"""Hard scenes of real seals: fluids that carry nearly all of the load, or none of it, and seats with a form."""

from functools import partial

import numpy as np
from chain_scenes import D, E, chain_face, chain_scene
from hard_scene import HardScene
from judges import exactly, falling, near

from femseal.flow import Spiral, cell_permeability
from femseal.flow.spiral import spiral_flow
from femseal.studies import Sampling
from femseal.studies.drawn_study import stochastic
from femseal.studies.face_study import deterministic
from femseal.topography import CrownedSeat, TiltedSeat, Topography

H = 2.5e9
LOAD = 1e8

scene = partial(HardScene, "chain")


def _leakage(heights, **given):
    """Leakage of a face free along x1 whose fluid presses it apart [m²/s]."""
    base = {
        "boundary": ("free", "periodic"),
        "fluid_pressure": "acts",
        "hardness": H,
        "loading": (LOAD,),
    }
    return deterministic(chain_scene(heights, **base | given)).leakage


def _open():
    """Steps without leakage and with, of five, if the fluid's pressure is 2.1 times the second of the loads."""
    loads = (5e7, LOAD, 1.1e8, 2e8, 4e8)
    found = _leakage(chain_face(), loading=loads, inlet_pressure=2.1 * LOAD)
    return float(np.isnan(found[:2]).sum() + 10 * (found[2:] > 0).sum())


def _growing():
    """Leakage per pressure drop, falling from p_in = 1.6 p̄ down to none."""
    heights = chain_face((48, 64))
    pressures = LOAD * np.array([1.6, 1.2, 0.8, 0.3, 0.1, 1e-3])
    return np.array([_leakage(heights, inlet_pressure=p)[0] / p for p in pressures])


def _contact_alone():
    """Mean contact pressure over the load, p_in being three times the load which the contact carries alone."""
    made = chain_scene(chain_face((48, 64)), boundary=("free", "periodic"), fluid_pressure="acts", hardness=np.inf,
                       loading=(LOAD,), inlet_pressure=3 * LOAD, nominal="contact")  # fmt: skip
    return float(deterministic(made).contact_pressure[0].mean() / LOAD)


def _equal_pieces():
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


def _rows(seat, force, hardness=np.inf, n=512):
    """Contact pressure of the rows of a smooth seat under a force per length."""
    face = seat.on(Topography(np.zeros((n, 2)), (D, D), (False, True)))
    made = chain_scene(
        face.heights, boundary=("free", "periodic"), hardness=hardness, loading=(force / (n * D),)
    )
    return deterministic(made).row_pressure[0]


def _edge():
    """Fraction of the load on the inlet's half of a seat that is tilted by 1°."""
    rows = _rows(TiltedSeat(np.radians(1.0)), 1e4)
    return float(rows[:256].sum() / rows.sum())


def _sharp():
    """A crown of 2 mm: largest pressure over Hertz's."""
    force, radius = 5e3, 2e-3
    half = np.sqrt(4 * force * radius / (np.pi * E))
    return float(_rows(CrownedSeat(radius), force).max() / (2 * force / (np.pi * half)))


def _squashed():
    """Band of a crown of 10 mm far beyond first yield, over W/H."""
    rows = _rows(CrownedSeat(1e-2), 5e4, hardness=0.2e9)
    return float(np.count_nonzero(rows) * D / (5e4 / 0.2e9))


def _spiral(lead, circumference=None, land=-1e-7, turns=6):
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


def _two_starts():
    """Two grooves beside each other over one, on closed lands."""
    return 4 * _spiral(32 * D, turns=12)[0] / _spiral(16 * D, turns=12)[0]


SCENES = (
    scene(
        "groove between the pixels",
        "closed lands and a lead that is no whole number of pixels: permeability over k₂₂ tan²α",
        near(1.0, 0.02, "whole pixels and a fraction of them"),
        lambda: _spiral(16.4 * D, 1e-3, turns=12)[0],
    ),
    scene(
        "two grooves side by side",
        "twice the lead on closed lands: permeability over that of one start",
        near(4.0, 0.02, "tan²α"),
        _two_starts,
    ),
    scene(
        "fluid at 2.1 times the load",
        "five loads, of which the fluid carries the lowest two alone: open steps + 10 × leaking ones",
        exactly(32.0, "open below p_in/2"),
        _open,
    ),
    scene(
        "fluid from 1.6 of the load to none",
        "one face and load, p_in/p̄ from 1.6 to 0.001: leakage per drop [m²/(s·Pa)]",
        falling("the less fluid pressure, the less leaks"),
        _growing,
    ),
    scene(
        "contact carries its load alone",
        'nominal = "contact" with a fluid at three times the load: mean contact pressure over it',
        near(1.0, 1e-5, "balance"),
        _contact_alone,
    ),
    scene(
        "drawn pieces under their fluid's pressure",
        "pieces all alike with p_in = p̄: leakage over that of a dry seal under half of the load",
        near(1.3, 0.3, "∫k(p̄ − s)ds is above k(p̄/2): k is convex"),
        _equal_pieces,
    ),
    scene(
        "seat tilted by 1°",
        "fraction of the load on the half that touches",
        exactly(1.0, "one edge"),
        _edge,
    ),
    scene(
        "crown of 2 mm",
        "largest pressure of a row over Hertz's, whose band is 12 pixels broad",
        near(1.0, 0.03, "p₀ = 2W/(πa)"),
        _sharp,
    ),
    scene(
        "crown that is plastic all over",
        "band of a soft crown over W/H",
        near(1.0, 0.03, "every row carries H"),
        _squashed,
    ),
)
