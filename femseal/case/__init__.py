"""Read the TOML file of a case, which is the input of a run, and validate its tables and values."""

from typing import TYPE_CHECKING

from ..base.lazy_package import lazy

if TYPE_CHECKING:
    from .case import Case
    from .reading import load_case, parse_case
    from .schema import case_schema
    from .template import case_template
else:
    __getattr__, __dir__ = lazy(__name__)
