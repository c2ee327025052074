"""The contact area at which an elastic isotropic face closes, and how its flow ceases.

Dapp, Lücke, Persson & Müser, Phys. Rev. Lett. 108, 2012, 244301; Dapp & Müser, Sci. Rep. 6, 2016, 19513;
Wang & Müser, Tribol. Lett. 69, 2021, 1. A face has `waves` longest waves on a side (side over roll-off), a shortest
wave `range_` times shorter, and `pixels` per shortest wave.
"""

from __future__ import annotations

import numpy as np

from .faces import MODULUS, SLOPE

CLAIMED = 0.415
#: Longest waves on a side, and number of faces of each.
SIZES = ((1, 80), (2, 80), (4, 80), (8, 48), (16, 24))
#: The spanning area of percolating systems differs from the infinite one by their size to −1/ν, ν = 4/3.
EXPONENT = -0.75


class Face:
    """An elastic face, its contacts by load p̄/E*h′, and where each direction of flow closes."""

    def __init__(self, waves, pixels=8, range_=8, hurst=0.8, rng=0):
        from femseal import HalfSpace, self_affine

        n, side = waves * range_ * pixels, 1e-3
        cut_off = side / waves / range_
        face = self_affine(
            (n, n), (side, side), hurst=hurst, rms_slope=SLOPE, roll_off=side / waves, cut_off=cut_off, rng=rng
        )
        self.gap0, self.spacing = -face.heights, face.spacing
        self.body = HalfSpace((n, n), face.spacing, MODULUS)
        self.known = {}

    def contact(self, load, rtol=1e-5):
        from femseal import solve_contact

        return solve_contact(self.gap0, self.body, pressure=load * MODULUS * SLOPE, rtol=rtol)

    def state(self, load):
        """Whether the open pixels join the ends of x1, those of x2, and the contact area corrected for its edges."""
        if load not in self.known:
            from femseal.flow.percolation import percolates

            contact = self.contact(load)
            is_open = contact.pressure == 0
            ways = percolates(is_open), percolates(np.ascontiguousarray(is_open.T))
            self.known[load] = *map(bool, ways), contact.area_fraction_corrected
        return self.known[load]

    def closing(self, axis, low=0.1, high=0.5, steps=8):
        """Load and contact area at which the flow along an axis ends, by bisection."""
        for _ in range(steps):
            middle = (low + high) / 2
            low, high = (middle, high) if self.state(middle)[axis] else (low, middle)
        return (low + high) / 2, (self.state(low)[2] + self.state(high)[2]) / 2

    def permeability(self, load):
        from femseal import cell_permeability

        contact = self.contact(load, rtol=1e-7)
        return cell_permeability(contact.gap, self.spacing, sides="periodic", rtol=1e-6).value, contact


def closing_areas(waves, faces, **options):
    """Contact area at closing along x1 and x2 of as many faces, (faces, 2)."""
    found = []
    for seed in range(faces):
        face = Face(waves, rng=seed, **options)
        found.append([face.closing(axis)[1] for axis in (0, 1)])
    return np.array(found)


def truncated_areas(waves, faces, steps=10):
    """Share cut off at which the undeformed faces close along x1 and x2, (faces, 2)."""
    from femseal.flow.percolation import percolates

    found = np.zeros((faces, 2))
    for seed in range(faces):
        gap0 = Face(waves, rng=seed).gap0
        for axis, gap in enumerate((gap0, gap0.T)):
            low, high = 0.1, 0.9
            for _ in range(steps):
                middle = (low + high) / 2
                low, high = (middle, high) if percolates(gap > np.quantile(gap, middle)) else (low, middle)
            found[seed, axis] = (low + high) / 2
    return found


def critical_area(sizes=SIZES):
    """Closing areas by size, and their extrapolation a + b·waves^(−3/4) of the medians to an infinite face.

    Both directions of a face are one sample for the standard error, of a median 1.25 times that of a mean.
    """
    records = []
    for waves, faces in sizes:
        areas = closing_areas(waves, faces)
        error = 1.25 * areas.mean(axis=1).std(ddof=1) / np.sqrt(faces)
        records.append(
            {"waves": waves, "faces": faces, "median": float(np.median(areas)), "spread": areas.std(), "error": error}
        )
    x = np.array([r["waves"] for r in records], dtype=float) ** EXPONENT
    y, error = (np.array([r[name] for r in records]) for name in ("median", "error"))
    (slope, area), covariance = np.polyfit(x, y, 1, w=1 / error, cov="unscaled")
    return {"sizes": records, "area": area, "error": float(np.sqrt(covariance[1, 1])), "slope": slope}


def resolution(pixels=(4, 8, 16), faces=12, waves=4):
    """Mean closing area of the same faces with finer pixels."""
    return {p: float(closing_areas(waves, faces, pixels=p).mean()) for p in pixels}


#: Distances (p_c − p)/p_c from the load that closes a face.
DISTANCES = (0.3, 0.1, 0.05, 0.025, 0.0125, 0.006, 0.003)


