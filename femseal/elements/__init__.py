"""Windows as elements: a window condensed to its sides, and the flow through many of them."""

from .elements import ElementFlow, WindowFlow, element_flow, face_potential, window_flow

__all__ = [
    "ElementFlow",
    "WindowFlow",
    "element_flow",
    "face_potential",
    "window_flow",
]
