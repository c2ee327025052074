"""Define four studies that compute the leakage of a rough surface over a load cycle.

`deterministic` solves contact and flow on all pixels of the surface. `two_scale` also solves the flow through each cell
of the surface. `by_blocks` solves a surface that is too large for the memory of the machine block by block.
`stochastic` solves seals of any size and shape, whose tiles take random cells of the surface. All studies take a
`Scene`. The dictionary `STUDIES` describes each study to a run: how it is solved, what it costs and what its result
contains. A file …_type describes a study to a run; it loads no solver.

    face_study          deterministic and two-scale study; their result is in face_result
    cell_states         cells of a surface in several contact states
    tabulated_pressures pressures at which the contact of cells is tabulated, and interpolation between them
    patch_leakage       leakage of each measured patch
    blocks              study of a large surface, block by block; block_division chooses the blocks
    sampling            options of the stochastic study, and the tiles of its seal
    tile_pressure       nominal pressure of the tiles under a pressure map
    tile_fluid          fluid pressures at which the cells of tiles are solved
    seal_contact        pressure of the tiles of a seal that has a form, from rough_layer and contact_points
    cell_supply         permeabilities of the cells at the pressure of each tile
    stochastic_study    realisations of a seal, whose tiles take random cells
    median_seal         fields of the realisation whose leakage is nearest to the median
    patch_interval      95 % interval of a leakage that was computed from one measured patch
    study_type          what a run must know of a study
    study_result        what the result of every study contains
    study_list          all studies by name; each is described in a file of its own, such as blocks_type
    cost_model          expected time and memory of contact and flow
"""

from typing import TYPE_CHECKING

from ..base.lazy_package import lazy

if TYPE_CHECKING:
    from ..scene import FluidState, Scene
    from .blocks import BlocksResult, by_blocks
    from .face_result import FaceResult
    from .face_study import deterministic, two_scale
    from .other_fluid import OtherLeakage, drop_ratio
    from .sampling import Sampling, cut_and_cover, cut_and_tiles
    from .stochastic_result import StochasticResult
    from .stochastic_study import stochastic
    from .study_list import STUDIES, studies_named, study_of_result
    from .study_result import StudyResult, SurfaceResult
    from .study_type import Study, StudyCost, StudyOptions
else:
    __getattr__, __dir__ = lazy(__name__)