def flow_near_closing(faces=6, waves=2, pixels=256, range_=2, distances=DISTANCES):
    """Permeability of single faces at distances (p_c − p)/p_c from the load p_c that closes each.

    The exponent is that of the straight line through the nearest four distances of a face.
    """
    values = []
    for seed in range(faces):
        face = Face(waves, pixels=pixels, range_=range_, rng=seed)
        load, _ = face.closing(0, steps=14)
        values.append([face.permeability(load * (1 - d))[0] for d in distances])
    values = np.array(values)
    exponents = [float(np.polyfit(np.log(distances[-4:]), np.log(k[-4:]), 1)[0]) for k in values]
    return {"distance": np.array(distances), "permeability": values, "exponents": exponents}


def flow_factor(faces=4, waves=8, loads=(0.01, 0.02, 0.04, 0.07, 0.1, 0.13, 0.16, 0.18)):
    """Flow factor φ = 12k/ū³, ū the mean gap, against contact area a of large faces; φ = (1 − a/a_c)^n fitted with φ(0) = 1."""
    areas, factors = np.zeros((2, faces, len(loads)))
    for seed in range(faces):
        face = Face(waves, rng=seed)
        for i, load in enumerate(loads):
            value, contact = face.permeability(load)
            areas[seed, i] = contact.area_fraction_corrected
            factors[seed, i] = 12 * value / contact.mean_gap**3
    area = np.median(areas, axis=0)
    factor = np.median(factors, axis=0)
    x, y = np.log(1 - area / CLAIMED), np.log(factor)
    exponent = x @ y / (x @ x)
    return {"area": area, "factor": factor, "exponent": exponent, "deviation": float(np.abs(y - exponent * x).max())}


def draw(record, ax):
    sizes = record["critical"]["sizes"]
    x = [r["waves"] ** EXPONENT for r in sizes]
    ax.errorbar(
        x, [r["median"] for r in sizes], [r["error"] for r in sizes], fmt="o", capsize=3, label="median, standard error"
    )
    ends = np.array([0, 1])
    found = record["critical"]
    ax.plot(ends, found["area"] + found["slope"] * ends, "C0-", lw=1, label="straight line")
    ax.axhspan(CLAIMED - 0.02, CLAIMED + 0.02, color="k", alpha=0.15, label="0.415 ± 0.02")
    ax.set(xlabel="(side / roll-off)$^{-3/4}$", ylabel="contact area at closing", title="critical contact area")
    ax.set_ylim(0.37, 0.47)
    ax.legend(fontsize=7)


def draw_flow(record, ax):
    near = record["near"]
    for k in near["permeability"]:
        ax.loglog(near["distance"], k / k[0], "C0-", lw=0.7, marker=".")
    distance = near["distance"]
    ax.xaxis.set_minor_formatter("")
    middle = np.median(near["permeability"] / near["permeability"][:, :1], axis=0)
    ax.loglog(distance, middle[-1] * (distance / distance[-1]) ** 3.45, "k--", label="slope 3.45")
    ax.set(xlabel="$(p_c - p)/p_c$ of each face", ylabel="permeability / that at 0.3", title="faces near closing")
    ax.legend()


def lines(record):
    found, near, factor = record["critical"], record["near"], record["factor"]
    sizes = ", ".join(
        f"{r['median']:.3f} ± {r['error']:.3f} ({r['waves']}, {r['faces']} faces)" for r in found["sizes"]
    )
    pixels = ", ".join(f"{area:.3f} with {p}" for p, area in record["resolution"].items())
    low, middle, high = np.percentile(near["exponents"], [25, 50, 75])
    nearest = near["distance"][[-4, -1]]
    return [
        [
            "Elastic isotropic faces close at a contact area of 0.415 ± 0.02",
            "Dapp, Lücke, Persson & Müser, Phys. Rev. Lett. 108, 2012, 244301; Wang & Müser, Tribol. Lett. 69, 2021, 1",
            f"median by longest waves on a side: {sizes}; extrapolated as waves^−3/4: **{found['area']:.3f} ± "
            f"{found['error']:.3f}**. Mean of the same faces, by pixels per shortest wave: {pixels}",
        ],
        [
            "Close to closing the flow is that of the last constriction, (p_c − p)^3.45",
            "Dapp & Müser, Sci. Rep. 6, 2016, 19513 (abstract), EPL 109, 2015, 44001",
            f"exponent of single faces over (p_c − p)/p_c = {nearest[0]:g} … {nearest[1]:g}: median {middle:.2f}, quartiles "
            f"{low:.2f} and {high:.2f}, {len(near['exponents'])} faces. Where two constrictions close one after the other "
            "it is larger until the first is closed",
        ],
        [
            "The flow factor 12k/ū³ follows from the contact area a alone",
            "Wang & Müser, Tribol. Lett. 69, 2021, 1 (abstract, without its formula)",
            f"(1 − a/0.415)^{factor['exponent']:.2f} over a = {factor['area'][0]:.2f} … {factor['area'][-1]:.2f}, within a factor "
            f"{np.exp(factor['deviation']):.2f}; the exponent of the paper was not at hand",
        ],
    ]
