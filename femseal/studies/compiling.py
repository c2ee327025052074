"""Compile the numerical loops of contact and flow after an installation, before the first run with several processes.

Numba compiles a function at its first call and stores the machine code in a file. If several processes called the same
function for the first time, each process would compile the function. To avoid repeated compilation, the functions are
divided among the processes. Each process compiles its share by solving tiny problems, and later reads the machine code
of all other functions from files.
"""

from __future__ import annotations

import hashlib
import logging
from collections.abc import Callable
from contextlib import suppress
from functools import partial
from math import inf
from pathlib import Path

import numba
import numpy as np
from llvmlite.binding import get_host_cpu_features, get_host_cpu_name

from .. import contact, flow
from ..base import Array
from ..base.stage import Mapper, Stage
from ..execution.run import COMPILING, Progress, no_progress
from ..face.cell_flow import FlowSettings, cell_permeabilities
from ..flow.grid import energy_of
from ..flow.solvers.choice import solve_flow
from ..flow.solvers.multigrid import THREADED_NODES, solve_multigrid
from ..flow.solvers.thresholds import MOST_MULTIGRID_ITERATIONS

log = logging.getLogger("femseal")
#: Names of the parts with the loops for mirror boundaries, and for grids whose rows are divided between threads.
_MIRRORS, _THREADS = "mirrors", "threads"


def compile_ahead(
    mapper: Mapper,
    progress: Progress = no_progress,
    *,
    has_mirrors: bool = True,
    largest_grid: float = inf,
) -> None:
    """Compile the loops of contact and flow in the processes of a mapper, unless the loops are already compiled.

    progress : callback progress(stage, done, total), called after each part of the loops has been compiled.
    has_mirrors : whether a contact has a mirror boundary, which needs further loops.
    largest_grid : number of points of the largest grid. Multigrid needs further loops on large grids.
    """
    is_needed = {_MIRRORS: has_mirrors, _THREADS: largest_grid >= THREADED_NODES}
    parts = [part for part in _PARTS if is_needed.get(part, True)]
    record = _record(parts)
    if record is None or record.exists():
        return
    stage = Stage(COMPILING, _compile)
    log.info("%s", stage.name)
    progress(stage.name, 0, len(parts))
    for count, _ in enumerate(mapper(stage, parts), start=1):
        progress(stage.name, count, len(parts))
    # without the record file, the next run repeats the stage and finds the machine code in the cache
    with suppress(OSError):
        record.touch()


def _record(parts: list[str]) -> Path | None:
    """Return the path of the record file, an empty file whose existence shows that some parts have been compiled.

    The name of the record file depends on everything that the machine code depends on: the source files, the processor,
    and the versions of Numba and NumPy. If the compiler is switched off by NUMBA_DISABLE_JIT, None is returned.
    """
    if not hasattr(energy_of, "stats"):  # a plain Python function, because of NUMBA_DISABLE_JIT
        return None
    package = Path(flow.__file__).parents[1]
    dependencies = [
        *parts,
        numba.__version__,
        np.__version__,
        get_host_cpu_name(),
        get_host_cpu_features().flatten(),
    ]
    for room in ("contact", "flow", "face"):
        for path in sorted((package / room).rglob("*.py")):
            dependencies.append(f"{path} {path.stat().st_mtime_ns} {path.stat().st_size}")
    digest = hashlib.sha256(repr(dependencies).encode()).hexdigest()
    return Path(energy_of.stats.cache_path) / f"compiled-{digest[:16]}"


def _compile(part: str) -> None:
    """Compile one of the parts in `_PARTS`, by solving a tiny problem that calls its loops."""
    _PARTS[part]()


def _network() -> flow.Stencil:
    """Return a small network of random conductances."""
    rng = np.random.default_rng(0)
    return flow.Stencil.network(
        np.exp(rng.normal(size=(17, 16))), np.exp(rng.normal(size=(16, 15))), ring=False
    )


def _gap(n: int) -> Array:
    """Return a gap (n, n) with the shape of cosine waves, which is 0 at some of the points."""
    waves = 1 + np.cos(2 * np.pi * np.arange(n) / n)
    return np.maximum(waves[:, None] + 0.5 * waves - 0.4, 0.0)


def _compile_multigrid() -> None:
    """Compile the multigrid iteration for small grids, and the choice of the solver."""
    for solver in ("multigrid", "auto"):
        solve_flow(_network(), solver=solver)


def _compile_threads() -> None:
    """Compile the multigrid loops for large grids, whose rows are divided between threads."""
    network = _network()
    solve_multigrid(network, rtol=1e-6, limit=MOST_MULTIGRID_ITERATIONS, on_threads=True)


def _compile_contact(boundary: str) -> None:
    """Compile the contact solver for mirror or for periodic boundaries, which use different loops."""
    body = contact.HalfSpace((32, 32), (1.0, 1.0), 1.0, (boundary, boundary))
    contact.solve_contact(_gap(32), body, pressure=0.01, hardness=0.05)


def _compile_cells() -> None:
    """Compile the loops that compute the permeability of a cell with overlaps into its neighbours."""
    gap = _gap(32)
    cell_permeabilities(gap, (1.0, 1.0), 0, FlowSettings(solver="elimination"), core=(4, 28))


#: Parts that take 2 to 25 s each, in the order in which they are started. The parts "cells" and "threads" call loops of
#: other parts. With two processes, these are already compiled when "cells" and "threads" start, and both processes end
#: at about the same time.
_PARTS: dict[str, Callable[[], object]] = {
    "contact": partial(_compile_contact, "periodic"),
    "elimination": lambda: solve_flow(_network(), solver="elimination"),
    "multigrid": _compile_multigrid,
    "cells": _compile_cells,
    _MIRRORS: partial(_compile_contact, "mirror"),
    _THREADS: _compile_threads,
}
