"""The elastic half-space: its boundary kinds, its symbol, and the displacement under a pressure."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from ..base import Array, InputError, Pair, Shape, validate
from . import influence
from .convolution import Convolution
from .influence import Boundary

BOUNDARIES = ("periodic", "mirror", "free")


@dataclass(frozen=True)
class HalfSpace:
    """An elastic half-space under pressures on a grid of pixels: u = K p.

    û = 2 p̂/(E*|q|) on periodic axes (mean displacement free); a mirror axis is the even extension, exactly a cosine
    transform on the same points; on free axes the pressure is 0 outside and constant on each pixel (Love).

    Parameters
    ----------
    shape : (n1, n2) pixels.
    spacing : (Δ1, Δ2) [m].
    modulus : contact modulus E* [Pa].
    boundary : kind of each axis, "periodic", "mirror" or "free"; one word stands for both.

    Raises
    ------
    InputError : a size, spacing, modulus or boundary kind that is not allowed.

    Notes
    -----
    Sources: Johnson, Contact Mechanics, 1985; Stanley & Kato, J. Tribol. 119, 1997, 481 (periodic);
    Liu, Wang & Liu, Wear 243, 2000, 101 (free). With one free axis, the uniform mode is the plane-strain logarithm,
    whose constant is arbitrary, and so is then the level of `displacement`.

    Free axes are padded to lengths with fast transforms. Periodic and mirror ones cannot be: a large prime factor in
    their number of points slows everything, 1021² points take 8 times as long as 1024². `Topography.resample` helps.

    Examples
    --------
    >>> body = HalfSpace((64, 64), (1e-6, 1e-6), modulus=115e9, boundary=("free", "periodic"))
    >>> body.displacement(np.zeros((64, 64))).shape
    (64, 64)
    """

    shape: Shape
    spacing: Pair
    modulus: float
    boundary: Boundary = ("periodic", "periodic")

    def __post_init__(self) -> None:
        object.__setattr__(self, "shape", validate.grid("shape", self.shape))
        object.__setattr__(self, "spacing", validate.lengths("spacing", self.spacing))
        object.__setattr__(self, "modulus", validate.number("modulus", self.modulus, unit="Pa"))
        ends = (self.boundary,) * 2 if isinstance(self.boundary, str) else self.boundary
        is_pair = isinstance(ends, (tuple, list)) and len(ends) == 2
        if not (is_pair and all(end in BOUNDARIES for end in ends)):
            kinds = f"one of {', '.join(BOUNDARIES)} for each axis"
            raise InputError("boundary", self.boundary, kinds)
        object.__setattr__(self, "boundary", tuple(ends))

    @property
    def stiffness(self) -> float:
        """c = πE*/(4Δ) [Pa/m], that of a wave of four pixels: the step from gap to pressure of the contact solver.

        Δ is the geometric mean of the spacings along which there are points.
        """
        spacings = [d for n, d in zip(self.shape, self.spacing, strict=True) if n > 1] or [
            min(self.spacing)
        ]
        return np.pi * self.modulus / (4 * float(np.prod(spacings) ** (1 / len(spacings))))

    def symbol(self) -> Array:
        """Eigenvalues of K [m/Pa], see `influence.symbol`."""
        return influence.symbol(self.shape, self.spacing, self.modulus, self.boundary)

    def displacement(self, pressure: ArrayLike) -> Array:
        """Displacement u = K p [m] of shape (n1, n2) under pressures p [Pa] of the same shape."""
        p = validate.field("pressure", pressure, unit="Pa", shape=self.shape)
        product = Convolution(self.shape, self.boundary, self.symbol())
        product.pressure[:] = p
        product.apply()
        return np.ascontiguousarray(product.displacement)
