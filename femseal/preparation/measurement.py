"""Check a measured surface: measured waves that the filter removes, noise that remains, and the form deviation."""

from collections.abc import Iterator

from ..base import to_text
from ..case.case import Case
from ..case.faces import FileFace
from ..studies import Scene
from ..topography import Conditioning, Surface, resolving_shape

#: A warning is given if the filter removes more than this fraction of the rms slope. A turned surface leaked 10 to 700
#: times less when 49 % of its rms slope was removed.
_LOST_SLOPE = 0.1
#: A warning is given if more than this fraction of the rms slope is noise.
_NOISE_SLOPE = 0.25
#: Largest number of loads at which the effect of the form deviation on the leakage is computed.
_FORM_LOADS = 4


def is_measured(case: Case, surface: Surface) -> bool:
    """Return True if the surface is not flat and at least one of its faces was measured."""
    return bool(surface.rms_slope) and any(isinstance(table, FileFace) for table in case.face)


def form_check_pressures(case: Case, scene: Scene) -> tuple[float, ...]:
    """Choose the nominal pressures [Pa] at which the effect of the form deviation of a measured patch is computed.

    The chosen pressures are up to four of the load steps on loading. The result is empty if the case itself defines the
    form deviation: by the key `detrend`, by a seat, or by the form of the whole seal.
    """
    loads = [pressure for pressure in scene.steps.loading if pressure > 0]
    defines_form = case.seat.kind != "flat" or bool(case.seal.form)
    if not loads or defines_form or "detrend" in case.surface.model_fields_set:
        return ()
    # the first load, the last load, and two loads at about equal distances between them in the list
    last = len(loads) - 1
    indices = [n * last // (_FORM_LOADS - 1) for n in range(_FORM_LOADS)]
    return tuple(sorted({loads[index] for index in indices}))


def filter_warnings(case: Case, surface: Surface, conditioning: Conditioning) -> Iterator[str]:
    """Warn if the filter removes a large part of the measured slope, or if much noise remains in the surface."""
    if case.surface.continue_spectrum is not None:
        return
    # shortest wavelength above the noise of the measurement, and shortest wavelength after filtering
    measured = to_text(conditioning.shortest_measured, "m", 3)
    after = to_text(conditioning.shortest_wave, "m", 3)
    # If the instrument limits the waves, the description of the surface says so.
    is_limited_by_instrument = conditioning.shortest_wave == conditioning.shortest_seen
    if not is_limited_by_instrument and conditioning.lost_slope > _LOST_SLOPE:
        size = surface.shortest_patch.size
        points = list(resolving_shape(size, conditioning.shortest_measured))
        remedy = f"set surface.points = {points}"
        if case.surface.shortest_wave is not None:
            also = " and surface.points" if case.surface.points else ""
            remedy = f"leave out surface.shortest_wave{also}"
        yield (
            f"The leakage may be wrong by large factors: the low-pass at {after} removes {conditioning.lost_slope:.0%} "
            f"of the rms slope of the face, whose waves down to {measured} stand above noise. To keep them {remedy}"
        )
    if not conditioning.rms_slope:
        return
    noise = 1 - conditioning.rms_slope_measured / conditioning.rms_slope
    if noise > _NOISE_SLOPE:
        yield (
            f"The surface is rougher than measured: {noise:.0%} of the rms slope comes from waves of {after} to "
            f"{measured}, which are noise or beyond the instrument. surface.shortest_wave = '{measured}' removes them"
        )
