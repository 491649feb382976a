"""A layout laid out again without walking along the logs: with every parameter unknown, or with finer steps."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from identify.logs.unknowns import Unknowns
from identify.shooting.blocks import SLIDES, block
from identify.shooting.layout import KNOWN, Family, Layout, Places

Array = NDArray[np.float64]


def with_every_parameter(layout: Layout, unknowns: Unknowns) -> Layout:
    """The same layout with all n_p parameters among its unknowns.

    Args:
        unknowns: of the same model; what is said of the parameters, priors and start, is taken from them.
    """
    free, n_p = layout.free, len(unknowns.names)
    moved = np.concatenate([free, np.arange(free.size, layout.size) + n_p - free.size, [KNOWN]])
    source = unknowns.source

    def family(old: Family) -> Family:
        slots = moved[old.slots]
        theta = slots[:, -source.size :]
        theta[theta == KNOWN] = np.broadcast_to(source, theta.shape)[theta == KNOWN]
        return replace(old, slots=slots)

    def widened(every: Array, old: Array) -> Array:
        return np.concatenate([every, old[free.size :]])

    start = widened(unknowns.start, layout.start)
    mean, sd = widened(unknowns.prior_mean, layout.prior_mean), widened(unknowns.prior_sd, layout.prior_sd)
    places = tuple(Places(**{name: moved[index] for name, index in vars(place).items()}) for place in layout.places)
    for place in places:
        for i in np.flatnonzero(place.own >= n_p).tolist():
            j = place.own[i]
            mean[j], sd[j] = unknowns.own_prior(i, start[j])
    return replace(
        layout,
        unknowns=unknowns,
        free=np.arange(n_p),
        families=tuple(family(old) for old in layout.families),
        scale=widened(unknowns.spread, layout.scale),
        start=start,
        lower=widened(unknowns.lower, layout.lower),
        upper=widened(unknowns.upper, layout.upper),
        prior_mean=mean,
        prior_sd=sd,
        prior_about=np.concatenate([unknowns.prior_about, moved[layout.prior_about[free.size :]]]),
        places=places,
    )


def with_finer_steps(layout: Layout) -> Layout:
    """The same layout with twice as many integration steps in every slide, and cells half as long."""
    model = layout.unknowns.model

    def family(old: Family) -> Family:
        if old.block.kind not in SLIDES:
            return old
        middle = old.edges.mean(axis=2)
        halves = np.stack([old.edges[..., 0], middle, middle, old.edges[..., 1]], axis=2)
        steps = 2 * old.block.n_cells
        return replace(old, block=block(model, old.block.kind, steps), edges=halves.reshape(-1, steps, 2))

    return replace(layout, families=tuple(family(old) for old in layout.families))


def with_coarser_steps(layout: Layout, factor: int) -> Layout:
    """The same layout with so many cells of every slide joined to one integration step; their number divides."""
    model = layout.unknowns.model

    def family(old: Family) -> Family:
        if old.block.kind not in SLIDES:
            return old
        joined = np.stack([old.edges[:, ::factor, 0], old.edges[:, factor - 1 :: factor, 1]], axis=2)
        return replace(old, block=block(model, old.block.kind, joined.shape[1]), edges=joined)

    return replace(layout, families=tuple(family(old) for old in layout.families))
