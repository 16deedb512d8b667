"""Sphinx settings of the documentation."""

project = "artemis"
extensions = ["myst_parser", "sphinx.ext.autodoc", "sphinx.ext.napoleon"]
html_theme = "furo"
html_title = "artemis"
html_show_sphinx = False
html_copy_source = False
html_show_copyright = False
html_theme_options: dict[str, object] = {"footer_icons": []}
source_suffix = {".md": "markdown"}
exclude_patterns = ["artemis", "artemis_lab", "missions", "scripts", "tests", "packaging", ".ci", "docs/site"]
myst_heading_anchors = 5
autodoc_typehints = "none"
autodoc_member_order = "bysource"
suppress_warnings = ["docutils", "ref.python"]  # docstrings are Google's style in Markdown, not reStructuredText
