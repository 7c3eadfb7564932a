"""All items, in the thesis's order."""

from obsplan.thesis import (
    appendix,
    degrees,
    groups,
    horizon,
    inertia,
    penalty,
    study_gramian,
    study_inertia,
    study_speeds,
    tables,
)
from obsplan.thesis.item import Item

MODULES = (
    degrees,
    inertia,
    penalty,
    groups,
    horizon,
    tables,
    appendix,
    study_gramian,
    study_inertia,
    study_speeds,
)
ITEMS: dict[str, Item] = {item.name: item for module in MODULES for item in module.ITEMS}
