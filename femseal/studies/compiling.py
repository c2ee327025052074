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
from ..flow.harmonic import harmonic_fill
from ..flow.solvers.choice import solve_flow
from ..flow.solvers.hierarchy import build_levels

log = logging.getLogger("femseal")
#: Name of the part with the loops for mirror boundaries.
_MIRRORS = "mirrors"


def compile_ahead(
    mapper: Mapper, progress: Progress = no_progress, *, has_mirrors: bool = True
) -> None:
    """Compile the loops of contact and flow in the processes of a mapper, unless the loops are already compiled.

    progress : callback progress(stage, done, total), called after each part of the loops has been compiled.
    has_mirrors : whether a contact has a mirror boundary, which needs further loops.
    """
    parts = [part for part in _PARTS if has_mirrors or part != _MIRRORS]
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


def _compile_levels() -> None:
    """Compile the loops that set up the multigrid levels."""
    network = _network()
    build_levels(network.along, network.across, network.ring2)


def _compile_multigrid() -> None:
    """Compile the multigrid iterations and the choice of the solver."""
    for solver in ("multigrid", "auto"):
        solve_flow(_network(), solver=solver)


def _compile_contact(boundary: str) -> None:
    """Compile the contact solver for mirror or for periodic boundaries, which use different loops."""
    body = contact.HalfSpace((32, 32), (1.0, 1.0), 1.0, (boundary, boundary))
    contact.solve_contact(_gap(32), body, pressure=0.01, hardness=0.05)


def _compile_cells() -> None:
    """Compile the loops that compute the permeability of a cell with overlaps into its neighbours."""
    gap = _gap(32)
    cell_permeabilities(gap, (1.0, 1.0), 0, FlowSettings(solver="elimination"), core=(4, 28))


def _compile_seals() -> None:
    """Compile the loops for the flow over seals, and for contact that is coupled with the fluid pressure."""
    solve_flow(flow.Stencil(np.ones((3, 200)), np.ones((2, 200))))
    harmonic_fill(np.where(_gap(4) > 1, _gap(4), np.nan))


#: Parts that take 2 to 19 s each, in the order in which they are started. The parts "multigrid" and "cells" call loops
#: of other parts. With two processes, the other parts are already compiled when "multigrid" and "cells" start, and both
#: processes end at about the same time.
_PARTS: dict[str, Callable[[], object]] = {
    "elimination": lambda: solve_flow(_network(), solver="elimination"),
    "levels": _compile_levels,
    "multigrid": _compile_multigrid,
    "contact": partial(_compile_contact, "periodic"),
    "cells": _compile_cells,
    "seals": _compile_seals,
    _MIRRORS: partial(_compile_contact, "mirror"),
}
