"""List the file formats and size limits that a case can set for its result files.

The module does not import the solvers, so that a case can be read quickly.
"""

from ..base import InputError

#: Formats of the files for ParaView: series of .vtu files, which every version of ParaView opens, or no files.
PARAVIEW_FORMATS = ("vtu", "none")
#: Formats of pictures: pixels for screens, and vectors for print.
PICTURE_FORMATS = ("png", "svg", "pdf")
#: Default limit of the size of all fields over the pixels before compression [byte]. If the fields of all steps are
#: larger, only the fields of some steps are written.
FIELDS_LIMIT = 1e9


def read_formats(text: str | None) -> tuple[str, ...]:
    """Split a string such as "svg,pdf" into picture formats; None gives an empty tuple.

    >>> read_formats("svg,pdf")
    ('svg', 'pdf')
    """
    if text is None:
        return ()
    formats = tuple(dict.fromkeys(part.strip().lower().lstrip(".") for part in text.split(",")))
    if any(form not in PICTURE_FORMATS for form in formats):
        expected = f"{', '.join(PICTURE_FORMATS)}, or several of them, such as svg,pdf"
        raise InputError("--format", f"'{text}'", expected)
    return formats
