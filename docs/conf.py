"""How Sphinx builds the site; ``python -m tools.site`` runs it."""

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent.parent))

project = html_title = "planarm"
copyright = "the authors of planarm, MIT licence"

extensions = [
    "myst_nb",
    "sphinx.ext.autodoc",
    "sphinx.ext.napoleon",
    "sphinx_copybutton",
    "tools.site.docstrings",
    "tools.site.mathml",
    "tools.site.tables",
]
myst_enable_extensions = ["dollarmath"]
myst_heading_anchors = 4
nb_execution_mode = "cache"
nb_execution_raise_on_error = True
nb_execution_show_tb = True
nb_execution_timeout = 300

autodoc_member_order = "bysource"
autodoc_type_aliases = {name: name for name in ("Array", "ArrayLike", "Info", "Observation", "Options", "Row")}
autodoc_typehints_format = "short"
default_role = "py:obj"
napoleon_attr_annotations = False
napoleon_use_ivar = True
nitpicky = True
python_maximum_signature_line_length = 88
python_use_unqualified_type_names = True

html_theme = "furo"
html_static_path = ["theme"]
html_css_files = ["site.css"]
html_logo = html_favicon = "theme/logo.svg"
html_copy_source = False
html_math_renderer = "mathml"
html_theme_options = {
    "light_css_variables": {"color-brand-primary": "#2b6a9b", "color-brand-content": "#2b6a9b"},
    "dark_css_variables": {"color-brand-primary": "#6fb3e0", "color-brand-content": "#6fb3e0"},
    "top_of_page_buttons": [],
}
copybutton_prompt_text = "$ "
