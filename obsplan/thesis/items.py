"""All items, in the thesis's order."""

from obsplan.thesis import (
    appendix,
    baselines,
    degrees,
    groups,
    horizon,
    inertia,
    penalty,
    study_blend,
    study_gramian,
    study_inertia,
    study_measure,
    study_speeds,
    tables,
)
from obsplan.thesis.item import Item

CHAPTERS: tuple[tuple[Item, ...], ...] = (
    (baselines.GEOMETRY,),
    degrees.ITEMS,
    inertia.ITEMS,
    penalty.ITEMS,
    groups.ITEMS,
    horizon.ITEMS,
    tables.ITEMS,
    baselines.BASELINES,
    appendix.ITEMS,
    study_gramian.ITEMS,
    study_blend.ITEMS,
    study_inertia.ITEMS,
    study_speeds.ITEMS,
    study_measure.ITEMS,
)
ITEMS: dict[str, Item] = {item.name: item for chapter in CHAPTERS for item in chapter}
