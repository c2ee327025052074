"""Survey a measured surface before a run: describe, repair and filter the surface.

For a surface that a run would reject, the survey states the reason and describes the measured heights.
"""

from dataclasses import dataclass, replace
from math import degrees, isnan, pi
from pathlib import Path
from textwrap import indent
from typing import Any

from ..base import InputError, as_text, to_si, to_text, validate, write_bytes, writing
from ..checks import FormEffect, estimate_surface, solve_form_effect
from ..contact.linear_laws import PerfectlyPlastic
from ..plots import rendered, survey_figure
from ..topography import (
    Conditioning,
    Instrument,
    Representative,
    Surface,
    SurfaceReport,
    TooManyUndefined,
    Topography,
    default_points,
    describe_surface,
    read_for_a_look,
    repair,
    representative,
    smooth,
)
from ..topography.text_files import is_text
from .keys import errors_with_keys

#: Option on the command line for each argument of the functions that read and condition a surface.
SURFACE_OPTIONS = {
    "shortest_wave": "--shortest-wave",
    "max_share": "--max-undefined",
    "max_undefined": "--max-undefined",
    "order": "--detrend",
    "spikes": "--spikes",
    "crop": "--crop",
    "mask": "--mask",
    "file_mask": "--no-file-mask",
    "no_data": "--no-data",
    "shape": "surface.points",
    "tip_radius": "--tip-radius",
    "resolution": "--resolution",
}
#: Note on the direction of the lines of a text file, which differs from that of the rows of a NumPy array.
ORIENTATION = "a line of the text runs along x1, the leakage; transpose makes it run along x2, as rows of NumPy do"
_PICTURES = (".png", ".pdf", ".svg")
#: Options whose value is a length or several lengths.
_LENGTHS = {"size", "spacing", "crop", "tip_radius", "resolution", "shortest_wave"}
#: Nominal pressures at which a surface is checked before its load is known, as fractions of the hardness.
_PRESSURES = (0.02, 0.15)
#: Hardness that is assumed before the material is known, as a fraction of E* times the rms slope.
_HARDNESS = 0.15
_LOADS = "0.02 to 0.15 of a hardness of 0.15 E* times its slope"


@dataclass(frozen=True)
class _SurveyedSurface:
    """Description of a measured surface, and the results of checks of the surface.

    Attributes
    ----------
    report : SurfaceReport
        Description of the surface as measured.
    conditioning : Conditioning or None
        Report on how a run would repair and filter the surface; None if a run would reject the surface.
    waves : Representative or None
        Longest waves of the surface, and how many of them fit into a patch; None for a flat surface.
    form_effect : FormEffect or None
        Effect of the form deviation of the surface on the leakage; None for a flat surface.
    quick_estimate : str
        Estimate of contact and gaps from the spectrum of the surface, as text.
    reasons : tuple of str
        Reasons why a run would reject the surface.
    """

    report: SurfaceReport
    conditioning: Conditioning | None = None
    waves: Representative | None = None
    form_effect: FormEffect | None = None
    quick_estimate: str = ""
    reasons: tuple[str, ...] = ()

    @property
    def warnings(self) -> list[str]:
        """Warnings about the longest waves and the form deviation of the surface."""
        texts = [] if self.waves is None else list(self.waves.warnings)
        return texts + ([] if self.form_effect is None else self.form_effect.warnings)

    @property
    def remarks(self) -> list[str]:
        """Lines of text about the longest waves, the form deviation and the quick estimate.

        If there are warnings about the longest waves, they replace the description of these waves. The same applies to
        the form deviation.
        """
        texts = []
        if self.waves is not None:
            texts += self.waves.warnings or [str(self.waves)]
        if self.form_effect is not None:
            texts += self.form_effect.warnings or [str(self.form_effect)]
        return texts + ([self.quick_estimate] if self.quick_estimate else [])


def survey(
    path: Path,
    picture: Path | None,
    *,
    spikes: float,
    detrend: int | None,
    shortest_wave: str | None,
    max_undefined: float,
    channel: str = "0",
    **reading: Any,
) -> list[str]:
    """Describe the surface in a file in a few lines of text, and draw a picture of the surface.

    Parameters
    ----------
    path, channel, reading
        Arguments that are passed to `read_topography`. Lengths are given as texts with a unit.
    picture : Path or None
        Picture file to write (.png, .pdf or .svg); None for no picture.
    spikes, detrend, shortest_wave, max_undefined
        Values of the keys `spikes`, `detrend`, `shortest_wave` and `max_undefined` in the table [surface] of a case.

    Raises
    ------
    InputError
        An argument is invalid, or the file contains no heights. No picture is written if an InputError is raised.
    """
    if picture is not None and (
        picture.suffix.lower() not in _PICTURES or not picture.absolute().parent.is_dir()
    ):
        expected = f"a file {', '.join(_PICTURES)} in a folder that exists"
        raise InputError("output", f"'{picture}'", expected)
    reading = in_metres(**reading)
    wave = in_metres(shortest_wave=shortest_wave)["shortest_wave"]
    treatment = {"detrend": detrend, "spikes": spikes, "max_undefined": max_undefined}
    with errors_with_keys(SURFACE_OPTIONS):
        validate.number("max_undefined", max_undefined, inclusive=True)
        number = int(channel) if channel.isdecimal() else channel
        file_content = read_for_a_look(path, channel=number, **reading)
        face = file_content.topography
        surveyed = survey_surface(face, wave, treatment, file_content.instrument)
    reasons = [*map(str, file_content.errors), *surveyed.reasons]
    texts = [f"a run refuses this face: {reason}" for reason in reasons]
    if file_content.masked_fraction:
        masked = as_text(file_content.masked_fraction, percent=True)
        texts.append(
            f"the file masks {masked} of its points: --no-file-mask takes their heights all the same"
        )
    texts += file_content.notes
    if is_text(path) and not file_content.has_coordinates:
        texts.append(ORIENTATION)
    lines = [str(path), *_indented(surveyed.report)]
    if surveyed.conditioning is not None:
        texts += advice(surveyed.report, surveyed.conditioning)
        texts += surveyed.remarks
        lines += ["what a run does to it", *_indented(surveyed.conditioning)]
    lines += [f"note: {text}" for text in texts]
    if picture is not None:
        figure = survey_figure(
            face, surveyed.report, surveyed.conditioning, detrend=detrend, spikes=spikes
        )
        # the picture has a space of 0.3 inch for the name
        figure.suptitle(
            path.name, fontsize=8, y=1 - 0.08 / figure.get_figheight(), va="top", parse_math=False
        )
        with writing("output", picture):
            write_bytes(picture, rendered(figure, picture.suffix.lower().removeprefix(".")))
        lines.append(f"picture in {picture}")
    return lines


