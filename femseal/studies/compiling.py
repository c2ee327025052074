"""Loops compiled before a run with several processes, once after an installation, each loop by one process for all.

Numba compiles a loop where it is first called and keeps it in a file. Processes that come to it at the same time would
all compile it; here each gets a part of the loops, on a problem of a few nodes, and then finds the others' in files.
"""

from __future__ import annotations

import hashlib
import logging
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

import numba
import numpy as np
from llvmlite.binding import get_host_cpu_features, get_host_cpu_name

from .. import contact, flow
from ..base import Array
from ..base.stage import Mapper, Stage
from ..execution.run import COMPILING, Progress, no_progress
from ..face.cell_flow import FlowSettings, cell_permeabilities
from ..flow.cell import harmonic_fill
from ..flow.grid import energy_of
from ..flow.solvers.choice import solve_flow
from ..flow.solvers.hierarchy import build_levels

log = logging.getLogger("femseal")


def compile_ahead(mapper: Mapper, progress: Progress = no_progress) -> None:
    """Compile the loops of contact and flow by the processes of a mapper, unless that was done on this machine.

    progress : called as progress(stage, done, total).
    """
    done = _record()
    if done is None or done.exists():
        return
    stage = Stage(COMPILING, _compile)
    log.info("%s", stage.name)
    progress(stage.name, 0, len(_PARTS))
    for count, _ in enumerate(mapper(stage, list(_PARTS)), start=1):
        progress(stage.name, count, len(_PARTS))
    with suppress(OSError):  # the loops were compiled, which is what counts
        done.touch()


def _record() -> Path | None:
    """File beside the compiled loops that says that they are there, for this code, machine and numba; None without."""
    if not hasattr(energy_of, "stats"):  # a plain function, as NUMBA_DISABLE_JIT leaves it
        return None
    package = Path(flow.__file__).parents[1]
    seen = [
        numba.__version__,
        np.__version__,
        get_host_cpu_name(),
        get_host_cpu_features().flatten(),
    ]
    for room in ("contact", "flow", "face"):
        for path in sorted((package / room).rglob("*.py")):
            seen.append(f"{path} {path.stat().st_mtime_ns} {path.stat().st_size}")
    digest = hashlib.sha256(repr(seen).encode()).hexdigest()
    return Path(energy_of.stats.cache_path) / f"compiled-{digest[:16]}"


def _compile(part: str) -> None:
    _PARTS[part]()


def _network() -> flow.Stencil:
    rng = np.random.default_rng(0)
    return flow.Stencil.network(
        np.exp(rng.normal(size=(17, 16))), np.exp(rng.normal(size=(16, 15))), ring=False
    )


def _gap(n: int) -> Array:
    waves = 1 + np.cos(2 * np.pi * np.arange(n) / n)
    return np.maximum(waves[:, None] + 0.5 * waves - 0.4, 0.0)


def _levels() -> None:
    s = _network()
    build_levels(s.along, s.across, s.ring2)


def _multigrid() -> None:
    for solver in ("multigrid", "auto"):
        solve_flow(_network(), solver=solver)


def _contact() -> None:
    for boundary in ("mirror", "mirror"), ("periodic", "periodic"):  # waves of mirrors mix
        body = contact.HalfSpace((32, 32), (1.0, 1.0), 1.0, boundary)
        contact.solve_contact(_gap(32), body, pressure=0.01, hardness=0.05)


def _cells() -> None:
    gap = _gap(32)
    cell_permeabilities(gap, (1.0, 1.0), 0, FlowSettings(solver="elimination"), core=(4, 28))


def _seals() -> None:
    solve_flow(flow.Stencil(np.ones((3, 200)), np.ones((2, 200))))
    harmonic_fill(np.where(_gap(4) > 1, _gap(4), np.nan))


#: Parts of 4 to 19 s, in the order in which they start. Where two processes take them, the loops that "multigrid" and
#: "cells" call are there by then, and both processes end at about the same time.
_PARTS: dict[str, Callable[[], object]] = {
    "elimination": lambda: solve_flow(_network(), solver="elimination"),
    "levels": _levels,
    "multigrid": _multigrid,
    "contact": _contact,
    "cells": _cells,
    "seals": _seals,
}
