"""Windows as elements: a window condensed to its sides, and the flow through many of them."""

from typing import TYPE_CHECKING

from ..base.lazy_package import load_when_used

if TYPE_CHECKING:
    from .elements import ElementFlow, WindowFlow, element_flow, face_potential, window_flow

__all__ = [
    "ElementFlow",
    "WindowFlow",
    "element_flow",
    "face_potential",
    "window_flow",
]

load_when_used(__name__)