def in_metres(**options: Any) -> dict[str, Any]:
    """Convert the options that are lengths from texts with a unit to m; return all other options unchanged."""
    converted = dict(options)
    for name in _LENGTHS & options.keys():
        value = options[name]
        option = f"--{name.replace('_', '-')}"
        if isinstance(value, str):
            converted[name] = to_si(value, "m", option)
        elif value is not None:
            converted[name] = tuple(to_si(length, "m", option) for length in value)
    return converted


def survey_surface(
    face: Topography, wave: float | None, treatment: dict[str, Any], instrument: Instrument
) -> _SurveyedSurface:
    """Describe a surface, repair and filter the surface as in a run, and check its longest waves and form deviation.

    Parameters
    ----------
    face : Topography
        Map as read from a file.
    wave : float or None
        Cut-off wavelength of the filter [m]; None for the default wavelength.
    treatment : dict
        Arguments `detrend`, `spikes` and `max_undefined` of `topography.repair`.
    instrument : Instrument
        Instrument with which the surface was measured.
    """
    reasons: list[str] = []  # reasons why a run would reject the surface
    try:
        report = describe_surface(face, **treatment)
    except TooManyUndefined as error:
        reasons.append(f"{error.given}, expected {error.expected}")
        # describe the surface nevertheless, and allow any number of undefined points
        report = describe_surface(face, **treatment | {"max_undefined": 1.0})
    try:
        with errors_with_keys(SURFACE_OPTIONS):
            repaired, repair_report = repair(face, **treatment)
            surface, conditioning = smooth(
                repaired,
                repair_report.form,
                [(repaired, repair_report)],
                shortest_wave=wave,
                shape=default_points(repaired, wave, instrument),
                instrument=instrument,
            )
    except InputError as error:
        # If the user has chosen the wavelength `wave`, an error is about `wave` and is raised, unless the surface has
        # too many undefined points. Other errors are reasons why a run would reject the surface.
        if wave is not None and not isinstance(error, TooManyUndefined):
            raise
        return _SurveyedSurface(report, reasons=tuple(reasons or [str(error)]))
    surveyed = _SurveyedSurface(report, conditioning, reasons=tuple(reasons))
    if not surface.rms_slope:
        return surveyed
    # the checks are made for the surface with its form deviation; only the tilt is subtracted
    with_form = repaired.with_heights(repaired.heights + repair_report.form.heights).detrend(None)
    with_form = with_form.low_pass(conditioning.shortest_wave)
    return _with_checks(surveyed, surface, with_form)


def _with_checks(
    surveyed: _SurveyedSurface, surface: Surface, with_form: Topography
) -> _SurveyedSurface:
    """Add the checks of the longest waves and of the form deviation, and the quick estimate, to a description.

    surface : the surface after repair and filtering, without its form deviation.
    with_form : the same surface with its form deviation.
    """
    # Ratios of leakages and contact fractions only depend on the ratios of pressure and hardness to the contact
    # modulus. The modulus can therefore be 1.
    modulus = 1.0
    hardness = _HARDNESS * modulus * with_form.rms_slope
    pressures = [fraction * hardness for fraction in _PRESSURES]
    law = PerfectlyPlastic(hardness)
    estimate = estimate_surface(with_form, modulus, hardness, pressures)
    return replace(
        surveyed,
        waves=representative(surface),
        form_effect=solve_form_effect(with_form, modulus, law, pressures, loads=_LOADS),
        quick_estimate=f"quick estimate at {_LOADS}: {estimate}",
    )


def _indented(report: object) -> list[str]:
    """Return the lines of a report, indented by two spaces."""
    return indent(str(report), "  ").splitlines()


def advice(
    report: SurfaceReport, conditioning: Conditioning, *, with_wave: bool = True
) -> list[str]:
    """Give advice based on the parameters of a surface: inspect spikes, remove noise, or turn the map.

    Parameters
    ----------
    report : description of the surface.
    conditioning : report on how a run would repair and filter the surface.
    with_wave : whether to say which cut-off wavelength removes noise.
    """
    texts = list(conditioning.spike_warnings)
    if with_wave and report.shortest_wave > conditioning.shortest_wave * (1 + 1e-9):
        wave = to_text(report.shortest_wave, "m", 3)
        texts.append(
            f"waves below {wave} are noise or beyond the instrument: shortest_wave = '{wave}' removes them"
        )
    if conditioning.unseen:
        texts.append(conditioning.unseen)
    if not isnan(report.lay_direction) and abs(report.lay_direction) > pi / 4:
        angle = degrees(abs(report.lay_direction))
        texts.append(
            f"the lay runs {angle:.0f}° off x2, nearer to x1: transpose exchanges the axes"
        )
    return texts
