"""The input of the studies of a case, and what each of them gives and costs.

Sizes of a case are checked against the free memory before anything is made.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import asdict, dataclass, replace
from math import ceil, prod
from typing import Any

from ..base import InputError, Mapper, free_memory, to_text
from ..budget import FormTolerance, ModelChange
from ..studies import STUDIES, Sampling, Scene, Study, StudyOptions
from ..studies.costs import Effort, usual_efforts
from ..studies.seat_rows import SeatMap
from ..topography import Conditioning, Continuation, Overlap
from ..windows import Partition

#: Memory of the libraries that a run imports [byte].
START_MEMORY = 0.5e9
#: Memory that a point of a face takes at least while faces are made, low-passed and resampled [byte].
_POINT_BYTES = 64
#: Memory of a link of a drawn seal: its permeabilities at one step and a row of the solver [byte].
_LINK_BYTES = 8 * 32


def check_memory_of_points(key: str, shape: tuple[int, int], places: int = 1) -> None:
    """Raise InputError if a face of so many points, those of all its places, does not fit into the free memory."""
    together = f" of {places} places together" if places > 1 else ""
    check_memory(key, f"{shape[0]} × {shape[1]} points{together}", prod(shape) * _POINT_BYTES)


def check_memory_of_draws(
    steps: int, seal: tuple[int, int], realisations: int, library_cells: int, paths: int = 1, shape: str = ""
) -> None:
    """Raise InputError if drawn seals, their leakages, or the curves of a library do not fit into the free memory.

    shape : of a seal with a length of its own, as text. paths : of pressure, for each of which every library window has
    its own curve.
    """
    windows = f"of {seal[0]} × {seal[1]:.4g} windows"
    key, given = ("seal", f"{shape}, {windows}") if shape else ("stochastic.length", f"a seal {windows}")
    check_memory(key, given, prod(seal) * _LINK_BYTES, "; is its unit of length right?" if shape else "")
    check_memory("stochastic.realisations", realisations, 16 * steps * realisations)
    check_memory("stochastic.library_cells", library_cells, 48 * steps * library_cells * paths)


def check_memory(key: str, given: object, needed: int, hint: str = "") -> None:
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
    """Input of the studies: the scene, its windows, the sampling of seals; and the history of the surface.

    continuation : of the spectrum of the face, None without. methods : to be run. seat : its form, "" where
    it is flat; form : that and its error. warnings : what is not plausible in the case.
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
    warnings: tuple[str, ...] = ()

    @property
    def studies(self) -> list[Study]:
        """The studies to be run, in the order in which they are solved."""
        return [study for study in STUDIES.values() if study.name in self.methods]

    @property
    def answer(self) -> Study:
        """The study whose leakage is the answer: the one farthest from the face itself."""
        return self.studies[-1]

    @property
    def shares_face(self) -> bool:
        """Whether two scales take the whole face from the deterministic solution of the same run."""
        return self.methods >= {"deterministic", "two-scale"}

    @property
    def options(self) -> StudyOptions:
        """The options of the studies."""
        return StudyOptions(self.cells, self.sampling, self.shares_face)

    def changed(self, change: ModelChange) -> Prepared:
        """The input with a change of the model."""
        sampling = self.sampling
        if change.seat is not None and sampling is not None:
            sampling = replace(sampling, pressure_map=SeatMap(change.seat))
        return replace(self, scene=change.scene, sampling=sampling)

    def solve(self, study: Study, mapper: Mapper, known: Mapping[str, Any] | None = None) -> Any:
        """Result of a study; `known` are the results of earlier studies of the same scene by key."""
        return study.solve(self.scene, self.options, known or {}, mapper)

    def cost(self, study: Study, efforts: Sequence[Effort] | None = None) -> tuple[float, float]:
        """Expected time on one core [s] and memory [byte] of a study.

        efforts : of each load step; usual ones unless given.
        """
        known = usual_efforts(len(self.scene.steps)) if efforts is None else efforts
        return study.cost(self.scene, self.options, known)

    @property
    def chosen(self) -> dict[str, Any]:
        """What is computed, and how, whether the case says so or leaves it to the program, as plain data."""
        scene = self.scene
        found: dict[str, Any] = {
            "methods": sorted(self.methods),
            "points": list(scene.surface.shape),
            "shortest wave": self.conditioning.shortest_wavelength,
            "discretisation": scene.discretisation,
            **({"seat": self.seat} if self.seat else {}),
            "solver": scene.solver,
        }
        if self.cells is not None and self.methods & {"two-scale", "stochastic"}:
            found["cells"] = list(self.cells)
        if self.sampling is not None:
            found["sampler"] = self.sampling.sampler
        return found

    @property
    def surface_report(self) -> dict[str, Any]:
        """The repair and conditioning of the surface, as plain data."""
        found = asdict(self.conditioning) | ({} if self.overlap is None else {"overlap": asdict(self.overlap)})
        if self.continuation is not None:
            found["continuation"] = asdict(self.continuation) | {"text": self.continuation_text}
        return found

    @property
    def continuation_text(self) -> str:
        """How the spectrum of the face is continued, and the wave at which hardness ends its effect; "" without."""
        if self.continuation is None:
            return ""
        wave = self.continuation.last_that_counts(self.scene.law.mean_hardness, self.scene.modulus)
        ends = (
            f"sets the area from {to_text(wave, 'm', 3)} on" if wave else "does not end what these waves do to the area"
        )
        return f"{self.continuation}; by Persson's theory hardness {ends}"


def without_short_waves(prepared: Prepared) -> Scene:
    """The scene without waves shorter than twice the shortest one, on half the points a side.

    Raises InputError: waves longer than the face would be left, or windows of fewer than 8 pixels.
    """
    scene, wave = prepared.scene, 2 * prepared.conditioning.shortest_wavelength
    surface = scene.surface
    if wave >= max(surface.size):
        expected = f"true only where the larger side holds more than {to_text(wave, 'm', 3)}, twice the shortest wave"
        raise InputError("surface.filter_sensitivity", True, expected)
    m1, m2 = prepared.cells or (1, 1)
    shape = next_multiple(ceil(surface.shape[0] / 2), m1), next_multiple(ceil(surface.shape[1] / 2), m2)
    if prepared.cells is not None:
        Partition(shape, surface.spacing, prepared.cells)
    return replace(scene, surface=surface.low_pass(wave).resample(shape))


def next_multiple(n: int, of: int) -> int:
    """The smallest multiple of a whole number that is at least n."""
    return ceil(n / of) * of
