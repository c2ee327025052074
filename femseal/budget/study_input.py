"""Hold the input of the studies of a run, and make the modified versions that a run and its error budget need.

The input is made from a case by `preparation.prepare`.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass, replace
from math import lcm
from typing import Any

from ..base import Array, Mapper, Shape
from ..checks import FormEffect, QuickEstimate, estimate_scene, solve_form_effect
from ..face.cut import Cut
from ..seal.tiles import SealTiles
from ..studies import Sampling, Scene, Study, StudyCost, StudyOptions, cut_and_cover, studies_named
from ..studies.patch_state import open_leakage_per_permeability
from ..topography import (
    Conditioning,
    Continuation,
    Overlap,
    Representative,
    Surface,
    representative,
)
from .changed_models import FormTolerance, ModelChange
from .longer_waves import longer_waves


@dataclass(frozen=True)
class StudyInput:
    """Input of the studies that was prepared from a case, with reports on the preparation of the surface.

    Attributes
    ----------
    scene : Scene
        Surface, loads and fluid.
    cells : (int, int) or None
        Numbers of cells along x1 and x2; None if the studies do not need cells.
    sampling : Sampling or None
        Options of the stochastic study; None without a stochastic study.
    conditioning : Conditioning
        Report on the repair and filtering of the surface.
    overlap : Overlap or None
        Overlap of two measured faces; None for a single face.
    continuation : Continuation or None
        Continuation of the spectrum of the surface to shorter wavelengths; None if the spectrum is not continued.
    methods : frozenset of str
        Names of the studies to be run.
    seat : str
        Description of the shape of the seat; "" for a flat seat.
    form : FormTolerance or None
        Form deviations of seal and seat with their tolerances; None if seal and seat are flat.
    longest_waves : Representative or None
        Longest waves of a measured patch, and how many of them fit into the patch; None for a generated surface.
    form_pressures : tuple of float, Pa
        Nominal pressures at which the effect of the form deviation of a measured patch on the leakage is computed;
        empty if the case defines the form.
    flatness : float or None, m
        Flatness of the seal; None if the case does not specify it.
    warnings : tuple of str
        One sentence for each implausible value in the case.
    """

    scene: Scene
    cells: Shape | None
    sampling: Sampling | None
    conditioning: Conditioning
    overlap: Overlap | None
    continuation: Continuation | None
    methods: frozenset[str]
    seat: str = ""
    form: FormTolerance | None = None
    longest_waves: Representative | None = None
    form_pressures: tuple[float, ...] = ()
    flatness: float | None = None
    warnings: tuple[str, ...] = ()

    def longer_waves(self, surface: Surface, mapper: Mapper) -> Array | None:
        """Compute how waves longer than the patch change ln(leakage), see `budget.longer_waves`.

        Returns None if waves longer than the patch are not expected.

        Parameters
        ----------
        surface : Topography or Patches
            Surface of the scene, possibly resampled to a coarser grid.
        mapper : callable
            Function such as the builtin `map`, which computes a stage for many items.
        """
        sampling = self.sampling
        if sampling is None or (self.longest_waves is None and self.flatness is None):
            return None
        return longer_waves(
            replace(self.scene, surface=surface),
            sampling.breadth,
            sampling.length,
            self.longest_waves or representative(surface),
            flatness=self.flatness,
            seed=sampling.seed,
            forms=sampling.form,
            mapper=mapper,
        )

    def estimate(self) -> QuickEstimate | None:
        """Estimate contact and leakage from the spectrum of the surface alone, see `checks.estimate_scene`.

        The quick estimate is not possible if a form deviation, a pressure map or spiral grooves determine the leakage;
        None is returned in these cases. The result of a solved study contains the quick estimate as well.
        """
        if self.sampling is None:
            return estimate_scene(self.scene)
        if not self.sampling.presses_evenly:
            return None
        _, tiles = self.cut_and_tiles
        seal = tiles.seal
        return estimate_scene(self.scene, open_leakage_per_permeability(self.scene, seal))

    def solve_form_effect(self) -> FormEffect | None:
        """Solve contact and flow of a measured patch with and without its form deviation.

        None is returned if the case defines the form, or if the surface was not measured. For the method, see
        `checks.solve_form_effect`.
        """
        if not self.form_pressures:
            return None
        scene = self.scene
        return solve_form_effect(
            scene.surface, scene.modulus, scene.law, self.form_pressures, scene.boundary
        )

    @property
    def studies(self) -> list[Study]:
        """Studies of the run, in the order in which they are solved."""
        return studies_named(self.methods)

    @property
    def solved_studies(self) -> list[Study]:
        """Studies that are solved separately, without those whose result is contained in that of another study."""
        contained = {study.contained for study in self.studies}
        return [study for study in self.studies if study not in contained]

    @property
    def answer(self) -> Study:
        """Study whose leakage is the result of the run, the last study in `studies`.

        If the run includes the stochastic study, the leakage of the whole seal is taken from the stochastic study.
        """
        return self.studies[-1]

    @property
    def only_answer(self) -> StudyInput:
        """Copy of the input in which `answer` is the only study."""
        return replace(self, methods=frozenset({self.answer.name}))

    def options(self, study: Study) -> StudyOptions:
        """Return the options with which a study is solved in this run."""
        earlier_studies = self.studies[: self.studies.index(study)]
        surface_is_solved = any(
            earlier.solves_whole_surface
            for earlier in earlier_studies
            if earlier in self.solved_studies
        )
        return StudyOptions(self.cells, self.sampling, surface_is_solved)

    def with_realisations(self, count: int) -> StudyInput:
        """Return a copy of the input with the given number of realisations of the stochastic study.

        If no number is given, the number of realisations depends on the scatter of the leakage, and therefore on the
        fluid, the surface and the contact law. If a number is given, two runs take the same cells in realisation n, so
        that their leakages can be compared realisation by realisation.
        """
        if self.sampling is None:
            return self
        return replace(self, sampling=replace(self.sampling, realisations=count))

    @property
    def least_points(self) -> Shape:
        """Smallest numbers of points along x1 and x2 that the studies require for their cells."""
        if self.cells is None:
            return 1, 1
        points = [study.least_points(self.cells) for study in self.studies]
        return max(n1 for n1, _ in points), max(n2 for _, n2 in points)

    @property
    def points_divide_by(self) -> Shape:
        """Divisors of the numbers of points along x1 and x2.

        If a study needs cells with equal numbers of points, the divisors are the numbers of cells, otherwise 1.
        """
        if self.cells is None:
            return 1, 1
        divisors = [study.points_divide_by(self.cells) for study in self.studies]
        return lcm(*(d1 for d1, _ in divisors)), lcm(*(d2 for _, d2 in divisors))

    @property
    def cut_and_tiles(self) -> tuple[Cut, SealTiles]:
        """Division of the surface into cells, and tiles of the seal of the stochastic study."""
        assert self.sampling is not None
        return cut_and_cover(self.scene.surface, self.scene.layout, self.cells, self.sampling)

    def changed(self, change: ModelChange) -> StudyInput:
        """Return a copy of the input in which the scene and the forms are changed, for the error budget."""
        sampling = self.sampling
        if change.forms and sampling is not None:
            sampling = replace(sampling, form=change.forms)
        return replace(self, scene=change.scene, sampling=sampling)

    def solve(self, study: Study, mapper: Mapper) -> Any:
        """Solve a study, and return its result."""
        return study.solve(self.scene, self.options(study), mapper)

    def cost(self, study: Study) -> StudyCost:
        """Return the expected time on one core [s] and the memory [byte] of a study."""
        return study.cost(self.scene, self.options(study))

    @property
    def chosen(self) -> dict[str, Any]:
        """All settings of the run as plain data, including defaults chosen by the program."""
        scene = self.scene
        choices: dict[str, Any] = {
            "methods": sorted(self.methods),
            "points": list(scene.surface.shape),
            "shortest wave": self.conditioning.shortest_wave,
        }
        if self.seat:
            choices["seat"] = self.seat
        choices["solver"] = scene.solver
        if self.cells is not None:
            choices["cells"] = list(self.cells)
        return choices

    @property
    def surface_report(self) -> dict[str, Any]:
        """Report on the repair and conditioning of the surface, as plain data."""
        report = asdict(self.conditioning)
        if self.overlap is not None:
            report["overlap"] = asdict(self.overlap)
        if self.continuation is not None:
            report["continuation"] = asdict(self.continuation) | {"text": str(self.continuation)}
        return report
