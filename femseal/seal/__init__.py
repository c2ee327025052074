"""Define shapes of seals, compute their leakage for a given permeability, and map the contact pressure over a seal.

From the shape to the leakage::

    [seal] of a case
       |
    layouts.Layout          strip, ring or mesh, not yet divided: the shapes that a case can choose
       |  lay_out(CellSize)     covering.py divides the seal; CellSize is the size that the tiles should have
    tiles.SealTiles         which elements belong to which tile, and the lay in each element
       |  .seal                 tiles.permeability gives each element the permeability of its tile
    element_seal.ElementSeal  finite elements between inlet and outlet
       |  flow(permeability)    by flow.rectangles (strips and rings) or flow.mesh (all other seals)
    flow.DarcyFlow          conductance and potential for a unit drop
       |  leakage.seal_leakage  with a fluid and its pressures
    leakage.Leakage

A user who has a permeability for each element needs no tiles, and begins in the middle, with one of the other shapes
that have the methods of `shapes.Seal`: `RectangularSeal`, `AnnularSeal` (`shapes`) and `MeshSeal` (`mesh_seal`). The
geometry of rings is in `ring.Ring`.

What varies over the whole seal is given in the coordinates `frame.Frame`: pressure maps (`pressure_map`), whose
averages `PressedSeal` computes, and form deviations (`form`). The contact of a whole seal is solved on a
`contact_grid.ContactGrid`.
"""

from typing import TYPE_CHECKING

from ..base.lazy_package import lazy

if TYPE_CHECKING:
    from ..flow.permeability_table import PermeabilityTable, table_pressures
    from .form import FileForm, MeasuredForm, WavyForm
    from .frame import Frame
    from .layouts import AnnularLayout, MeshLayout, RectangularLayout
    from .leakage import Leakage, seal_leakage
    from .mesh_seal import MeshSeal
    from .pressure_files import read_pressure_field
    from .pressure_map import AngleTable, MapsAtLoads, PressureField, Profile, Uniform
    from .shapes import AnnularSeal, RectangularSeal
else:
    __getattr__, __dir__ = lazy(__name__)
