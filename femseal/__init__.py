"""femseal: leakage of metal-to-metal seals over a load cycle, from measured roughness, at the size of the real seal.

The flow of data, top to bottom::

    execution    how the items of a stage are computed and stored
    topography   heights of a face: read, generate, condition            Topography, self_affine, turned, ...
    contact      heights + load -> contact pressure, gap                 HalfSpace, solve_contact, load_cycle
    flow         gap -> permeability of a cell                           cell_permeability, permeability_tensor
    seal         permeability -> leakage of a seal of any shape          RectangularSeal, ..., seal_leakage
    face         a face cut into cells, and their permeability along any path of the pressure
    scene        surface + loads + fluid -> its contact states           Scene
    checks       plausibility checks and the quick estimate of a scene
    studies      the chains: deterministic, two-scale, stochastic
    budget       error of every leakage, source by source             error_budget
    results      one dataset: netCDF, tables, files for ParaView         open_results
    plots        pictures of every result
    report       the folder and the page of a run                        write_report
    case         a TOML file, checked                                    load_case
    preparation  a case -> the input of the studies                      preparation.prepare
    refinement   coarser and finer versions of a case, until a given accuracy is reached
    runs         a case -> results, by all of the above                  run
    sweeps       a case with several values of its keys                  sweep
    designs      results -> pressures that a leakage class needs         design
    calibration  a case and a leak test -> hardness and shortest wave    calibrate

All values are in SI units. Names are loaded when first used, so that importing the package is quick.
"""

from pathlib import Path
from typing import TYPE_CHECKING

from .base.lazy_package import choose_cache_folder, lazy

__version__ = "0.2.0"

if TYPE_CHECKING:
    from .base.errors import FemsealError, InputError, NotConverged
    from .budget import ErrorBudget
    from .budget.estimates import error_budget
    from .calibration.calibrating import calibrate
    from .calibration.calibration import Calibration
    from .case.case import Case
    from .case.reading import load_case
    from .contact import Contact, HalfSpace, LoadCycle, load_cycle, solve_contact
    from .contact.hardness_curves import CoatedLaw, HardnessTable, NixGao
    from .contact.law import ContactLaw
    from .contact.linear_laws import LinearHardening, PerfectlyPlastic
    from .designs.answer import design
    from .designs.data_sheet import Design
    from .flow import (
        FlowLaw,
        Permeability,
        cell_permeability,
        permeability_tensor,
    )
    from .fluids import Liquid, RoelandsLiquid
    from .gases import IdealGas, RealGas
    from .materials import Coated, Solid, contact_modulus, named_solid
    from .report import write_report
    from .results import Results, RunComparison, compare, open_results
    from .runs.job import run
    from .scene import Scene
    from .seal import AnnularSeal, Leakage, MeshSeal, RectangularSeal, seal_leakage
    from .studies.blocks import by_blocks
    from .studies.face_result import FaceResult
    from .studies.face_study import deterministic, two_scale
    from .studies.sampling import Sampling
    from .studies.stochastic_result import StochasticResult
    from .studies.stochastic_study import stochastic
    from .sweeps.sweeping import sweep
    from .topography import (
        Patches,
        Places,
        SurfaceReport,
        Topography,
        continue_spectrum,
        describe_surface,
        read_topography,
        self_affine,
        turned,
    )
    from .topography.combined import combine
    from .topography.conditioning import condition
else:
    __getattr__, __dir__ = lazy(__name__)

choose_cache_folder(Path(__file__).parent)

__all__ = [
    "AnnularSeal",
    "Calibration",
    "Case",
    "Coated",
    "CoatedLaw",
    "Contact",
    "ContactLaw",
    "Design",
    "ErrorBudget",
    "FaceResult",
    "FemsealError",
    "FlowLaw",
    "HalfSpace",
    "HardnessTable",
    "IdealGas",
    "InputError",
    "Leakage",
    "LinearHardening",
    "Liquid",
    "LoadCycle",
    "MeshSeal",
    "NixGao",
    "NotConverged",
    "Patches",
    "PerfectlyPlastic",
    "Permeability",
    "RealGas",
    "RectangularSeal",
    "Results",
    "RoelandsLiquid",
    "RunComparison",
    "Sampling",
    "Scene",
    "Solid",
    "StochasticResult",
    "SurfaceReport",
    "Topography",
    "by_blocks",
    "calibrate",
    "cell_permeability",
    "combine",
    "compare",
    "condition",
    "contact_modulus",
    "continue_spectrum",
    "describe_surface",
    "design",
    "deterministic",
    "error_budget",
    "load_case",
    "load_cycle",
    "named_solid",
    "open_results",
    "permeability_tensor",
    "read_topography",
    "run",
    "seal_leakage",
    "self_affine",
    "solve_contact",
    "stochastic",
    "sweep",
    "turned",
    "two_scale",
    "write_report",
]
