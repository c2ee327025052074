"""Compute the leakage of a rough surface over a load cycle by four studies.

`deterministic` solves contact and flow on all pixels of the surface. `two_scale` also solves the flow through each cell
of the surface. `by_blocks` solves a surface that is too large for the memory of the machine block by block.
`stochastic` solves seals of any size and shape, whose tiles take random cells of the surface. All studies take a
`Scene`. Each is an entry of `STUDIES`, which runs use to solve, forecast and compare them.

    cell_states         cells of a surface at tabulated nominal pressures; leakage of its measured patches
    face_study          contact states of a surface -> a FaceResult, also with its cells
    blocks              a large surface, solved block by block -> a BlocksResult
    sampling            options of the realisations -> tiles of the seal and, under a pressure map, their pressure
    seal_contact        pressure of the tiles of a seal that has a form
    stochastic_study    tiles take random cells -> leakage of the realisations
    patch_interval      95 % interval of a seal of which only one patch was measured
"""

from typing import TYPE_CHECKING

from ..base.lazy_package import lazy

if TYPE_CHECKING:
    from ..scene import FluidState, Scene
    from .blocks import BlocksResult, by_blocks
    from .face_study import FaceResult, deterministic, two_scale
    from .other_fluid import OtherLeakage, drop_ratio
    from .sampling import Sampling, cut_and_cover
    from .stochastic_result import StochasticResult
    from .stochastic_study import cut_and_tiles, stochastic
    from .study_registry import STUDIES, Study, StudyOptions, StudyResult, study_of_result
else:
    __getattr__, __dir__ = lazy(__name__)
