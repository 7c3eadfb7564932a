"""All items, in the thesis's order."""

from obsplan.thesis import appendix, groups, horizon, inertia, penalty, tables
from obsplan.thesis.item import Item

ITEMS: dict[str, Item] = {item.name: item for module in (inertia, penalty, groups, horizon, tables, appendix) for item in module.ITEMS}
