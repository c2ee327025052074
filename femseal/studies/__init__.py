"""The chains from a rough surface to leakage over a load cycle, readable top to bottom.

`deterministic` resolves everything on the surface's own grid; `two_scale` cuts that into cells and maps them;
`by_blocks` solves a large face by blocks;
`stochastic` draws the cells for the tiles of a seal of any size and shape. All take a `Scene`, and each is an
entry of `STUDIES`, by which runs solve, forecast and compare it.

    cell_states        the cells of a face along a ladder of nominal pressures; leakage of its measured patches
    face_study          states of a face -> a FaceResult, also with its cells
    blocks              a large face by blocks in their own contact -> a BlocksResult
    sampling            options of a drawn seal -> its tiles and, under a map, their pressure
    seal_contact        pressure of the tiles of a seal that has a form
    drawn_study         tiles draw cells -> leakage of the seal; drawn_error: what one patch does not know
"""

from typing import TYPE_CHECKING

from ..base.lazy_package import lazy

if TYPE_CHECKING:
    from ..scene import FluidState, Scene
    from .blocks import BlocksResult, by_blocks
    from .drawn_study import cut_and_tiles, stochastic
    from .face_study import FaceResult, deterministic, two_scale
    from .other_fluid import OtherLeakage, drop_ratio
    from .sampling import Sampling, laid_out
    from .stochastic_result import StochasticResult
    from .study_registry import STUDIES, Study, StudyOptions, StudyResult, study_of_result
else:
    __getattr__, __dir__ = lazy(__name__)
