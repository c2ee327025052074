"""The input of the studies of a case, and what each of them gives and costs.

Sizes of a case are checked against the free memory before anything is made.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import asdict, dataclass, replace
from math import prod
from typing import Any

import numpy as np

from ..base import Array, InputError, Mapper, free_memory, to_text
from ..budget import FormTolerance, ModelChange
from ..face.pieces import FEWEST_POINTS, Cut, usual_pieces
from ..seal.layouts import AnnularLayout, Layout
from ..seal.tiles import MOST_ROWS, SealTiles
from ..studies import STUDIES, Sampling, Scene, Study, StudyOptions, laid_out
from ..studies.doubts import FirstAnswer, FormEffect, of_scene
from ..studies.longer_waves import longer_waves
from ..studies.study_registry import Effort, usual_efforts
from ..topography import (
    Conditioning,
    Continuation,
    Overlap,
    Representative,
    Topography,
    representative,
)

#: Memory of the libraries that a run imports [byte].
START_MEMORY = 0.5e9
#: Memory that a point of a face takes at least while faces are made, low-passed and resampled [byte].
_POINT_BYTES = 64
#: Memory of a tile of a drawn seal, with its element and a row of the solver [byte].
_TILE_BYTES = 4000


def check_memory_of_points(key: str, shape: tuple[int, int], places: int = 1) -> None:
    """Raise InputError if a face of so many points, those of all its places, does not fit into the free memory."""
    together = f" of {places} places together" if places > 1 else ""
    check_memory(key, f"{shape[0]} × {shape[1]} points{together}", prod(shape) * _POINT_BYTES)


def check_memory_of_tiles(layout: Layout, sampling: Sampling, surface: Topography) -> None:
    """Raise InputError if the tiles of a strip or a ring, as large as pieces of a face, do not fit into memory."""
    side1, side2 = Cut.of(surface, usual_pieces(surface)).size
    if isinstance(layout, AnnularLayout):
        key, breadth, length = (
            "seal",
            layout.outer_radius - layout.inner_radius,
            layout.circumference,
        )
    elif sampling.length is not None:
        key, breadth, length = (
            "stochastic.length",
            sampling.breadth or surface.size[0],
            sampling.length,
        )
    else:
        return
    rows, columns = breadth / side1, length / side2
    if rows > MOST_ROWS:  # refused when it is laid out
        return
    hint = "; is its unit of length right?" if key == "seal" else ""
    given, tiles = f"a seal {to_text(length, 'm', 3)} long", rows * columns
    check_memory(key, f"{given}, of {tiles:.3g} tiles", tiles * _TILE_BYTES, hint)


def check_memory(key: str, given: object, needed: float, hint: str = "") -> None:
    """Raise InputError, which names a key and its value and ends with a hint, if so many bytes are not free."""
    if needed > (free := free_memory()):
        expected = f"what fits into the {free / 1e9:.3g} GB of free memory; it takes about {needed / 1e9:.3g} GB{hint}"
        raise InputError(key, given, expected)


@contextmanager
def refused_if_too_large() -> Iterator[None]:
    """Sizes that no array can have, or numbers that no float can hold, are bad input."""
    try:
        yield
    except (MemoryError, OverflowError, RecursionError) as error:
        expected = f"sizes that fit into memory and numbers of usual size ({str(error) or type(error).__name__})"
        raise InputError("case", "a size or number that is too large", expected) from error


Pair = tuple[int, int]


@dataclass(frozen=True)
class Prepared:
    """Input of the studies: the scene, its pieces, the sampling of seals; and the history of the surface.

    cells : number of pieces along x1 and x2; None where there are none. continuation : of the spectrum of the face,
    None without. methods : to be run. seat : its form, "" where it is flat; form : that and its error. holds : what a
    measured face holds of its long waves. form_effect : of what is form in it, where nothing says that; None
    elsewhere. flatness : of the seal [m], None where it is not given. warnings : what is not plausible in the case.
    """

    scene: Scene
    cells: Pair | None
    sampling: Sampling | None
    conditioning: Conditioning
    overlap: Overlap | None
    continuation: Continuation | None
    methods: frozenset[str]
    seat: str = ""
    form: FormTolerance | None = None
    holds: Representative | None = None
    form_effect: FormEffect | None = None
    flatness: float | None = None
    warnings: tuple[str, ...] = ()

    def longer_waves(self, surface: Topography, mapper: Mapper) -> Array | None:
        """Changes of ln(leakage) of drawn seals by waves longer than the patch, see `studies.longer_waves`.

        surface : the face, also on fewer points. None where nothing is to be expected.
        """
        sampling = self.sampling
        if sampling is None or (self.holds is None and self.flatness is None):
            return None
        holds = self.holds or representative(surface)
        scene = replace(self.scene, surface=surface)
        return longer_waves(
            scene,
            sampling.breadth,
            sampling.length,
            holds,
            flatness=self.flatness,
            seed=sampling.seed,
            forms=sampling.form,
            mapper=mapper,
        )

    @property
    def first_answer(self) -> FirstAnswer | None:
        """Contact and leakage by the spectrum of the face alone; None where a form, a map or a spiral decides."""
        sampling, scene = self.sampling, self.scene
        uneven = sampling is not None and not sampling.presses_evenly
        if self.seat or uneven or scene.flow.spiral is not None or not scene.surface.rms_slope:
            return None
        found = of_scene(scene, None if sampling is None else self.cut_and_tiles[1])
        return found if np.isfinite(found.area).any() else None

    @property
    def studies(self) -> list[Study]:
        """The studies to be run, in the order in which they are solved."""
        return [study for study in STUDIES.values() if study.name in self.methods]

    @property
    def solved_studies(self) -> list[Study]:
        """Those of them that are solved: two scales have what the deterministic study has."""
        names = self.methods - ({"deterministic"} if "two-scale" in self.methods else set())
        return [study for study in self.studies if study.name in names]

    @property
    def answer(self) -> Study:
        """The study whose leakage is the answer: the one farthest from the face itself."""
        return self.studies[-1]

    def options(self, study: Study) -> StudyOptions:
        """The options of a study."""
        return StudyOptions(
            self.cells, self.sampling, knows_face=study.name != self.solved_studies[0].name
        )

    @property
    def least_points(self) -> Pair:
        """Fewest points of the face along x1 and x2 for pieces of drawn seals."""
        m1, m2 = self.cells if self.cells is not None and "stochastic" in self.methods else (1, 1)
        return FEWEST_POINTS * m1, FEWEST_POINTS * m2

    @property
    def points_divide_by(self) -> Pair:
        """Numbers along x1 and x2 that divide those of the points: of the pieces of blocks."""
        return self.cells if self.cells is not None and "blocks" in self.methods else (1, 1)

    @property
    def cut_and_tiles(self) -> tuple[Cut, SealTiles]:
        """The cut of the face, and the tiles of the drawn seals."""
        assert self.sampling is not None
        return laid_out(self.scene.surface, self.scene.layout, self.cells, self.sampling)

    def changed(self, change: ModelChange) -> Prepared:
        """The input with a change of the model."""
        sampling = self.sampling
        if change.forms and sampling is not None:
            sampling = replace(sampling, form=change.forms)
        return replace(self, scene=change.scene, sampling=sampling)

    def solve(self, study: Study, mapper: Mapper) -> Any:
        """Result of a study."""
        options = self.options(study)
        return study.solve(
            self.scene, *(getattr(options, name) for name in study.takes), mapper=mapper
        )

    def cost(self, study: Study, efforts: Sequence[Effort] | None = None) -> tuple[float, float]:
        """Expected time on one core [s] and memory [byte] of a study.

        efforts : of each load step; usual ones unless given.
        """
        known = usual_efforts(len(self.scene.steps)) if efforts is None else efforts
        return study.cost(self.scene, self.options(study), known)

    @property
    def chosen(self) -> dict[str, Any]:
        """What is computed, and how, whether the case says so or leaves it to the program, as plain data."""
        scene = self.scene
        found: dict[str, Any] = {
            "methods": sorted(self.methods),
            "points": list(scene.surface.shape),
            "shortest wave": self.conditioning.shortest_wave,
            **({"seat": self.seat} if self.seat else {}),
            "solver": scene.solver,
        }
        if self.cells is not None:
            found["cells"] = list(self.cells)
        return found

    @property
    def surface_report(self) -> dict[str, Any]:
        """The repair and conditioning of the surface, as plain data."""
        found = asdict(self.conditioning) | (
            {} if self.overlap is None else {"overlap": asdict(self.overlap)}
        )
        if self.continuation is not None:
            found["continuation"] = asdict(self.continuation) | {"text": str(self.continuation)}
        return found
