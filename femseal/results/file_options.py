"""Define the options of a case for the files of its results.

These options are in a separate module, so that a case can be read without importing the solvers.
"""

from ..base import InputError

#: Formats of the files for ParaView: series of .vtu files, which every version of ParaView opens, or no files.
FORMATS = ("vtu", "none")
#: Formats of pictures: pixels for screens, and vectors for print.
PICTURE_FORMATS = ("png", "svg", "pdf")
#: Default limit of the size of all fields over the pixels before compression [byte]. Larger fields are written only at
#: some of the steps.
FIELDS_LIMIT = 1e9


def read_formats(text: str | None) -> tuple[str, ...]:
    """Read the picture formats from the option of a command, such as "svg,pdf"; () if the option is not given.

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
