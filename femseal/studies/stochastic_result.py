"""Result of the stochastic study: leakage of the drawn seals, and the one nearest to the median, with its fields."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import partial
from math import ceil
from typing import Any, ClassVar

import numpy as np

from ..base import Array, Shown, counted
from ..base.fields import CORNER, PART, PART_VECTOR, REALISATION, ROW, STEP, Field, declared
from ..library import LadderLibrary, draw_cells, draw_links, draw_pressures
from ..loads import LoadProgramme
from ..seal import Leakage, RectangularSeal
from ..seal.laid_windows import DrawnSeal, LinkWindows, SealWindows
from ..windows import Failed, Partition, SolverCounts, attempt
from .face_leakage import PlaceLeakage
from .load_curves import FLOOR, least_counted
from .run_chains import ChainedSeals, StateRuns
from .sampling_options import Sampling
from .scene import Scene
from .window_supply import FaceLibrary, TablePressures, Tables

#: Values of one field, parts times load steps, above which no fields are kept.
MOST_VALUES = 4_000_000
#: Relative error, as estimated, at which the leakage of a drawn seal has settled where permeabilities depend on the
#: pressure; it was within 1e-3 up to a fluid pressure of .95 of the load. Realisations differ by a percent.
DRAWN_RTOL = 3e-4
#: The same where the library is drawn again, whose error is several percent.
RESAMPLED_RTOL = 3e-3


@dataclass(frozen=True, repr=False)
class MedianSeal(Shown):
    """Fields of the realisation whose leakage is nearest to the median, over the parts of the seal.

    realisation : its number.
    outlines : corners of the parts (parts, corners, 2) [m]. permeability, fluid_pressure : (steps, parts), NaN at steps
        that failed, and the fluid pressure also in pockets.
    flux : volume rate per width at the fluid's reference density, in the plane of the seal (steps, parts, 2).
    pressure : mean contact pressure of the windows of every part (steps, parts).
    """

    realisation: int
    outlines: Array = declared(
        "drawn_corners", "m", "corners of the parts of the drawn seal, in its plane", CORNER, repr=False
    )
    permeability: Array = declared("drawn_permeability", "m^3", "permeability, median realisation", PART)
    fluid_pressure: Array = declared("drawn_fluid_pressure", "Pa", "fluid pressure, median realisation", PART)
    flux: Array = declared("drawn_flux", "m^2/s", "flow per width, median realisation", PART_VECTOR)
    pressure: Array | None = declared(
        "drawn_window_pressure", "Pa", "contact pressure of windows, median realisation", PART, default=None
    )


def drawn_permeability(
    seal_windows: SealWindows, kinds: tuple[Tables, ...], sampling: Sampling, realisation: int, at: TablePressures
) -> Callable[[int], Any]:
    """Permeability of a realisation at a step, as `seal_leakage` takes it.

    kinds : tables of the windows, one for each of the pressures.
    """
    which: dict[str, Any] = {"sampler": sampling.sampler_of_links, "seed": sampling.seed, "realisation": realisation}
    # windows whose two values belong together are drawn with the same random numbers
    axes = (0, 0) if seal_windows.together else (0, 1)
    # values of cells pay where they are no more than the links
    few = kinds[0][0].k[0].size <= kinds[0][0].path.size
    if few and len(kinds) > 1 and isinstance(seal_windows, LinkWindows) and not seal_windows.together:
        first, second = (draw_cells(t, **which, axis=axis) for t, axis in zip(kinds[0], axes, strict=True))
        if first is not None and second is not None:
            return lambda s: at.table([(a.k[s].ravel(), b.k[s].ravel()) for a, b in kinds], (first, second))
    draws = [[draw_links(t, **which, axis=axis) for t, axis in zip(tables, axes, strict=True)] for tables in kinds]
    return lambda s: at.table([seal_windows.permeability(along(s), across(s)) for along, across in draws])


def nearest_to_median(leakage: Array) -> int | None:
    """Realisation whose ln(leakage) (realisations, steps) is nearest to the median of all; None where none leaks.

    Steps at which all failed do not count.
    """
    size = np.abs(leakage[:, np.isfinite(leakage).any(axis=0)])
    whole = np.isfinite(size).all(axis=1)
    if not size.size or not whole.any():
        return None
    median = np.median(size[whole], axis=0)
    chosen = np.asarray(median > FLOOR * median.max())
    if not chosen.any():
        return None
    with np.errstate(divide="ignore"):
        distance = np.abs(np.log(size[:, chosen] / median[chosen])).mean(axis=1)
    return int(np.argmin(np.where(np.isnan(distance), np.inf, distance)))


def median_seal(
    realisation: int,
    *,
    scene: Scene,
    seal_windows: SealWindows,
    kinds: tuple[Tables, ...],
    sampling: Sampling,
    at: TablePressures,
    unsolved: frozenset[int],
) -> MedianSeal:
    """Draw a realisation again and solve its flow at every step but `unsolved`; kinds as in `drawn_permeability`."""
    permeability = drawn_permeability(seal_windows, kinds, sampling, realisation, at)
    outlines = seal_windows.outlines
    k, p, flux = (np.full((len(scene.steps), len(outlines), *plane), np.nan) for plane in ((), (), (2,)))
    for s in sorted({*range(len(scene.steps))} - unsolved):
        given = permeability(s)
        found = attempt(scene.leakage, seal_windows.seal, given, DRAWN_RTOL)
        if not isinstance(found, Failed):
            at_solution = given if found.permeability is None else found.permeability
            k[s], p[s] = seal_windows.shown(at_solution, found.fluid_pressure)
            potential = scene.fluid.potential(found.fluid_pressure) / scene.fluid.reference_density
            flux[s] = seal_windows.flux(at_solution, potential, _rate_of_power(scene, seal_windows.seal, found))
    sampler, seed = sampling.sampler_of_links, sampling.seed
    pressure = draw_pressures(kinds[0][0], sampler=sampler, seed=seed, realisation=realisation, axis=0)
    of_windows = None
    if pressure is not None:
        of_windows = np.array([seal_windows.means(pressure(s)) for s in range(len(scene.steps))])
        if (fluid := scene.acting_fluid) is not None and at.piecewise:
            of_windows = np.maximum(of_windows - np.nan_to_num(fluid.relief(p)), 0.0)
    return MedianSeal(realisation, outlines, k, p, flux, of_windows)


def _rate_of_power(scene: Scene, seal: Any, found: Leakage) -> float:
    """Leakage [m³/s] that dissipates as much over the highest drop as the flow between all boundaries does."""
    if found.boundary_rates is None:
        return found.volume_rate
    ends = seal.boundaries
    drops = scene.fluid.potential(ends.pressures) - scene.fluid.potential(scene.outlet_pressure)
    rates = [found.boundary_rates[name] for name in ends.names[: len(drops)]]
    return float(drops @ rates / np.abs(drops).max())


def median_chain(
    realisation: int,
    *,
    scene: Scene,
    partition: Partition,
    drawn: ChainedSeals,
    states: Sequence[StateRuns | Failed],
    pressure: Array,
) -> MedianSeal:
    """Fields of a chain of runs, whose windows have those that they have in the uncut face.

    The flux through every row of windows is scaled so that it carries the leakage of the chain.

    drawn : chains, of which this is one. states : `StateRuns` of every step, or `Failed`.
    pressure : mean contact pressure of the windows of the face (steps, m1, m2) [Pa].
    """
    (m1, m2), (d1, d2) = partition.cells, partition.window_size
    columns = drawn.windows(realisation, m2)
    outlines = LinkWindows(RectangularSeal((m1 * d1, columns.size * d2), (m1, columns.size))).outlines
    k, p, flux = (np.full((len(states), len(outlines), *plane), np.nan) for plane in ((), (), (2,)))
    for s, state in enumerate(states):
        if isinstance(state, Failed):
            continue
        k[s] = state.k[:, columns].ravel()
        p[s] = scene.pressure_at(state.potential[:, columns]).ravel()
        through = state.flux[:, columns]
        total = through[..., 0].mean(axis=1)
        scale = np.divide(drawn.leakage[realisation, s], total, out=np.zeros(m1), where=total > 0)
        flux[s] = (scale[:, None, None] * through).reshape(-1, 2)
    return MedianSeal(realisation, outlines, k, p, flux, pressure[:, :, columns].reshape(len(states), -1))


@dataclass(frozen=True, repr=False)
class StochasticResult(Shown):
    """Realisations of a seal drawn from a library. A realisation is a curve over the steps: arrays (realisation, step).

    leakage : of each realisation.
    leakage_resampled : of as many more realisations, each from a library that is drawn with repetition from the library
        itself, of as many windows as do not overlap. Their scatter is that of realisations and library together. None
        unless asked for, see `Sampling`.
    leakage_lower_bound, leakage_upper_bound : of the realisations in `leakage`, with the bounds of every window's
        permeability; None without bounds. They enclose the flow through gaps constant on each pixel: their distance
        says how well the pixels resolve the gaps.
    leakage_neumann_cuts, leakage_dirichlet_cuts : of the realisations in `leakage`, if nothing flows through the cuts
        between runs of columns, and if the fluid pressure has one profile along all of them; None unless the sampler is
        "runs". The leakage of a chain of these runs lies between them.
    leakage_of_face : of the face itself, whose runs they are; None unless the sampler is "runs".
    row_pressure, band_breadth, largest_row_pressure : of a seat that is broader than the face; None without.
    places : leakage by measured places; None of one, and with windows that have no place on the face.
    other_lengths : seals of the other lengths that were asked for, drawn from the same library; the same realisation of
        a longer seal begins with that of a shorter one.
    sampler, pressure : how they were drawn, and the source of their windows, see `Sampling`. window : pixels of a
        window along x1 and x2.
    median_seal : fields of the realisation nearest to the median; None of very large seals, and without leakage.
    failures : reasons of values that are NaN or left out. warnings : reasons to doubt the result.
    solvers : number of systems by solver, of library windows and of drawn seals. equal_steps : number of steps that are
        an earlier one again, solved once.
    """

    steps: LoadProgramme
    seal: DrawnSeal
    library: LadderLibrary | FaceLibrary = field(repr=False)
    leakage: Array = declared("leakage", "m^2/s", "leakage per unit seal length, realisations", REALISATION)
    leakage_resampled: Array | None = declared(
        "leakage_resampled", "m^2/s", "leakage per unit seal length, resampled library", REALISATION
    )
    leakage_lower_bound: Array | None = declared(
        "leakage_lower_bound", "m^2/s", "lower bound of leakage per unit seal length", REALISATION, default=None
    )
    leakage_upper_bound: Array | None = declared(
        "leakage_upper_bound", "m^2/s", "upper bound of leakage per unit seal length", REALISATION, default=None
    )
    leakage_neumann_cuts: Array | None = declared(
        "leakage_closed_cuts", "m^2/s", "leakage per unit seal length, Neumann cuts", REALISATION, default=None
    )
    leakage_dirichlet_cuts: Array | None = declared(
        "leakage_held_cuts", "m^2/s", "leakage per unit seal length, Dirichlet cuts", REALISATION, default=None
    )
    leakage_of_face: Array | None = declared(
        "leakage_of_face", "m^2/s", "leakage per unit seal length, of the face that the runs are of", STEP, default=None
    )
    row_pressure: Array | None = declared(
        "row_pressure", "Pa", "mean contact pressure of rows", ROW, default=None, repr=False
    )
    band_breadth: Array | None = declared(
        "band_breadth", "m", "breadth of the band in contact", STEP, default=None, repr=False
    )
    largest_row_pressure: Array | None = declared(
        "largest_row_pressure", "Pa", "largest mean contact pressure of a row", STEP, default=None, repr=False
    )
    places: PlaceLeakage | None = field(default=None, repr=False)
    other_lengths: tuple[StochasticResult, ...] = field(default=(), repr=False)
    sampler: str = "history"
    pressure: str = "place"
    window: tuple[int, int] = (1, 1)
    median_seal: MedianSeal | None = field(default=None, repr=False)
    failures: tuple[str, ...] = ()
    warnings: tuple[str, ...] = ()
    solvers: SolverCounts = field(default_factory=SolverCounts)
    equal_steps: int = 0

    computed_fields: ClassVar[dict[str, Field]] = {
        "mean": Field("leakage_mean", "m^2/s", "leakage per unit seal length, mean of the realisations", STEP),
        "realisation_spread": Field("realisation_spread", "1", "standard deviation of ln(leakage), realisations", STEP),
        "cut_error": Field(
            "cut_error", "1", "half the distance of ln(leakage) with Dirichlet and with Neumann cuts between runs", STEP
        ),
        "sealed_fraction": Field(
            "sealed_fraction", "1", "fraction of the realisations without leakage", STEP, "sealed [%]"
        ),
    }

    def quantile(self, q: float, *, resampled: bool = False) -> Array:
        """Quantile over the realisations that did not fail, at every step [m²/s]; NaN where all failed.

        Between two values of one sign it is interpolated in log space; beside a 0 it is 0. `resampled` takes
        `leakage_resampled`, whose scatter includes the error of the library; NaN without.
        """
        chosen = self.leakage
        if resampled:
            chosen = np.full_like(chosen, np.nan) if self.leakage_resampled is None else self.leakage_resampled
        return self._at_every_step(partial(_quantile, q=q), chosen)

    @property
    def without_place(self) -> Array | None:
        """Leakage of all measured places but each (places, steps) [m²/s]; None of fewer than three."""
        return None if self.places is None else self.places.without

    @property
    def mean(self) -> Array:
        """Mean over the realisations that did not fail, at every step [m²/s]; NaN where all failed."""
        return self._at_every_step(np.mean)

    @property
    def sealed_fraction(self) -> Array:
        """Fraction without leakage of the realisations that did not fail, at every step; NaN where all failed."""
        return self._at_every_step(lambda leakage: np.mean(leakage == 0))

    @property
    def realisation_spread(self) -> Array:
        """Standard deviation of ln(leakage) between realisations, at every step; NaN where fewer than 2 leak."""
        return self._at_every_step(_log_deviation)

    @property
    def library_error(self) -> Array:
        """Standard deviation of ln(leakage) that the finite library adds, at every step; NaN where fewer than 2
        leak, or without resampled seals."""
        if self.leakage_resampled is None:
            return np.full(len(self.steps), np.nan)
        together = self._at_every_step(_log_deviation, self.leakage_resampled)
        return np.sqrt(np.maximum(together**2 - self.realisation_spread**2, 0.0))

    def needed(self, width: float) -> tuple[int, int]:
        """Number of realisations and of library windows without overlap for a standard error `width`.

        The error is that of ln(median leakage), at all steps that leak more than 1e-3 of the first. Realisations and
        library may each cause half of the variance.
        """
        median = self.quantile(0.5)
        chosen = np.abs(median) > least_counted(median)
        if not chosen.any():
            return len(self.leakage), self.library.independent
        # the median of n normal numbers scatters by 1.2533 σ/√n
        realisations = 2 * (1.2533 * float(np.nanmax(self.realisation_spread[chosen], initial=0)) / width) ** 2
        windows = 2 * self.library.independent * (float(np.nanmax(self.library_error[chosen], initial=0)) / width) ** 2
        return max(2, ceil(realisations)), max(1, ceil(windows))

    @property
    def cut_error(self) -> Array | None:
        """Half the distance of ln(leakage) with Dirichlet and with Neumann cuts, at every step; None unless of runs.

        It is inf where no run leaks by itself, NaN without leakage.
        """
        if self.leakage_neumann_cuts is None or self.leakage_dirichlet_cuts is None:
            return None
        cuts = self.leakage_neumann_cuts, self.leakage_dirichlet_cuts
        neumann, dirichlet = (self._at_every_step(np.mean, leakage) for leakage in cuts)
        with np.errstate(divide="ignore", invalid="ignore"):
            return np.asarray(0.5 * np.log(dirichlet / neumann))

    def too_few(self, *quantiles: float) -> str:
        """A warning with the number of realisations that the quantiles need, if there are fewer; otherwise ""."""
        tails = [min(q, 1 - q) for q in quantiles if 0 < q < 1]
        needed = ceil(max((1 / tail for tail in tails), default=1) - 1e-9)
        if len(self.leakage) >= needed:
            return ""
        named = " and ".join(f"{q:g}" for q in quantiles)
        return f"quantile {named} of {counted(len(self.leakage), 'realisation')}: at least {needed} needed"

    def unsupported(self, q: float) -> tuple[str, ...]:
        """Reasons not to trust a quantile: too few realisations, or a library that scatters more than the tail."""
        reasons = [text] if (text := self.too_few(q)) else []
        with np.errstate(divide="ignore", invalid="ignore"):
            distance = np.abs(np.log(self.quantile(q) / self.quantile(0.5)))
        weak = [s.name for s, d, e in zip(self.steps, distance, self.library_error, strict=True) if e > max(d, 0.1)]
        if weak:
            reasons.append(
                f"quantile {q:g}: the error of {counted(self.library.independent, 'library window')} is larger than "
                f"the band at {weak[0]}" + (f" and {counted(len(weak) - 1, 'more step')}" if len(weak) > 1 else "")
            )
        return tuple(reasons)

    def _at_every_step(self, statistic: Callable[[Array], Any], leakage: Array | None = None) -> Array:
        finite = [column[np.isfinite(column)] for column in (self.leakage if leakage is None else leakage).T]
        return np.array([statistic(column) if column.size else np.nan for column in finite])


def _quantile(values: Array, q: float) -> float:
    low, high = (float(np.quantile(values, q, method=end)) for end in ("lower", "higher"))
    weight = (values.size - 1) * q % 1
    if low == 0 or high == 0:
        return 0.0
    if (low > 0) != (high > 0):
        return low + weight * (high - low)
    return float(np.sign(low)) * abs(low) ** (1 - weight) * abs(high) ** weight


def _log_deviation(values: Array) -> float:
    size = np.abs(values[values != 0])
    return float(np.std(np.log(size), ddof=1)) if size.size > 1 else np.nan
