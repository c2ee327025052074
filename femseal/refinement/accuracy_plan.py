"""Plan of an accuracy comparison: its solutions, their expected cost, and the reference."""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from math import log2, prod

from ..base import InputError, counted, duration, to_text
from ..case.case import Case
from ..preparation.preparation import prepare
from ..preparation.prepared import Pair, Prepared
from ..seal.layouts import RectangularLayout
from ..seal.pressure_map import Uniform
from ..studies import count_face_windows
from ..studies.costs import usual_efforts
from ..windows import Partition
from .coarser import with_points
from .settings import grid_points

#: Points along a side, and cells in the library, are halved so often. The shortest wave of a scene has at least 8
#: pixels, so 2 are left, which is what a grid can carry.
HALVINGS = (0, 1, 2)
#: Accuracy of a setting that is recommended, where the case asks for none.
DEFAULT_ACCURACY = 0.1
#: Windows have at least this many pixels a side, and hold this many of the shortest waves.
WINDOW_PIXELS, WINDOW_WAVES = 16, 2


@dataclass(frozen=True)
class Variant:
    """One solution of the scene: a method with its resolution, windows and library.

    points : of the surface. cells : windows; None: deterministic. library_cells : None unless stochastic.
    """

    method: str
    points: Pair
    cells: Pair | None = None
    library_cells: int | None = None

    @property
    def label(self) -> str:
        """Description in a line."""
        parts = [self.method, f"{by(self.points)} points"]
        parts += [f"{by(self.cells)} cells"] if self.cells else []
        parts += [f"library of {self.library_cells}"] if self.library_cells is not None else []
        return ", ".join(parts)

    @property
    def short(self) -> str:
        """Short description that distinguishes it from other references."""
        return self.method if self.cells is None else f"{self.method} {by(self.cells)}"

    def applied(self, prepared: Prepared, resampled: bool = True) -> Prepared:
        """The version of a prepared case that this is the solution of; its face as it is, unless `resampled`."""
        sampling = prepared.sampling
        if sampling is not None and self.library_cells is not None:
            sampling = replace(sampling, library_cells=self.library_cells, other_lengths=())
        version = with_points(prepared, self.points) if resampled else prepared
        return replace(version, cells=self.cells, sampling=sampling, methods=frozenset({self.method}))


@dataclass(frozen=True)
class Plan:
    """Solutions to be computed, the reference first.

    case, prepared : the problem. costs : expected seconds on one core and bytes of each variant.
    skipped : solutions that were left out, with reasons.
    companion : two scales of the case's own windows, unless they are the reference or not affordable: stochastic
        solutions are compared with it besides.
    """

    case: Case
    prepared: Prepared
    variants: tuple[Variant, ...]
    costs: tuple[tuple[float, float], ...]
    skipped: tuple[tuple[str, str], ...]
    companion: Variant | None

    @property
    def accuracy(self) -> float:
        """Wanted of a setting that is recommended: that of the case, as a fraction."""
        return DEFAULT_ACCURACY if self.case.accuracy is None else self.case.accuracy

    @property
    def reference(self) -> Variant:
        """Solution with which the others are compared."""
        return self.variants[0]

    @property
    def against(self) -> str:
        """Description of the reference of the errors."""
        if self.reference.method == "deterministic":
            return f"errors are against {self.reference.label}"
        return (
            f"the deterministic solution is not affordable: errors are against {self.reference.label}, "
            "and do not contain the error of two scales"
        )

    def lines(self) -> list[str]:
        """The plan as text."""
        total = sum(seconds for seconds, _ in self.costs)
        lines = [f"{counted(len(self.variants), 'solution')}, about {duration(total)} on one core; {self.against}"]
        lines += [
            f"  {variant.label}: about {duration(seconds)}, {to_text(memory, 'B', 3)}"
            for variant, (seconds, memory) in zip(self.variants, self.costs, strict=True)
        ]
        if not self.case.layout.has_length:
            lines.append(f"  stochastic seals are strips as long as the face, not {self.case.layout}")
        return lines + [f"  skipped: {what}: {reason}" for what, reason in self.skipped]


