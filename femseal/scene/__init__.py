"""A scene: a surface, its loads and its fluid, in contact at every load step.

scene             surface + loads + fluid                                  -> Scene, FluidState
fluid_coupling    contact of the whole surface and flow through its gap, solved in turn: the fluid separates them
trapped_liquid    pressures of pockets that keep their liquid
choices           what a scene may choose by name
"""

from typing import TYPE_CHECKING

from ..base.lazy_package import lazy

if TYPE_CHECKING:
    from .choices import FLUID_EFFECTS, NOMINALS
    from .scene import FluidState, Scene
else:
    __getattr__, __dir__ = lazy(__name__)
