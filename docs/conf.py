"""How Sphinx builds the documentation: ``python -m sphinx -W -b html -c docs . obsplan/site``.

The source is the whole checkout, so that links between README, docs and notebooks are the same
files on the site as in a repository's browser.
"""

import sys
from pathlib import Path

from obsplan import __version__

sys.path.insert(0, str(Path(__file__).parent))  # for the extensions below

project = "obsplan"
author = "the authors of obsplan"
project_copyright = author
release = version = __version__

extensions = [
    "myst_nb",  # Markdown, and notebooks as they are stored
    "sphinx.ext.autodoc",
    "sphinx.ext.napoleon",
    "sphinx_copybutton",
    "docstrings",
    "generated",
    "mathematics",
]
root_doc = "docs/index"
include_patterns = ["docs/**", "notebooks/*.ipynb", "CONTRIBUTING.md", "CHANGELOG.md"]
exclude_patterns = [".*", "obsplan", "formulations", "tests", "build", "dist"]

myst_enable_extensions = ["dollarmath", "deflist"]
myst_heading_anchors = 3
nb_execution_mode = "off"  # outputs are stored, and the tests hold them fresh
nb_merge_streams = True
suppress_warnings = ["mystnb.unknown_mime_type"]

default_role = "py:obj"
add_module_names = False
autodoc_member_order = "bysource"
autodoc_default_options = {"members": True}
napoleon_google_docstring = False
napoleon_use_rtype = False
python_use_unqualified_type_names = True

html_theme = "furo"
html_title = "obsplan"
html_static_path = ["static"]
html_css_files = ["site.css"]
html_additional_pages = {"index": "to_front_page.html"}
templates_path = ["templates"]
html_copy_source = False
html_show_sphinx = False
copybutton_exclude = ".linenos, .gp, .go"
