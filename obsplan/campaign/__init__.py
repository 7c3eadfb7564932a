"""Campaigns: thousands of missions flown, kept, and read as one table."""

from obsplan.campaign.execute import Report, fly_campaign
from obsplan.campaign.plan import Cell, plan_cells
from obsplan.campaign.table import load_campaign

__all__ = ["Cell", "Report", "fly_campaign", "load_campaign", "plan_cells"]
