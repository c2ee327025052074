"""From a case to the input of the studies: its faces made, read and conditioned, its sizes checked."""

from typing import TYPE_CHECKING

from ..base.lazy_package import load_when_used

if TYPE_CHECKING:
    from .preparation import prepare
    from .prepared import Prepared

load_when_used(__name__)
