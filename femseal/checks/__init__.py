"""Plausibility checks: what is not plausible in a scene and its leakage, and a quick estimate to compare it with.

plausibility     a scene and its solution -> warnings; every study calls `result_warnings`
quick_estimate   contact and leakage from the spectrum of the surface alone
flow_limits      flow that the model does not describe: faster than sound, with inertia, gases that are not ideal
form_effect      leakage of a measured patch with its curvature, without it, and without its longest waves
"""

from typing import TYPE_CHECKING

from ..base.lazy_package import lazy

if TYPE_CHECKING:
    from .flow_limits import choked_flux, flow_warnings, gas_warnings
    from .form_effect import FormEffect, solve_form_effect
    from .plausibility import line_contact_warnings, result_warnings, scene_warnings
    from .quick_estimate import QuickEstimate, estimate_scene, estimate_surface
else:
    __getattr__, __dir__ = lazy(__name__)
