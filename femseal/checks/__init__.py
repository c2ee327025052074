"""Check the plausibility of a scene and its leakage, and estimate the leakage quickly for a comparison.

plausibility     Warnings about a scene and its solution. Every study calls `result_warnings`.
quick_estimate   Contact and leakage from the spectrum of the surface alone.
flow_limits      Warnings about flow that the model does not describe: choked flow and inertia.
ideal_gas        Warnings about gases that are not ideal.
limited_ratios   Warnings if a limit on a leakage ratio determines the median of stochastic seals.
coatings         Warnings if a coating is thin compared with roughness, plastic deformation or contact patches.
form_effect      Effects of the curvature and of the longest waves of a measured patch on its leakage.
"""

from typing import TYPE_CHECKING

from ..base.lazy_package import lazy

if TYPE_CHECKING:
    from .coatings import coating_depth_warnings, constrained_hardness_ratio
    from .flow_limits import choked_flux, flow_warnings
    from .form_effect import FormEffect, solve_form_effect
    from .ideal_gas import gas_warnings
    from .limited_ratios import limited_factor_warnings, limited_median_warnings
    from .plausibility import line_contact_warnings, result_warnings, scene_warnings
    from .quick_estimate import QuickEstimate, estimate_scene, estimate_surface, mean_modulus
else:
    __getattr__, __dir__ = lazy(__name__)
