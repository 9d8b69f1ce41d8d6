"""Sphinx configuration of the website. docs/decisions/0036-a-site-by-sphinx.md gives the reasons."""

from pathlib import Path

project = "PhysMent MCP"
author = "PhysMent MCP contributors"
project_copyright = author
extensions = ["myst_parser"]
exclude_patterns: list[str] = []
nitpicky = True

# Heading anchors as on code hosts, so that links to headings work on both.
myst_heading_anchors = 4
# Sphinx keeps `$` and `:::` literal, as code hosts do.
myst_enable_extensions: list[str] = []

html_theme = "furo"
html_title = project
html_static_path = [str(Path(__file__).parent / "static")]
html_favicon = str(Path(__file__).parent / "static" / "favicon.svg")
html_css_files = ["site.css"]
html_js_files = ["search.js"]
html_show_sourcelink = False
html_copy_source = False
html_show_sphinx = False
html_permalinks_icon = "#"
pygments_style = "a11y-high-contrast-light"
pygments_dark_style = "github-dark"
