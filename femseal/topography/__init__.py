"""Heights of seal faces: read or generated, conditioned, and the map that the solvers take.

read_topography (measured) or self_affine, turned (generated) -> Topography -> condition -> Topography,
Conditioning
"""

from .conditioning import Conditioning, condition
from .generate import self_affine, turned
from .read import read_topography
from .topography import Topography

__all__ = ["Topography", "self_affine", "turned", "condition", "Conditioning", "read_topography"]
