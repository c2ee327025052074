"""Prepare the input of the studies from a case: make or read its faces, condition them, and check sizes."""

from typing import TYPE_CHECKING

from ..base.lazy_package import lazy

if TYPE_CHECKING:
    from .preparation import Prepared, prepare
else:
    __getattr__, __dir__ = lazy(__name__)
