"""Figures, tables, sentences and files from runs; loaded on use, as are matplotlib and rich."""

from importlib import import_module
from typing import Any

_HOME = {
    "campaign_table": "campaign",
    "compare_figure": "comparison",
    "compare_table": "comparison",
    "comparison_sentences": "comparison",
    "errors_figure": "errors",
    "export_sentences": "export_words",
    "exports_sentences": "export_words",
    "filter_notes": "consistency",
    "free_folder": "files",
    "hearing_notes": "hearing",
    "limit_notes": "verdict",
    "make_export": "export",
    "make_exports": "export",
    "map_figure": "map",
    "path_names": "path_files",
    "planner_notes": "verdict",
    "played": "page.notebook",
    "run_html": "tables",
    "run_notes": "notes",
    "run_table": "tables",
    "scenario_table": "suite",
    "sea_notes": "sea",
    "styled": "style",
    "suite_sentences": "suite",
    "suite_table": "suite",
    "verdicts": "verdict",
    "write_campaign_report": "campaign",
    "write_comparison": "comparison_files",
    "write_free": "files",
    "write_run": "files",
    "write_suite": "suite",
}

__all__ = [*_HOME]  # pyright: ignore[reportUnsupportedDunderAll]


def __getattr__(name: str) -> Any:
    """Load a public name from the module that defines it."""
    if name not in _HOME:
        raise AttributeError(f"module 'obsplan.report' has no public name {name!r}")
    return getattr(import_module(f"obsplan.report.{_HOME[name]}"), name)


def __dir__() -> list[str]:
    return [*__all__]
