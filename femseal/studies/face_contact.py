"""Contact of all windows of a face: cut from that of the whole face where that is affordable.

Else each window is solved under the pressure that the contact of the low-pass face gives it.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from math import floor, log2
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..base import Array, InputError, Mapper, Stage
from ..base.machine import total_memory
from ..base.shared_array import give_back, one_at_a_time, shared_empty
from ..contact import HalfSpace, LoadState
from ..loads import LoadProgramme
from ..topography import Topography
from ..windows import Failed, FlowSettings, GlobalState, Partition, attempt, contact_history
from ..windows.partition import ContactPressure, ContactValues, WindowFields
from ..windows.window_contact import ContactHistory, body_standoff, corrected_gap, relative_difference, separate
from .choices import CONTACTS
from .face_flow import FaceFlow, resolved_flow
from .face_leakage import FaceLeakage, face_leakage
from .fluid_coupling import CoupledContact
from .scene import Scene

#: Wavelength that divides the scales, in window sides: longer ones lose the pressure of features within windows.
CUT_OFF_WINDOWS = 0.25
#: Errors of the gap above which a run warns. Measured: 0.04 goes with leakages off by 1.0 to 1.2, 0.1 with 1.5.
GAP_WARNING = 0.05
#: Errors of the gap from which on its effect on the leakage is solved for: below, leakages were off by 0.3 % at most.
FLOW_ERROR = 0.003
#: Factor of the leakage above which a run warns.
LEAKAGE_WARNING = 1.1
#: Number of fields over all points that the error of a contact needs; measured 12.6 to 15.4 on 1024² to 3072² points.
ERROR_FIELDS = 15
#: Fraction of the fine waves' rms in profiles along either axis above which windows do not resolve a face's ridges.
#: Measured on turned faces: 0.3 goes with factors of 1.1, 0.38 with 1.2 to 1.7, 0.55 with 1.5 to 4; self-affine 0.1.
RIDGE_WARNING = 0.35


@dataclass(frozen=True, eq=False)
class WindowContacts:
    """Contact of all cells of a face along a cycle; arrays (steps, m1, m2) as in `TwoScaleResult`.

    contact : how it was solved, see `choices.CONTACTS`. gap_error : at every step (steps,), see
    `windows.gap_error`; 0 for the contact of the whole face. gap_effect : flow through the gap over that through the
    corrected one (steps,): 1 where the error is small, inf where the corrected gap is closed. row_pressure : mean
    contact pressure of rows of pixels (steps, n1) [Pa]. carried_pressure : mean pressure that the fluid carries
    (steps,) [Pa]. through : flow at full resolution with which the contact was solved. unsolved : steps without a gap,
    where the faces part, by their number, and why.
    """

    contact: str
    fields: WindowFields
    gap_error: Array
    gap_effect: Array
    pressure: Array
    mean_gap: Array
    contact_fraction: Array
    plastic_fraction: Array
    row_pressure: Array
    carried_pressure: Array | None = None
    through: FaceLeakage | None = field(default=None, repr=False)
    unsolved: tuple[tuple[int, str], ...] = ()
    failures: tuple[str, ...] = ()
    warnings: tuple[str, ...] = ()


def windows_contact(scene: Scene, cells: tuple[int, int], mapper: Mapper) -> WindowContacts:
    """Solve the contact of every cell with all its waves, under the mean pressure that the global contact gives it.

    A cell starts from the gap that the global pressure of the other cells leaves. The standoff of the
    loaded cells separates cells without pressure from the face.
    """
    scene.check_one_place("contact", "windows", "whole")
    surface, steps, fluid = scene.surface, scene.steps, scene.acting_fluid
    partition = face_partition(surface, cells)
    cut_off = CUT_OFF_WINDOWS * min(partition.window_size)
    body = HalfSpace(partition.window, partition.spacing, scene.modulus, ("mirror", "mirror"))
    # undeformed gap of the waves shorter than the cut-off, its mean plane at 0
    fine = surface.low_pass(cut_off).heights - surface.heights
    warnings = _unresolved_ridges(surface.heights + fine, fine, partition)
    fine = fine.astype(np.float32)
    # one array for all pixels and steps: the gap that a cell starts from, and in its place the solved gap
    gap = shared_empty((len(steps), *surface.shape), np.float32)
    pressure = np.empty((len(steps), *cells))
    take = partial(_outer, partition=partition, body=body)
    for s, (outer_gap, cell_pressure) in enumerate(
        scene.global_states(partition, cut_off, take=take, fluid=fluid, mapper=mapper)
    ):
        gap[s], pressure[s] = outer_gap, cell_pressure
    solve = partial(_respond, steps=steps, half_space=body, law=scene.uniform_law, rigid_at_zero=True, rtol=scene.rtol)
    histories = mapper(
        Stage("contact of windows", solve),
        (partition.cell(gap, *place) for place in partition.places),
        (partition.cell(fine, *place) for place in partition.places),
        [pressure[:, i, j] for i, j in partition.places],
    )
    standoff, lowest, contact_fraction, plastic_fraction = (np.empty(pressure.shape) for _ in range(4))
    in_contact, failures = [], []
    for (i, j), history in zip(partition.places, histories, strict=True):
        partition.cell(gap, i, j)[:] = history.gap
        in_contact.append(history.contact)
        lowest[:, i, j], standoff[:, i, j] = history.gap.min(axis=(1, 2)), history.standoff
        contact_fraction[:, i, j], plastic_fraction[:, i, j] = history.contact_fraction, history.plastic_fraction
        failures += [f"cell {(i, j)}, {text}" for text in history.failures]
    distance = body_standoff(standoff, pressure, lowest)
    for s, i, j in np.argwhere(np.isnan(standoff) & np.isfinite(lowest)):
        window = partition.cell(gap[s], i, j)
        window[:] = separate(window, distance[s])
    fields = WindowFields(steps, partition, gap, ContactPressure(partition, tuple(in_contact)))
    error, factor = _errors(scene, fields, mapper)
    return WindowContacts(
        contact="windows",
        fields=fields,
        gap_error=error,
        gap_effect=factor,
        pressure=pressure,
        mean_gap=np.array([partition.cell_means(g) for g in gap]),
        contact_fraction=contact_fraction,
        plastic_fraction=plastic_fraction,
        row_pressure=np.array([p.mean(axis=1) for p in fields.pressure]),
        carried_pressure=np.full(len(steps), 0.0 if fluid is None else fluid.carried),
        unsolved=scene.parted_steps,
        failures=tuple(failures),
        warnings=warnings + _contact_warnings(steps, error, factor),
    )


def face_partition(surface: Topography, cells: tuple[int, int]) -> Partition:
    """The windows of a face, and the lines of nodes in the valleys of its long waves."""
    size = Partition(surface.shape, surface.spacing, cells).window_size
    return Partition.through_valleys(surface, cells, CUT_OFF_WINDOWS * min(size))


def _errors(scene: Scene, fields: WindowFields, mapper: Mapper) -> Array:
    """`gap_error` of every step, and the factor by which it changes the leakage (2, steps)."""
    surface, steps = scene.surface, scene.steps
    undeformed, fluid = -surface.heights, scene.acting_fluid
    if fluid is not None:
        undeformed += scene.half_space.displacement(fluid.even_drop(surface.shape))
    body = {"undeformed": undeformed, "half_space": scene.half_space, "law": scene.law}
    estimate = partial(_error, spacing=surface.spacing, body=body)
    peaks = (
        fields.pressure[int(peak)] if unloads else None
        for peak, unloads in zip(steps.peak_indices, steps.on_unloading, strict=True)
    )
    stage = Stage("error of the contact", estimate, 8.0 * ERROR_FIELDS * surface.heights.size)
    return np.array(list(mapper(stage, fields.gap, iter(fields.pressure), peaks))).T


def _error(
    gap: NDArray[np.float32],
    pressure: NDArray[np.float32],
    peak_pressure: NDArray[np.float32] | None = None,
    *,
    spacing: tuple[float, float],
    body: dict[str, Any],
) -> tuple[float, float]:
    """`gap_error`, and the flow through the gap over that through the corrected one: 1 where the error is small."""
    corrected = corrected_gap(gap, pressure, peak_pressure, **body)
    if corrected is None:
        return np.nan, np.nan
    error = relative_difference(gap, corrected)
    if error < FLOW_ERROR:
        return error, 1.0
    stitched, whole = (attempt(resolved_flow, g, spacing) for g in (gap, corrected))
    if isinstance(stitched, Failed) or isinstance(whole, Failed):
        return error, np.nan
    if whole.permeability == 0.0:
        return error, np.inf if stitched.permeability else 1.0
    return error, stitched.permeability / whole.permeability


def _contact_warnings(steps: LoadProgramme, error: Array, factor: Array) -> tuple[str, ...]:
    """Warn where the estimated error of the gap changes the leakage, or is large; the worst step is named."""
    with np.errstate(divide="ignore"):
        off = np.nan_to_num(np.exp(np.abs(np.log(factor))), nan=1.0, posinf=np.inf)
    if (off > LEAKAGE_WARNING).any():
        worst = int(np.argmax(off))
        effect = f"changes the leakage by a factor of {factor[worst]:.2g}"
        if not 0 < factor[worst] < np.inf:
            effect = "closes the seal" if factor[worst] == 0 else "opens a seal that is closed"
    elif (error > GAP_WARNING).any():
        worst = int(np.nanargmax(error))
        effect = "hardly changes the leakage"
    else:
        return ()
    size = f"{error[worst]:.0%}" if error[worst] >= 0.02 else f"{error[worst]:.1%}"
    text = (
        f"contact of windows: their gap is off by {size} at {steps[worst].name}, which {effect}: "
        'take contact = "whole" or the method "deterministic"'
    )
    return (text,)


def _outer(state: GlobalState, partition: Partition, body: HalfSpace) -> tuple[NDArray[np.float32], Array]:
    """The parts of a global state that windows start from."""
    return state.outer_gap(partition, body), state.pressure


def _respond(
    outer_gap: NDArray[np.float32], fine: NDArray[np.float32], pressures: Array, **settings: Any
) -> ContactHistory:
    """`contact_history` of a window from its outer gap (steps, n1, n2) plus its fine waves (n1, n2)."""
    return contact_history(np.add(outer_gap, fine, dtype=float), pressures, **settings)


def _unresolved_ridges(smooth: Array, fine: Array, partition: Partition) -> tuple[str, ...]:
    """Warn if windows are too large to resolve the ridges of a face with a lay."""
    carried, fraction = (max(z.mean(axis=axis).std() for axis in (0, 1)) / (z.std() or 1.0) for z in (smooth, fine))
    if fraction <= RIDGE_WARNING or carried <= RIDGE_WARNING or not 0.05 < fine.std() / (smooth.std() or np.inf) < 1:
        return ()
    size = " × ".join(f"{length * 1e6:.3g}" for length in partition.window_size)
    text = (
        f"windows of {size} µm do not resolve the ridges of the face ({fraction:.0%} of what is left to them is in "
        'straight ridges): leakage may be off by a factor of 2; take contact = "whole" or smaller windows'
    )
    return (text,)


#: Memory of the contact of a whole face, whose states may lie on disk, and how much of a machine's it may take
#: [byte per pixel, 1]. Measured on 512² to 2048² pixels, it takes 0.5 to 1.9 times as long as windows.
_WHOLE_BYTES, _PART_OF_MEMORY = 150.0, 0.8


def whole_pixels() -> int:
    """Largest number of pixels of a face whose contact is solved as a whole unless chosen otherwise.

    A power of two, so that machines of about the same memory choose alike: 8192² pixels for 13 to 25 GB.
    """
    return int(2 ** floor(log2(_PART_OF_MEMORY * total_memory() / _WHOLE_BYTES)))


def chosen_contact(contact: str | None, shape: tuple[int, int]) -> str:
    """The contact given, or the one that suits the number of pixels of a face and the memory of the machine.

    Raises InputError: a contact that does not exist.
    """
    if contact is None:
        return "whole" if shape[0] * shape[1] <= whole_pixels() else "windows"
    if contact not in CONTACTS:
        raise InputError("contact", contact, f"one of {', '.join(CONTACTS)}")
    return contact


def solve_windows(
    scene: Scene, cells: tuple[int, int], contact: str | None = None, *, mapper: Mapper = map
) -> WindowContacts:
    """Solve the contact of a face and divide it into windows.

    contact : "whole": the contact of the whole face at full resolution, as in the deterministic study, cut into
        windows. "windows": the contact of each window, under the mean pressure that the contact of the low-pass face
        gives it (Pérez-Ràfols et al., 2018); its error is estimated, see `windows.gap_error`. Unless given, "whole" up
        to `whole_pixels`.
    """
    if chosen_contact(contact, scene.contact_shape) == "windows":
        return windows_contact(scene, cells, mapper)
    partition = face_partition(scene.surface, cells)
    return cut_contact(scene, partition, solve_face(scene, partition, scene.acting_fluid is not None, mapper=mapper))


@dataclass(frozen=True, eq=False)
class FaceStates:
    """Contact of the whole face at every step: gap (steps, n1, n2) [m], states, and leakage where flow was solved."""

    gap: NDArray[np.float32]
    states: Sequence[FaceState]
    through: FaceLeakage | None


def solve_face(
    scene: Scene, partition: Partition, with_flow: bool, *, memory: float | None = None, mapper: Mapper
) -> FaceStates:
    """Solve the contact of the whole face at every step, and the flow through it where asked for.

    Where the states are large they lie on disk, see `shared_array`, and one takes memory.
    """
    gap = shared_empty((len(scene.steps), *scene.surface.shape), np.float32)
    states: list[FaceState] = []
    take = partial(FaceState.of, partition=partition, flow=scene.flow if with_flow else None)

    def flows() -> Iterator[Any]:
        """Flow of every step; gap and contact are put aside."""
        for s, state in enumerate(scene.contact_states(take, memory=memory, mapper=mapper)):
            gap[s] = state.gap
            failed = state.flow.reason if isinstance(state.flow, Failed) else ""
            kept = ContactValues.put_aside(state.in_contact, gap)
            states.append(replace(state, gap=gap[s], in_contact=kept, flow=None, failed=failed))
            give_back(gap)
            yield state.flow

    if with_flow:
        return FaceStates(gap, states, face_leakage(scene, flows()))
    for _ in flows():
        pass
    return FaceStates(gap, states, None)


@dataclass(frozen=True, eq=False)
class FaceState:
    """The contact of the whole face at one step, cut into windows, and the flow through it.

    gap : (n1, n2) [m]. in_contact : the pressure of every window. means : pressure [Pa], fraction in contact and
    fraction at the hardness of every window (3, m1, m2). rows : mean pressure of rows (n1,) [Pa]. facts : fraction in
    contact, fraction at the hardness, mean gap [m] and residual of the whole face, and the mean pressure that the fluid
    carries [Pa]. flow : None unless asked for. failed : why there is none.
    """

    gap: NDArray[np.float32]
    in_contact: tuple[ContactValues, ...]
    means: Array
    rows: Array
    facts: tuple[float, float, float, float, float]
    flow: FaceFlow | Failed | None
    failed: str = ""

    @classmethod
    def of(cls, state: LoadState, partition: Partition, flow: FlowSettings | None = None) -> FaceState:
        """Cut the contact of a step into windows, and solve the flow through its gap where `flow` says how."""
        contact = state.contact
        p, spacing = contact.pressure, contact.half_space.spacing
        found, carried = None, 0.0
        if isinstance(contact, CoupledContact):
            found, carried = contact.flow, contact.carried
        elif flow is not None:
            found = attempt(resolved_flow, contact.gap, spacing, flow, with_potential=True)
        return cls(
            gap=contact.gap.astype(np.float32),
            in_contact=tuple(ContactValues.of(partition.cell(p, *place)) for place in partition.places),
            means=np.array([partition.cell_means(values) for values in (p, p > 0, contact.plastic)]),
            rows=p.mean(axis=1),
            facts=(contact.area_fraction, contact.plastic_fraction, contact.mean_gap, contact.residual, carried),
            flow=found,
        )


def band_breadth(row_pressure: Array, spacing: float) -> Array:
    """Distance of the first row in contact from the last, both included (steps,) [m]; row_pressure (steps, n1) [Pa]."""
    touching = row_pressure > 0
    n1 = touching.shape[1]
    between = n1 - touching.argmax(axis=1) - touching[:, ::-1].argmax(axis=1)
    return np.where(touching.any(axis=1), between, 0) * spacing


def cut_contact(scene: Scene, partition: Partition, face: FaceStates) -> WindowContacts:
    """The contact of windows from that of the whole face."""
    gap, states = face.gap, face.states
    pressure, contact_fraction, plastic_fraction = np.array([state.means for state in states]).swapaxes(0, 1)
    # the fields of every window at all steps
    in_contact = tuple(zip(*(state.in_contact for state in states), strict=True))
    return WindowContacts(
        contact="whole",
        fields=WindowFields(scene.steps, partition, gap, ContactPressure(partition, in_contact)),
        gap_error=np.zeros(len(states)),
        gap_effect=np.ones(len(states)),
        pressure=pressure,
        mean_gap=np.array([partition.cell_means(g) for g in one_at_a_time(gap)]),
        contact_fraction=contact_fraction,
        plastic_fraction=plastic_fraction,
        row_pressure=np.array([state.rows for state in states]),
        carried_pressure=np.array([state.facts[-1] for state in states]),
        through=None if scene.acting_fluid is None else face.through,
        unsolved=tuple(
            (s, state.failed) for s, state in enumerate(states) if state.failed and scene.acting_fluid is not None
        ),
    )