def make_plan(case: Case, *, limit: float, memory: float) -> Plan:
    """Plan the solutions of a case: three resolutions, three window sizes and three library sizes at most.

    One thing is varied at a time, from what the case says; two scales take part if the case has cells, the stochastic
    method if it has a table for it.

    limit, memory : solutions expected to take more seconds on one core, or more bytes, are skipped.

    Raises InputError: a face or cells that cannot be used; no affordable reference.
    """
    others = (("two-scale",) if case.cells else ()) + (("stochastic",) if case.cells and case.stochastic else ())
    prepared = _on_a_strip(prepare(case.model_copy(update={"compare": others})))
    known = usual_efforts(len(prepared.scene.steps))
    variants: list[Variant] = []
    costs: list[tuple[float, float]] = []
    skipped: list[tuple[str, str]] = []
    unaffordable: list[tuple[Variant, str]] = []
    for variant, reason in _candidates(prepared):
        if not isinstance(variant, Variant) or reason:
            skipped.append((variant.label if isinstance(variant, Variant) else variant, reason))
            continue
        version = variant.applied(prepared, resampled=False)
        cost = version.answer.cost(version.scene, version.options, known, variant.points)
        if cost[0] > limit or cost[1] > memory:
            expected = f"expected to take {duration(cost[0])} and {to_text(cost[1], 'B', 3)}"
            unaffordable.append((variant, expected))
            skipped.append((variant.label, f"{expected}, expected {duration(limit)} and {to_text(memory, 'B', 3)}"))
            continue
        variants.append(variant)
        costs.append(cost)
    points = prepared.scene.surface.shape
    references = [v for v in variants if v.method != "stochastic" and v.points == points]
    if not references:
        given = f"{duration(limit)} and {to_text(memory, 'B', 3)}"
        fit = [(v, e) for v, e in unaffordable if v.method != "stochastic" and v.points == points]
        expected = "; ".join(f"enough for {v.label}, {e}" for v, e in fit)
        raise InputError("limit, memory", given, expected)
    first = min(references, key=lambda v: (v.cells is not None, -prod(v.cells or (1, 1))))
    order = sorted(range(len(variants)), key=lambda n: variants[n] != first)
    base = [v for v in references if v.cells is not None and v.cells == prepared.cells]
    return Plan(
        case=case,
        prepared=prepared,
        variants=tuple(variants[n] for n in order),
        costs=tuple(costs[n] for n in order),
        skipped=tuple(skipped),
        companion=base[0] if base and base[0] != first else None,
    )


def _on_a_strip(prepared: Prepared) -> Prepared:
    """With strips as long as the face in place of seals of another shape, under one pressure, as the face compared."""
    sampling, scene = prepared.sampling, prepared.scene
    if sampling is None:
        return prepared
    sampling = replace(sampling, pressure_map=Uniform())
    if scene.layout.has_length:
        return replace(prepared, sampling=sampling)
    strip = replace(sampling, length=scene.surface.size[1])
    return replace(prepared, scene=replace(scene, layout=RectangularLayout()), sampling=strip)


def by(pair: Pair) -> str:
    """Two numbers as text.

    >>> by((8, 16))
    '8×16'
    """
    return f"{pair[0]}×{pair[1]}"


def _candidates(prepared: Prepared) -> Iterator[tuple[Variant | str, str]]:
    """Every possible solution, or a text for one that has no numbers, with the reason to leave it out ("": none)."""
    scene, cells, sampling = prepared.scene, prepared.cells, prepared.sampling
    points = scene.surface.shape
    grids = list(dict.fromkeys(grid_points(points, -n, cells) for n in HALVINGS))
    for grid in grids:
        yield Variant("deterministic", grid), ""
    if cells is None:
        return
    for grid in grids:
        yield Variant("two-scale", grid, cells), _window_fault(prepared, grid, cells)
    for ratio, name in ((0.5, "half"), (2.0, "double")):
        other = _scaled_cells(points, cells, ratio)
        if other is None:
            yield f"two-scale, {name} the {by(cells)} cells", f"no such divisors of {by(points)} points"
        else:
            yield Variant("two-scale", points, other), _window_fault(prepared, points, other)
    if sampling is None:
        return
    sizes = [sampling.library_cells // 2**n for n in HALVINGS]
    if sampling.pressure == "place":  # all windows of the face, however few are asked for
        partition = Partition(points, scene.surface.spacing, cells)
        sizes = [count_face_windows(replace(sampling, library_cells=size), partition) for size in sizes]
    for size in dict.fromkeys(sizes):
        yield Variant("stochastic", points, cells, size), "" if size else "a library of at least 1 is needed"


def _window_fault(prepared: Prepared, grid: Pair, cells: Pair) -> str:
    pixels = min(n // m for n, m in zip(grid, cells, strict=True))
    if pixels < WINDOW_PIXELS:
        return f"windows of {pixels} pixels, at least {WINDOW_PIXELS} are needed"
    window = min(length / m for length, m in zip(prepared.scene.surface.size, cells, strict=True))
    waves = window / prepared.conditioning.shortest_wavelength
    if waves < WINDOW_WAVES * (1 - 1e-9):
        return f"windows of {waves:.2g} shortest waves, at least {WINDOW_WAVES} are needed"
    return ""


def _scaled_cells(points: Pair, cells: Pair, ratio: float) -> Pair | None:
    """About `ratio` times the cells, by numbers that divide the points; None if there are none on an axis."""
    first, second = (_near_divisor(n, m, m * ratio) for n, m in zip(points, cells, strict=True))
    return None if first is None or second is None or (first, second) == cells else (first, second)


def _near_divisor(n: int, m: int, wanted: float) -> int | None:
    """Divisor of n nearest to the number wanted, unless m is as near; one cell is not halved."""
    if m == 1 and wanted < 1:
        return 1
    best = min((d for d in range(1, n + 1) if n % d == 0), key=lambda d: abs(log2(d / wanted)))
    return best if abs(log2(best / wanted)) < 0.5 else None
