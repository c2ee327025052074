"""Tools: errors, quantities with units, fields, tables of texts, files, checks of arguments."""

from collections.abc import Callable
from types import ModuleType

#: Rooms above that display results, by name; the package enters what imports them, so that no file here does.
displays: dict[str, Callable[[], ModuleType]] = {}
