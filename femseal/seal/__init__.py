"""Define shapes of seals, compute their leakage for a given permeability, and map the contact pressure over a seal."""

from typing import TYPE_CHECKING

from ..base.lazy_package import lazy

if TYPE_CHECKING:
    from ..flow.permeability_table import PermeabilityTable, table_pressures
    from .form import FileForm, MeasuredForm, WavyForm
    from .layouts import AnnularLayout, MeshLayout, RectangularLayout
    from .leakage import Leakage, seal_leakage
    from .mesh_seal import MeshSeal
    from .pressure_map import AngleTable, Frame, MapsAtLoads, PressureField, Profile, Uniform
    from .seal_files import read_pressure_field
    from .shapes import AnnularSeal, RectangularSeal
else:
    __getattr__, __dir__ = lazy(__name__)
