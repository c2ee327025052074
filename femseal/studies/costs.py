"""Expected time and memory of a study before it is started, and the choice of the method that follows from them."""

from __future__ import annotations

import numpy as np

from ..base.machine import free_memory
from ..contact.cycle import STATE_FIELDS
from ..scales.global_contact import PIXELS_PER_CUT_OFF
from .deterministic import STEP_BYTES, state_memory
from .sampling_options import Sampling
from .windows import CUT_OFF_WINDOWS

#: Seconds of one core for one contact solution and one flow solution of n pixels, fitted to 64² … 4096² on a 2-core
#: x86-64 machine; good to a factor of two.
_CONTACT_SECONDS = (4e-4, 3.0e-7, 1.0)
#: Number of states of a window on its ladder: loading, unloading and without contact.
_LADDER_STATES = 60
_FLOW_SECONDS = (2e-4, 3e-8, 1.25)


def _seconds(model: tuple[float, float, float], pixels: float) -> float:
    base, factor, power = model
    return base + factor * pixels**power * (np.log2(pixels) / 10 if power == 1.0 else 1.0)


def deterministic_cost(steps: int, points: tuple[int, int]) -> tuple[float, float]:
    """Expected time on one core [s] and memory [byte] of the deterministic solution."""
    pixels = points[0] * points[1]
    seconds = steps * (_seconds(_CONTACT_SECONDS, pixels) * 2 + _seconds(_FLOW_SECONDS, pixels))
    return seconds, STEP_BYTES * pixels * steps + state_memory(pixels)


def two_scale_cost(steps: int, points: tuple[int, int], cells: tuple[int, int]) -> tuple[float, float]:
    """Expected time on one core [s] and memory [byte] of the two-scale solution."""
    pixels, (m1, m2) = points[0] * points[1], cells
    window, links = pixels // (m1 * m2), m1 * m2 + (m1 - 1) * m2
    seconds = steps * (m1 * m2 * _seconds(_CONTACT_SECONDS, window) + links * _seconds(_FLOW_SECONDS, window))
    coarse = min(pixels, m1 * m2 * (PIXELS_PER_CUT_OFF / CUT_OFF_WINDOWS) ** 2)
    return seconds, 4.0 * pixels * steps + 8.0 * (8 * pixels + STATE_FIELDS * coarse)


def stochastic_cost(
    steps: int, points: tuple[int, int], cells: tuple[int, int], sampling: Sampling, seal: tuple[int, int]
) -> tuple[float, float]:
    """Expected time on one core [s] and memory [byte] of a library and of the drawn seals of n1 × n2 links."""
    pixels, windows = points[0] * points[1], cells[0] * cells[1]
    contact, flow = (_seconds(model, pixels // windows) for model in (_CONTACT_SECONDS, _FLOW_SECONDS))
    if sampling.pressure == "place":
        seconds = steps * (windows * contact + 2 * max(sampling.library_cells, windows) * flow)
    else:
        seconds = _LADDER_STATES * sampling.library_cells * (contact + 2 * (3 if sampling.bounds else 1) * flow)
    links = seal[0] * seal[1]
    # as many seals again from resampled libraries, and from lower and upper bounds
    seconds += (
        (4 if sampling.bounds else 2) * sampling.realisations * steps * 4e-7 * links * max(1.0, np.log2(min(seal)))
    )
    faces = two_scale_cost(steps, points, cells)[1] if sampling.pressure == "place" else 8.0 * 8 * pixels
    held = 1 if sampling.chosen_sampler in ("history", "block") else steps
    return seconds, faces + 8.0 * links * (held * 2 + 30)


#: Limits of the deterministic solution in an automatic choice: time on one core [s], and share of the free memory.
AFFORDABLE_SECONDS, AFFORDABLE_SHARE = 3600.0, 0.7


def choose_method(steps: int, points: tuple[int, int], cells: tuple[int, int]) -> tuple[str, str]:
    """Choose "deterministic", which is exact on its pixels, if it is affordable, and "two-scale" otherwise.

    Returns
    -------
    The method, and a line that says why.
    """
    seconds, memory = deterministic_cost(steps, points)
    free = free_memory()
    cost = f"deterministic about {seconds:.0f} s and {memory / 1e9:.2g} GB of {free / 1e9:.2g} GB free"
    if seconds <= AFFORDABLE_SECONDS and memory <= AFFORDABLE_SHARE * free:
        return "deterministic", f"{cost}: affordable, and nothing is more exact on these pixels"
    other, less = two_scale_cost(steps, points, cells)
    reason = "too long" if memory <= AFFORDABLE_SHARE * free else "too much"
    return "two-scale", f"{cost}: {reason}; two scales about {other:.0f} s and {less / 1e9:.2g} GB"
