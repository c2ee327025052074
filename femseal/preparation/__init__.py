"""From a case to the input of the studies: its faces made, read and conditioned, its sizes checked."""

from typing import TYPE_CHECKING

from ..base.lazy_package import lazy

if TYPE_CHECKING:
    from .preparation import Prepared, prepare
else:
    __getattr__, __dir__ = lazy(__name__)
