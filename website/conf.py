"""How Sphinx makes the website. Read by Sphinx alone; docs/decisions/0036-a-site-by-sphinx.md has the reasons."""

from pathlib import Path

project = "PhysMent MCP"
author = "PhysMent MCP contributors"
project_copyright = author
extensions = ["myst_parser"]
exclude_patterns: list[str] = []
nitpicky = True

# Anchors as code hosts make them, so that a link to a heading holds there and here.
myst_heading_anchors = 4
# Sphinx takes `$` and `:::` as they are written, as code hosts do.
myst_enable_extensions: list[str] = []

html_theme = "furo"
html_title = project
html_static_path = [str(Path(__file__).parent / "static")]
html_css_files = ["site.css"]
html_js_files = ["search.js"]
html_show_sourcelink = False
html_copy_source = False
html_show_sphinx = False
html_permalinks_icon = "#"
pygments_style = "friendly"
pygments_dark_style = "github-dark"
