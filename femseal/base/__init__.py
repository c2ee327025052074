"""Provide what all other subpackages need: errors, units, fields of results, tables, files and checks of arguments."""

from typing import TYPE_CHECKING

from .lazy_package import lazy

if TYPE_CHECKING:
    from .display import Labelled, Plotted, Shown, labelled
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
    from .machine import free_memory
    from .package_versions import numerical_versions, versions
    from .quantities import as_text, counted, to_si, to_text
    from .stage import Mapper, Stage
    from .text import duration, finite_data, format_deviation, number_text
    from .text_table import TextTable, comma_separated, flatten, rows_of
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
