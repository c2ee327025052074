"""Provide what all other subpackages need: errors, units, fields of results, tables, files and checks of arguments."""

from typing import TYPE_CHECKING

from .lazy_package import lazy

if TYPE_CHECKING:
    from .errors import (
        FemsealError,
        FileError,
        InputError,
        InputErrors,
        NotConverged,
        NotKept,
        shortened,
        shown,
    )
    from .files import made_folder, read_plain, replacing, write_bytes, write_text, writing
    from .machine import free_memory, numerical_versions, versions
    from .quantities import as_text, counted, to_si, to_text
    from .stage import Mapper, Stage
    from .text import (
        Labelled,
        Plotted,
        Shown,
        TextTable,
        comma_separated,
        duration,
        finite_data,
        flatten,
        format_deviation,
        labelled,
        number_text,
        rows_of,
    )
    from .validate import (
        AnyPath,
        Array,
        Flags,
        Floats,
        Indices,
        Lengths,
        Pair,
        Periodic,
        Shape,
        Singles,
        reals,
    )
else:
    __getattr__, __dir__ = lazy(__name__)
