"""Generate random scenes: rough surfaces of several kinds and their loads, identical on any grid.

A surface consists of waves that its grid resolves with at least 8 pixels. `Drawn.scene(2)` therefore contains
the same surface on twice the points per side. All numbers of a scene follow from its kind and its seed.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy import fft

from femseal import Liquid, Scene, Topography, self_affine, turned

MODULUS, PIXEL = 115e9, 1e-6
KINDS = (
    "self-affine",
    "turned",
    "milling arcs",
    "ground",
    "bumps",
    "filtered",
    "long waves",
    "plateau-honed",
    "log-normal",
    "pitted",
    "scratched",
    "deep-honed",
)
#: Seeds that neither the forms of the widths nor their calibration have seen.
HELD_OUT = range(8000, 9000)
#: Points a side of the faces; sides of cells, which are drawn so that other numbers stay the same.
SIDES, CELLS = (96, 128, 192), (16, 32, 48)
#: How many times finer the waves of a rough face are than those that its filter leaves.
FINER = 4


@dataclass(frozen=True)
class Drawn:
    """A random scene of a kind and a seed.

    Parameters
    ----------
    kind : str
        Kind of the surface, one of `KINDS`.
    seed : int
        Seed of the random numbers.
    length : int
        Length of the surface along x2, in sides of a square patch.
    side : int
        Number of points on a side of the patch, a multiple of 16; 0 for a random choice.
    breadth : int
        Width of the surface along x1, in sides of a square patch. The longest waves follow from the side of the patch.
    """

    kind: str
    seed: int
    length: int = 1
    side: int = 0
    breadth: int = 1

    @cached_property
    def numbers(self) -> dict:
        """Random numbers of the scene. Their order must not change, so that scenes stay the same."""
        rng = np.random.default_rng([KINDS.index(self.kind), self.seed])
        points = int(rng.choice(SIDES))
        rng.choice([w for w in CELLS if points % w == 0 and 1 < points // w < 12])
        elastic = rng.random() < 0.3
        hurst, slope = rng.uniform(0.4, 1.0), np.exp(rng.uniform(np.log(0.05), np.log(0.4)))
        # shares of E* times the slope at which about half of the faces close
        hardness, highest = (
            np.exp(rng.uniform(np.log(0.06), np.log(0.5))),
            np.exp(rng.uniform(np.log(0.04), np.log(0.2))),
        )
        steps = int(rng.integers(3, 6))
        if self.side:
            points = self.side
        loads = np.exp(np.sort(rng.uniform(np.log(0.02), 0.0, steps - 1)))
        return {
            "points": points,
            "hurst": hurst,
            "slope": slope,
            "hardness": np.inf if elastic else hardness,
            "loading": [*loads, 1.0],
            "highest": min(highest, 0.4 * hardness) if not elastic else highest,
            "unloading": np.sort(np.exp(rng.uniform(np.log(0.03), np.log(0.8), 2)))[::-1],
            "roll_off": rng.uniform(0.15, 0.6),
            "marks": min(int(rng.integers(5, 11)), points // 9),
            "fine": rng.uniform(0.05, 0.3),
            "stretch": int(rng.choice([3, 6])),
            "across": bool(rng.random() < 0.5),
            "count": int(rng.integers(20, 80)),
            "face": int(rng.integers(2**32)),
        }

    @property
    def points(self) -> tuple[int, int]:
        """Number of points of the surface along x1 and x2."""
        n = self.numbers["points"]
        return self.breadth * n, self.length * n

    def surface(self, times: int = 1, *, filtered: bool = True):
        """Return the surface on `times` as many points per side, with or without the waves that the filter removes."""
        shape = tuple(times * n for n in self.points)
        if self.kind == "filtered":
            fine = self._made(FINER)
            if not filtered:
                return fine.resample(shape) if times > FINER else fine
            return fine.low_pass(8 * PIXEL).resample(shape)
        return self._made(1).resample(shape)

    def _made(self, finer: int):
        """Generate the surface on `finer` times as many points per side as the scene."""
        n = self.numbers
        (n1, n2), rng = self.points, np.random.default_rng(n["face"])
        shape, size = (finer * n1, finer * n2), (n1 * PIXEL, n2 * PIXEL)
        breadth, pixel = n["points"] * PIXEL, PIXEL / finer
        # a breadth of a long face, from which seals are drawn, holds several of its longest waves
        longest = 0.4 if self.length > 1 else 1.0
        rough = {
            "hurst": n["hurst"],
            "roll_off": max(longest * n["roll_off"] * breadth, 12 * PIXEL),
            "cut_off": 8 * pixel,
            "rng": rng,
        }
        if self.kind in ("self-affine", "filtered"):
            face = self_affine(shape, size, rms_slope=1.0, **rough)
        elif self.kind == "turned":
            pitch = breadth / n["marks"]
            face = turned(
                shape,
                size,
                pitch=pitch,
                depth=pitch / 10,
                roughness=n["fine"] * pitch / 10,
                depth_error=0.1,
                hurst=n["hurst"],
                roughness_roll_off=breadth / 6,
                cut_off=8 * PIXEL,
                rng=rng,
            )
        elif self.kind == "milling arcs":
            x1, x2 = ((np.arange(count) + 0.5) * pixel for count in shape)
            marks = max(5, n["marks"] - 2) / breadth
            along = x2 + np.sqrt((1.5 * size[0]) ** 2 - x1[:, None] ** 2)
            arcs = Topography(np.cos(2 * np.pi * marks * along), (pixel, pixel), (False, True))
            fine = self_affine(shape, size, rms_height=2 * n["fine"], **rough)
            face = Topography(arcs.heights + fine.heights, (pixel, pixel), (False, True))
        elif self.kind == "ground":
            # a face squeezed along its lay: its waves are so many times longer there
            s = n["stretch"]
            squeezed = (size[0], size[1] / s) if n["across"] else (size[0] / s, size[1])
            face = self_affine(shape, squeezed, rms_slope=1.0, **rough)
            face = Topography(face.heights, (pixel, pixel))
        elif self.kind == "long waves":
            # waves of a third to a half of the patch carry most of the height
            rough["hurst"] = 0.7 + 0.3 * (n["hurst"] - 0.4) / 0.6
            rough["roll_off"] = (0.25 + 0.4 * n["roll_off"]) * breadth
            face = self_affine(shape, size, rms_slope=1.0, **rough)
        elif self.kind == "log-normal":
            base = self_affine(shape, size, rms_height=1.0, **rough)
            heights = np.exp(rng.uniform(0.5, 1.0) * base.heights)
            face = Topography(heights, (pixel, pixel)).low_pass(8 * PIXEL)
        elif self.kind == "plateau-honed":
            base = self_affine(shape, size, rms_height=1.0, **rough)
            # a patch has about six to eleven grooves
            count = rng.poisson((4 + n["count"] / 12) * self.length)
            angles = np.radians(rng.uniform(20, 45)) * rng.choice([-1, 1], count)
            grooves = _grooves(shape, pixel, angles, rng.lognormal(1.0, 0.3, count), rng)
            face = Topography(base.heights - grooves, (pixel, pixel)).low_pass(8 * PIXEL)
        elif self.kind == "deep-honed":
            base = self_affine(shape, size, rms_height=1.0, **rough)
            # two to twenty grooves of unlike depth on a patch
            count = rng.poisson(n["count"] / 8 * self.length * self.breadth)
            angles = np.radians(rng.uniform(20, 45)) * rng.choice([-1, 1], count)
            grooves = _grooves(shape, pixel, angles, rng.lognormal(1.0, 0.5, count), rng)
            face = Topography(base.heights - grooves, (pixel, pixel)).low_pass(8 * PIXEL)
        elif self.kind == "scratched":
            base = self_affine(shape, size, rms_height=1.0, **rough)
            count = rng.poisson(self.length)
            angles = np.radians(rng.uniform(-10, 10, count))
            grooves = _grooves(shape, pixel, angles, rng.uniform(0.5, 2.5, count), rng)
            face = Topography(base.heights - grooves, (pixel, pixel)).low_pass(8 * PIXEL)
        elif self.kind == "pitted":
            base = self_affine(shape, size, rms_height=1.0, **rough)
            count = round(n["count"] * self.length * self.breadth / 6)
            pits = _bumps(shape, size, count, 0.09, rng, breadth)
            deep = rng.uniform(3.0, 8.0) / np.ptp(pits.heights)
            face = Topography(base.heights - deep * pits.heights, (pixel, pixel))
        else:
            count = round(n["count"] * self.length * self.breadth / longest)
            face = _bumps(shape, size, count, 0.12 * longest**0.5, rng, breadth)
        scale = n["slope"] / face.rms_slope
        return Topography(face.heights * scale, face.spacing, face.periodic)

    def scene(self, times: int = 1, *, filtered: bool = True):
        """Return the scene on `times` as many points per side."""
        n = self.numbers
        slope = n["slope"] / 2 if self.kind == "filtered" else self._made(1).rms_slope
        highest = MODULUS * slope * n["highest"]
        loading = tuple(highest * x for x in n["loading"])
        return Scene(
            surface=self.surface(times, filtered=filtered),
            modulus=MODULUS,
            hardness=MODULUS * slope * n["hardness"],
            fluid=Liquid(1e-3),
            inlet_pressure=1e7,
            outlet_pressure=0.0,
            loading=loading,
            unload_from=loading[-1:],
            unloading=tuple(highest * x for x in n["unloading"]),
        )


def _grooves(shape, pixel, angles, depths, rng):
    """Return the depth of straight grooves at random positions, at given angles to x1, periodic along x2."""
    x1, x2 = ((np.arange(count) + 0.5) * pixel for count in shape)
    length, total = shape[1] * pixel, np.zeros(shape)
    for angle, depth in zip(angles, depths, strict=True):
        across = x2 - rng.uniform(0, length) - np.tan(angle) * x1[:, None]
        distance = ((across / length + 0.5) % 1 - 0.5) * length * np.cos(angle)
        total += depth * np.exp(-((distance / (rng.uniform(4, 8) * PIXEL)) ** 2))
    return total


def _bumps(shape, size, count, widest, rng, side):
    """Return a surface of Gaussian bumps, periodic and without waves shorter than 8 pixels.

    The largest width of a bump is `widest` times the length `side` [m].
    """
    q1 = 2 * np.pi * fft.fftfreq(shape[0], size[0] / shape[0])[:, None]
    q2 = 2 * np.pi * fft.rfftfreq(shape[1], size[1] / shape[1])[None, :]
    total = 0.0
    for _ in range(count):
        width = side * np.exp(rng.uniform(np.log(0.03), np.log(widest)))
        place = rng.uniform(0, 1, 2) * size
        total = total + width**3 * rng.uniform(0.5, 1) * np.exp(
            -((q1**2 + q2**2) * width**2) / 2 - 1j * (q1 * place[0] + q2 * place[1])
        )
    spacing = size[0] / shape[0], size[1] / shape[1]
    return Topography(fft.irfft2(total, s=shape), spacing).low_pass(8 * PIXEL)
