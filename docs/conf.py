"""How Sphinx builds the manual: ``make manual``."""

from __future__ import annotations

import sys
from pathlib import Path

import excite

sys.path.insert(0, str(Path(__file__).parent / "_ext"))

project = "excite"
author = "The excite developers"
release = excite.__version__
extensions = [
    "myst_parser",
    "sphinx.ext.autodoc",
    "sphinx.ext.napoleon",
    "sphinx.ext.mathjax",
    "generated_pages",
]
myst_enable_extensions = ["dollarmath", "deflist", "colon_fence"]
myst_heading_anchors = 3
source_suffix = {".md": "markdown"}
exclude_patterns = ["_ext", "Thumbs.db"]
html_theme = "furo"
html_title = f"excite {release}"
html_copy_source = False
html_show_sourcelink = False
html_show_copyright = False

autodoc_typehints = "signature"
autodoc_member_order = "bysource"
napoleon_google_docstring = True
napoleon_numpy_docstring = False
napoleon_use_ivar = True
# Formulas are drawn by the reader's browser; without a network they stay readable as TeX.
mathjax3_config = {"chtml": {"mtextInheritFont": True}}
