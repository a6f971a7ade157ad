"""Configuration of the manual: `python -m sphinx -W -n bondgraph/manual OUT` builds it, without a network."""

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[2]))  # a clone need not be installed

project = "bondgraph"
extensions = ["myst_parser", "sphinx_design", "bondgraph.manual.running", "bondgraph.manual.made"]
exclude_patterns = ["README.md"]
myst_enable_extensions = ["colon_fence"]
myst_heading_anchors = 3
html_theme = "furo"
html_title = "bondgraph"
html_static_path = ["_static"]
html_css_files = ["manual.css"]
html_show_copyright = False
html_copy_source = False
pygments_style = "a11y-high-contrast-light"
pygments_dark_style = "a11y-high-contrast-dark"
