"""Effort of load steps, counted on the contact of a small part of a face, and the pace of this machine.

Numbers of transforms are counted, not timed, and do not depend on what else the machine does.
"""

import time
from collections.abc import Callable
from dataclasses import astuple, replace
from functools import cache
from math import log, sqrt

import numpy as np
from scipy import fft

from ..base import FemsealError
from ..contact import Contact, HalfSpace, solve_contact
from ..face.piece_flow import FlowSettings
from ..flow import cell_permeability
from ..studies import Scene
from ..studies.study_registry import FEW_ITERATIONS, PILOT_PIXELS, Effort

#: Load steps that are solved at most.
_MOST_STEPS = 5
#: Rounds of contact and flow beyond which a larger face, of which single paths are a smaller part, takes half as many.
_MANY_ROUNDS = 3.0
#: Iterations of multigrid that take as long as elimination on `PILOT_PIXELS`, and their growth with the fraction open.
_ELIMINATED = 50.0, 1.65
#: Least seconds of a pair of transforms of 128² numbers on the machine where the constants of the costs were measured.
#: They stay in the cache: those of larger arrays take the time in which the system gives new memory, as no solver does.
_PACE_SECONDS = 1.16e-4


@cache
def pace() -> float:
    """Time that this machine takes for transforms, as a multiple of the one on which the costs were measured."""
    heights = np.random.default_rng(0).random((128, 128))
    taken = []
    for _ in range(100):
        # of the processor: what others do on the machine is not forecast
        start = time.thread_time()
        fft.irfft2(fft.rfft2(heights), heights.shape)
        taken.append(time.thread_time() - start)
    # a neighbour on the same core slowed the others down, by up to 2.7 times
    return min(taken) / _PACE_SECONDS


def efforts(scene: Scene) -> tuple[Effort, ...]:
    """Effort of every load step, from contact and flow of the middle of the face at some of the pressures.

    The state that an earlier load left is left out: unloading takes about as many transforms as loading. So are what a
    gas slips, grooves that wind and what pockets hold, which the costs count by themselves.
    """
    surface = scene.surface.shortest_patch
    scale = min(1.0, sqrt(PILOT_PIXELS / surface.heights.size))
    # lengths whose transforms are fast: without prime factors above 5
    n1, n2 = (fft.prev_fast_len(min(n, max(16, int(n * scale))), real=True) for n in surface.shape)
    start = (surface.shape[0] - n1) // 2, (surface.shape[1] - n2) // 2
    part = surface.crop((n1, n2), start).detrend()
    half_space = HalfSpace(part.shape, part.spacing, scene.modulus, ("mirror", "mirror"))
    gap = part.heights.max() - part.heights
    solve: Callable[..., Contact] = solve_contact
    if (fluid := scene.acting_fluid) is not None:
        solve = replace(fluid, settings=FlowSettings(), trapped=False).contact
    pressures = sorted({step.pressure for step in scene.steps if step.pressure > 0})
    chosen = np.linspace(0, len(pressures) - 1, min(_MOST_STEPS, len(pressures)))
    tried = [pressures[k] for k in chosen.round().astype(int)]
    found: dict[float, Effort] = {}
    for pressure in tried:
        try:
            contact = solve(
                gap, half_space, pressure=pressure, hardness=scene.hardness, rtol=scene.rtol
            )
            flow = cell_permeability(contact.gap, part.spacing, sides="periodic")
        except FemsealError:  # the run will tell
            found[pressure] = Effort()
            continue
        rounds = getattr(contact, "rounds", 1.0)
        rounds = min(rounds, 0.5 * (rounds + _MANY_ROUNDS))
        effort = Effort(contact.fft_pairs, contact.area_fraction, rounds=rounds)
        larger, (most, power) = PILOT_PIXELS / gap.size, _ELIMINATED
        iterations = flow.iterations or most * flow.percolating_fraction**power
        pairs = effort.pairs * larger**effort.growth
        found[pressure] = replace(effort, pairs=pairs, iterations=iterations)
    return tuple(_between(found, step.pressure) for step in scene.steps)


def _between(found: dict[float, Effort], pressure: float) -> Effort:
    """Effort at a pressure, linear in its logarithm between those that were solved."""
    if not found or pressure <= 0:
        return Effort(0.0, 0.0, FEW_ITERATIONS, 1.0)
    values = zip(*map(astuple, found.values()), strict=True)
    return Effort(*(np.interp(log(pressure), np.log([*found]), each) for each in values))
