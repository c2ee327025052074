"""Plan of an accuracy comparison: its solutions, their expected cost, and the reference."""

from collections.abc import Iterator
from dataclasses import dataclass, replace

from ..base import InputError, counted, duration, to_text
from ..case.case import Case
from ..face.pieces import FEWEST_POINTS
from ..preparation.preparation import prepare
from ..preparation.prepared import Pair, Prepared
from ..seal.layouts import RectangularLayout
from ..seal.pressure_map import Uniform
from ..studies.costs import usual_efforts
from .coarser import with_points
from .settings import grid_points

#: Points along a side are halved so often. The shortest wave of a scene has at least 8 pixels, so 2 are left, which is
#: what a grid can carry.
HALVINGS = (0, 1, 2)
#: Accuracy of a setting that is recommended, where the case asks for none.
DEFAULT_ACCURACY = 0.1


@dataclass(frozen=True)
class Variant:
    """One solution of the scene: a method with its resolution and its pieces.

    points : of the surface. pieces : from which seals are drawn; None: deterministic.
    """

    method: str
    points: Pair
    pieces: Pair | None = None

    @property
    def label(self) -> str:
        """Description in a line."""
        parts = [self.method, f"{by(self.points)} points"]
        parts += [f"{by(self.pieces)} pieces"] if self.pieces else []
        return ", ".join(parts)

    def applied(self, prepared: Prepared, resampled: bool = True) -> Prepared:
        """The version of a prepared case that this is the solution of; its face as it is, unless `resampled`."""
        version = with_points(prepared, self.points) if resampled else prepared
        return replace(version, methods=frozenset({self.method}))


@dataclass(frozen=True)
class Plan:
    """Solutions to be computed, the reference first.

    case, prepared : the problem. costs : expected seconds on one core and bytes of each variant.
    skipped : solutions that were left out, with reasons.
    """

    case: Case
    prepared: Prepared
    variants: tuple[Variant, ...]
    costs: tuple[tuple[float, float], ...]
    skipped: tuple[tuple[str, str], ...]

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
        return f"errors are against {self.reference.label}"

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
    """Plan the solutions of a case: three resolutions at most of each method.

    The stochastic method takes part if the case has a table for it.

    limit, memory : solutions expected to take more seconds on one core, or more bytes, are skipped.

    Raises InputError: a face or cells that cannot be used; the reference is not affordable.
    """
    others = ("stochastic",) if case.stochastic else ()
    prepared = _on_a_strip(prepare(case.model_copy(update={"compare": others})))
    known = usual_efforts(len(prepared.scene.steps))
    variants: list[Variant] = []
    costs: list[tuple[float, float]] = []
    skipped: list[tuple[str, str]] = []
    for variant, reason in _candidates(prepared):
        if reason:
            skipped.append((variant.label, reason))
            continue
        version = variant.applied(prepared, resampled=False)
        cost = version.answer.cost(version.scene, version.options, known, variant.points)
        if cost[0] > limit or cost[1] > memory:
            expected = f"expected to take {duration(cost[0])} and {to_text(cost[1], 'B', 3)}"
            given = f"{duration(limit)} and {to_text(memory, 'B', 3)}"
            if not variants:  # the reference
                raise InputError("limit, memory", given, f"enough for {variant.label}, {expected}")
            skipped.append((variant.label, f"{expected}, expected {given}"))
            continue
        variants.append(variant)
        costs.append(cost)
    return Plan(case, prepared, tuple(variants), tuple(costs), tuple(skipped))


def _on_a_strip(prepared: Prepared) -> Prepared:
    """With strips as long as the face in place of seals of another shape, under one pressure, as the face compared."""
    sampling, scene = prepared.sampling, prepared.scene
    if sampling is None:
        return prepared
    strip = replace(sampling, pressure_map=Uniform(), length=scene.surface.size[1], breadth=None)
    if not scene.layout.has_length:
        scene = replace(scene, layout=RectangularLayout())
    return replace(prepared, scene=scene, sampling=strip)


def by(pair: Pair) -> str:
    """Two numbers as text.

    >>> by((8, 16))
    '8×16'
    """
    return f"{pair[0]}×{pair[1]}"


def _candidates(prepared: Prepared) -> Iterator[tuple[Variant, str]]:
    """Every possible solution, the reference first, with the reason to leave it out ("": none)."""
    points, pieces = prepared.scene.surface.shape, prepared.cells
    grids = [*dict.fromkeys(grid_points(points, -n) for n in HALVINGS)]
    for grid in grids:
        yield Variant("deterministic", grid), ""
    if pieces is None or prepared.sampling is None:
        return
    for grid in grids:
        few = min(n // m for n, m in zip(grid, pieces, strict=True)) < FEWEST_POINTS
        yield Variant("stochastic", grid, pieces), f"pieces of fewer than {FEWEST_POINTS} points" if few else ""
