"""Solve the contact of several measured patches of one surface.

The contact of each patch is solved separately. If the fluid pressure acts on the patches, the flow through all patches
is solved together.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import replace
from typing import Any

import numpy as np

from ..base import Array, InputError
from ..contact import Contact, ContactLaw, HalfSpace
from ..face.cell_flow import Failed, FlowSettings, attempt, solve_surface_flow
from ..topography import Patches
from .fluid_coupling import CoupledContact


def contact_of_patches(
    gap0: Array,
    half_space: HalfSpace,
    *,
    patches: Patches,
    solve: Callable[..., Contact],
    flow: FlowSettings,
    hardness: ContactLaw,
    deformation: Array | None = None,
    **settings: Any,
) -> Contact:
    """Solve the contact of each measured patch under the same nominal pressure, and join the results side by side.

    If the fluid pressure acts on the patches, the flow through all patches together is solved in the joined gap.

    Parameters
    ----------
    gap0, half_space, hardness, deformation, settings
        Arguments of `solve`; the arrays contain all patches side by side along x2.
    patches : Patches
        The surface, which consists of several measured patches.
    solve : callable
        Function that solves the contact of a single patch.
    flow : FlowSettings
        Settings for the flow through all patches.

    Raises
    ------
    InputError
        The contact law differs from point to point.
    NotConverged
        The contact solver failed.
    """
    if not hardness.is_uniform:
        given = "a contact law that varies over the surface, with several patches"
        raise InputError("hardness", given, "the same contact law at all points of all patches")
    patch_deformations: Iterable[Array | None]
    if deformation is None:
        patch_deformations = [None] * len(patches.widths)
    else:
        patch_deformations = patches.split(deformation)
    contacts = []
    for gap, patch_deformation in zip(patches.split(gap0), patch_deformations, strict=True):
        body = replace(half_space, shape=gap.shape)
        # the gap of first touch is 0 at the highest point of each patch
        patch_gap = np.ascontiguousarray(gap - gap.min())
        contact = solve(
            patch_gap, body, hardness=hardness, deformation=patch_deformation, **settings
        )
        contacts.append(contact)
    joined: dict[str, Any] = {
        "approach": float(np.average([c.approach for c in contacts], weights=patches.widths)),
        "residual": max(c.residual for c in contacts),
        "iterations": max(c.iterations for c in contacts),
        "fft_pairs": sum(c.fft_pairs for c in contacts),
        "half_space": half_space,
    }
    for name in ("pressure", "gap", "plastic_deformation", "plastic"):
        patch_fields = [getattr(c, name) for c in contacts]
        joined[name] = np.concatenate(patch_fields, axis=1)
    coupled = [c for c in contacts if isinstance(c, CoupledContact)]
    if not coupled:
        return Contact(**joined)
    carried = [getattr(c, "carried", 0.0) for c in contacts]
    joined_flow = attempt(solve_surface_flow, joined["gap"], half_space.spacing, flow)
    failed = [c.flow for c in coupled if isinstance(c.flow, Failed)]
    return CoupledContact(
        **joined,
        flow=failed[0] if failed else joined_flow,
        carried=float(np.average(carried, weights=patches.widths)),
        rounds=max(c.rounds for c in coupled),
    )
