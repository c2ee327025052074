"""The case solved again with one thing changed: hardness, length of the flow law, or the face turned by 90°."""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from typing import Any, cast

import numpy as np

from ..case.case import Case
from ..execution.mappers import ordered_map
from ..execution.run import Progress, Run
from ..flow.law import law_of
from ..fluids import FLUIDS
from ..preparation.preparation import Prepared, prepare
from ..refinement.settings import last_version
from ..results.results import Results
from ..studies import Scene
from ..studies.compiling import compile_ahead
from ..studies.other_fluid import FluidState
from ..topography import Topography
from .seals import Seals
from .sensitivities import Variants

#: Factors of hardness and of the length of a flow law: small enough for a slope, and above the residuals of contact.
HARDER = LONGER = 1.03


@dataclass(frozen=True, eq=False)
class TurnedSeals:
    """Seals of the turned face. factor : of their leakage, for the same breadth. how : what was solved."""

    seals: Seals
    factor: float
    how: str


class Solver:
    """Solves variants of a case for the fluid that decides on its classes."""

    def __init__(self, case: Case, results: Results, workers: int | None, progress: Progress) -> None:
        self._case, self._workers, self._progress = case, workers, progress
        prepared: Prepared = last_version(case, prepare(case), results.attempts)
        if prepared.sampling is not None and prepared.sampling.width is not None:
            # as many seals and windows as the run took in the end
            size = int(results.dataset.attrs.get("library_windows", prepared.sampling.library_cells))
            count = results.dataset.sizes["realisation"]
            sampling = replace(prepared.sampling, width=None, realisations=count, library_cells=size)
            prepared = replace(prepared, sampling=sampling)
        self._prepared, self._breadth = prepared, float(results.dataset.attrs["seal_size_m"][0])
        state = (case.output.test_fluid or case.fluid).state
        self._scene = state.in_scene(self._prepared.scene)

    def variants(self) -> Variants:
        """The seals with another hardness, if the solids yield, and another length of the flow law, if it has one."""
        scene = self._scene
        harder = longer = None
        yields = not scene.law.is_elastic
        if yields:
            harder = self._seals("another hardness", replace(scene, hardness=scene.law.times(HARDER)))
        name, fluid = law_of(scene.fluid).length, cast(Any, scene.fluid)
        if hasattr(fluid, name):
            changed = replace(fluid, **{name: LONGER * getattr(fluid, name)})
            longer = self._seals(f"another {name.replace('_', ' ')}", replace(scene, fluid=changed))
        return Variants(harder, longer, HARDER, LONGER, hardness_counts=yields, hardens=not scene.law.is_perfect)

    def turned(self) -> TurnedSeals:
        """The seals of the face turned by 90°.

        Raises InputError: the turned face does not go with the shape of the seal or with its windows.
        """
        prepared, scene = self._prepared, self._scene
        scene.check_one_place("lay", "turned", "as measured")
        surface = scene.surface
        turned = replace(scene, surface=Topography(np.ascontiguousarray(surface.heights.T), surface.spacing[::-1]))
        cells = None if prepared.cells is None else prepared.cells[::-1]
        sampling = prepared.sampling
        # other shapes than strips have a breadth of their own, and no length is given
        strip = sampling is not None and sampling.length is not None
        if sampling is not None and strip and sampling.pressure == "uniform" and sampling.breadth is None:
            sampling = replace(sampling, breadth=surface.size[0])
        study = self._solved("face turned by 90°", turned, replace(prepared, cells=cells, sampling=sampling))
        # leakage goes with one over the breadth
        factor = _breadth(study, turned) / self._breadth
        how = "solved again with the face turned by 90°"
        if abs(factor - 1) > 1e-9:
            how += ", at the same breadth by Darcy's law"
        return TurnedSeals(_of_study(study, turned), factor, how)

    def _seals(self, name: str, scene: Scene) -> Seals:
        return _of_study(self._solved(name, scene, self._prepared), scene)

    def _solved(self, name: str, scene: Scene, prepared: Prepared) -> Any:
        version, mapping = replace(prepared, scene=scene), ordered_map(self._workers, before=compile_ahead)
        with mapping as mapper, Run(mapper, self._progress).timed(name) as watched:
            return version.solve(version.answer, watched)


def _breadth(study: Any, scene: Scene) -> float:
    seal = getattr(study, "seal", None)
    return float(seal.size[0]) if seal is not None and hasattr(seal, "size") else float(scene.surface.size[0])


def _of_study(study: Any, scene: Scene) -> Seals:
    return Seals.of(scene.steps, study.leakage, getattr(study, "library_error", None))


def state_of_classes(results: Results) -> FluidState | None:
    """The fluid that decides on classes, from the case of the results; None if that does not say it."""
    try:
        table = results.case.get("output", {}).get("test_fluid") or results.case["fluid"]
        made = FLUIDS[table["kind"]]
        fluid = made(**{f.name: table[f.name] for f in fields(made) if f.name in table})
        return FluidState(fluid, float(table["inlet_pressure"]), float(table["outlet_pressure"]))
    except (KeyError, TypeError, ValueError, AttributeError):
        return None if results.scene is None else FluidState.of(results.scene)


def inlet_slope(state: FluidState) -> float:
    """d ln L/d ln p_in of a fluid whose law does not depend on the pressure; NaN for a rarefied gas."""
    if state.law.depends_on_pressure:
        return float("nan")
    step = 1e-4
    up, down = (replace(state, inlet_pressure=state.inlet_pressure * (1 + sign * step)) for sign in (1, -1))
    return float(np.log(up.drop / down.drop) / np.log((1 + step) / (1 - step)))
