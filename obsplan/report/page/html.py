"""The page as one file that opens offline: library, script, style and data within it.

Bokeh's JavaScript draws. It is kept by its own wheel, so nothing is fetched, it has linked axes,
hovering and typed arrays, and it is 1.3 MB in a page, where Plotly's is 4.7 MB. Its Python side is
not loaded: that takes half a second, and the browser needs the numbers only. What is ours is
``player.js``. The page forbids itself the network and any script but these by its own
Content-Security-Policy, in which each has its digest.
"""

import hashlib
from base64 import b64encode
from collections.abc import Sequence
from functools import cache
from html import escape
from importlib.resources import files
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from obsplan.report.page.pack import as_script
from obsplan.types import ObsplanError

LIBRARY = ("bokeh.min.js", "bokeh-api.min.js")


def page(title: str, body: str, scripts: Sequence[str], data: Any) -> str:
    """An HTML document with everything in it; ``body`` is HTML, the title is text."""
    digests = " ".join(f"'{_digest(script)}'" for script in scripts)
    policy = (
        f"default-src 'none'; script-src {digests}; style-src 'unsafe-inline'; "
        "img-src data: blob:; font-src data:; base-uri 'none'; form-action 'none'"
    )
    head = [
        "<!DOCTYPE html>",
        '<html lang="en">',
        "<head>",
        '<meta charset="utf-8">',
        f'<meta http-equiv="Content-Security-Policy" content="{policy}">',
        '<meta name="viewport" content="width=device-width, initial-scale=1">',
        '<meta name="color-scheme" content="light dark">',
        '<link rel="icon" href="data:,">',
        f"<title>{escape(title)}</title>",
        f"<style>{own('page.css')}</style>",
        "</head>",
        "<body>",
    ]
    data_element = f'<script type="application/json" id="data">{as_script(data)}</script>'
    elements = [f"<script>{script}</script>" for script in scripts]
    return "\n".join([*head, body, data_element, *elements, "</body>", "</html>", ""])


def own(name: str) -> str:
    """A file of ours beside this one."""
    return files("obsplan.report.page").joinpath(name).read_text(encoding="utf-8")


@cache
def library() -> tuple[str, ...]:
    """The scripts that draw, of the Bokeh that is installed.

    Raises
    ------
    ObsplanError
        They are not there.
    """
    found = find_spec("bokeh")
    if found is None or found.origin is None:
        raise ObsplanError("report.html needs Bokeh: python -m pip install bokeh")
    folder = Path(found.origin).parent / "server" / "static" / "js"
    try:
        scripts = [(folder / name).read_text(encoding="utf-8") for name in LIBRARY]
    except OSError as error:
        raise ObsplanError(
            f"{error.filename} cannot be read ({error.strerror}): "
            "python -m pip install --force-reinstall bokeh"
        ) from error
    return tuple(_inline(script) for script in scripts)


def _inline(script: str) -> str:
    """A script that no element ends: what would do so stands in its texts only."""
    return script.replace("</script", "<\\/script").replace("<!--", "<\\!--")


@cache
def _digest(script: str) -> str:
    """How a Content-Security-Policy names a script that may run."""
    return "sha256-" + b64encode(hashlib.sha256(script.encode()).digest()).decode()
