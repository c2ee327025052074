"""Prepare the input of the studies from a case: generate or read its faces, condition the surface, check all sizes."""

from typing import TYPE_CHECKING

from ..base.lazy_package import lazy

if TYPE_CHECKING:
    from ..budget.study_input import StudyInput
    from .preparation import prepare
else:
    __getattr__, __dir__ = lazy(__name__)
