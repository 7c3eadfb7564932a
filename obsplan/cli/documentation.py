"""The command that opens the documentation."""

from pathlib import Path

from obsplan.cli.reports import open_in_browser
from obsplan.cli.terminal import say

SITE = Path(__file__).parents[1] / "site" / "html" / "index.html"
MISSING = (
    "the documentation is not built here: in a checkout of obsplan, type "
    "`python -m pip install -e '.[docs]' && python -m sphinx -W -b html -c docs . "
    "obsplan/site/html`, or read its pages in docs/"
)


def docs() -> None:
    """Open the documentation in a browser; it needs no network."""
    from obsplan.types import ObsplanError

    if not SITE.is_file():
        raise ObsplanError(MISSING)
    say(f"The documentation is {SITE}.")
    open_in_browser(SITE)
