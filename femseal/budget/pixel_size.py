"""Estimate the error due to the pixel size, from a solution on a coarser grid or from one grid only.

Source: Celik, Ghia, Roache, Freitas, Coleman & Raad, J. Fluids Eng. 130, 2008, 078001.
"""

from __future__ import annotations

import numpy as np

from ..base import Array, Flags
from ..studies import Scene
from .error_parts import ORDER, ErrorPart
from .leakage_changes import CoarserSolution, part_of_changes, scale_of_changes, sensitivity
from .missing_waves import sealed_for_certain

#: Ratio of the half-width of the interval to the typical change of ln(leakage) between a grid and one with half the
#: points along each side, see `scale_of_changes`. The ratio was measured on 154 surfaces of six kinds, at loads at
#: which the leakage exceeds 1e-3 of the leakage under the first load: with a ratio of 0.28 the interval contains the
#: true leakage in 95 % of the cases, with 0.31 in 96.5 %, and with 0.43 in 98 % (97 % on other surfaces).
PER_CHANGE = 0.43
#: Factor by which the half-width of an interval is multiplied if only a few loads were solved on the fine and on the
#: coarse grid; the keys are the numbers of these loads. The factors were measured on the surfaces with which
#: `PER_CHANGE` was measured.
FEW_LOADS = {0: 3.0, 1: 3.0, 2: 1.45, 3: 1.15}
#: Smallest shift of ln(load) that is assumed for any surface, and smallest slope |d ln(leakage)/d ln(load)| by which
#: this shift is multiplied. The shift and the slope were measured on the surfaces of `PER_CHANGE`: if a third of the
#: shift and a fifth of the slope are assumed, intervals of equal width contain the true leakage in 94.5 % of the cases
#: instead of 97 %.
_LEAST_SHIFT, _LEAST_SLOPE = 0.012, 1.5
#: Pixels in the shortest wave of the surfaces on which `PER_CHANGE` and the constants below it were measured.
USUAL_PIXELS = 8.0
#: A seal is near closing if it leaks less than this fraction of the leakage through a uniform gap of the same mean
#: height. Measured on 20 surfaces of ten kinds, which leak at this limit about 1e-3 of their leakage under the lowest
#: load.
_CLOSING_LEAKAGE = 1e-2
#: A step near closing may be sealed if the error of ln(leakage) is larger than this.
_MAY_CLOSE = 1.5


def near_closing(leakage: Array, open_leakage: Array) -> Flags:
    """Flag the load steps at which the last leakage path is about to close, array (steps,).

    At such a step, the surface leaks far less than a uniform gap of equal mean height, see `_CLOSING_LEAKAGE`.

    open_leakage : leakage of the uniform gap (steps,) [m²/s]; NaN where it is unknown.
    """
    with np.errstate(invalid="ignore"):
        return np.abs(leakage) < _CLOSING_LEAKAGE * np.abs(open_leakage)


def pixels_part(
    scene: Scene,
    leakage: Array,
    coarse: CoarserSolution,
    wave_pixels: float = USUAL_PIXELS,
    closing: Flags | bool = False,
    in_contact: Array | float = np.nan,
) -> ErrorPart:
    """Estimate the error due to the pixel size from a solution on a coarser grid.

    The half-width of the interval of ln(leakage) is P √(c² + s²). The factor P is `PER_CHANGE`, multiplied by
    `FEW_LOADS` if few loads were solved. The term c is the typical change of ln(leakage) from a grid to a grid with
    half the points along each side, see `scale_of_changes`. The term s is the change of ln(leakage) under a small shift
    of the load. The term s keeps the interval from being too narrow if the change between the grids is small by chance.

    The lower end of the interval is 0 at steps where the coarser grid does not leak. The lower end is also 0 at
    steps where the last leakage path is about to close and the half-width is larger than `_MAY_CLOSE`.

    Parameters
    ----------
    scene : input of the study.
    leakage : array (steps,), m²/s.
    coarse : solution on the coarser grid.
    wave_pixels : number of pixels in the shortest wave. Above `USUAL_PIXELS` pixels, the assumed shift of the load
        decreases in inverse proportion to the number of pixels.
    closing : whether the last leakage path is about to close at each step (steps,), see `near_closing`.
    in_contact : contact fraction (steps,).
    """
    steps = scene.steps
    # ratio of the pixel sizes of the coarser grid and of the grid of the study
    coarsening = float(np.sqrt(np.prod(scene.surface.shape) / np.prod(coarse.points)))
    change = coarse.change(leakage)
    slope = np.maximum(sensitivity(steps, leakage, np.asarray(in_contact)), _LEAST_SLOPE)
    # The error of a grid is proportional to (pixel size)**ORDER, so that the change to a grid with pixels r times as
    # large is proportional to r**ORDER − 1. Scale it to r = 2.
    change_to_half = change * (2.0**ORDER - 1) / (coarsening**ORDER - 1)
    least_shift = _LEAST_SHIFT * min(1.0, USUAL_PIXELS / wave_pixels)
    typical_change = scale_of_changes(steps, change_to_half, slope)  # c
    least_change = least_shift * slope  # s
    n_loads = int((np.isfinite(change) & steps.on_loading).sum())
    factor = PER_CHANGE * FEW_LOADS.get(n_loads, 1.0)  # P
    half_width = factor * np.hypot(typical_change, least_change)
    may_close = closing & (half_width > _MAY_CLOSE)
    half_width_below = np.where(may_close | np.isneginf(change), np.inf, half_width)
    grid = " × ".join(map(str, coarse.points))
    note = f"change of ln(leakage) to {grid} points, at a load and its neighbours; order {ORDER:g} expected"
    return part_of_changes(
        "pixels",
        steps,
        leakage,
        half_width_below,
        half_width,
        note,
        change=change,
        coarse=coarse,
    )


def one_grid_part(leakage: Array, in_contact: Array) -> list[ErrorPart]:
    """Estimate the error due to the pixel size for a surface that was solved on a single grid.

    Without a second grid, the error due to the pixel size is unknown at leaking steps, and the interval shrinks to the
    leakage itself. At steps that are sealed on the grid, a finer grid may leak. The upper end of the interval at a
    sealed step is therefore inf, unless a large contact fraction shows that the step is certainly sealed.

    in_contact : contact fraction at every step (steps,).

    Returns an empty list if all sealed steps are certainly sealed.
    """
    q = np.abs(np.asarray(leakage, float))
    may_open = (q == 0) & ~sealed_for_certain(in_contact)
    if not may_open.any():
        return []
    note = "one grid, which does not show how far beyond its closing load a sealed face is"
    return [ErrorPart("pixels", q, np.where(may_open, np.inf, q), note)]
