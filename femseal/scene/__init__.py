"""Describe a scene, that is, a surface, its loads and its fluid, and solve the contact at every load step.

scene             surface + loads + fluid                                  -> Scene, FluidState
fluid_pressure    a fluid whose pressure acts on the surfaces
fluid_coupling    contact of the whole surface under the fluid pressure of the flow through its gap
separation        contact load of a surface when the fluid carries nearly the whole load
patch_contacts    contact of several measured patches of one surface
trapped_liquid    pressures of liquid that is trapped in closed pockets
choices           names of the options of a scene
"""

from typing import TYPE_CHECKING

from ..base.lazy_package import lazy

if TYPE_CHECKING:
    from .choices import FLUID_EFFECTS, NOMINALS
    from .scene import FluidState, Scene
else:
    __getattr__, __dir__ = lazy(__name__)
