"""How Sphinx builds the site; ``python -m tools.site`` runs it."""

import sys
from pathlib import Path

ROOT = Path(__file__).parent.parent
sys.path.insert(0, str(ROOT))

project = "planarm"
author = "the authors of planarm"
copyright = author

extensions = ["myst_nb", "sphinx_copybutton", "tools.site.mathml"]
myst_enable_extensions = ["dollarmath"]
myst_heading_anchors = 4
nb_execution_mode = "cache"
nb_execution_raise_on_error = True
nb_execution_timeout = 300

nitpicky = True
html_theme = "furo"
html_title = "planarm"
html_math_renderer = "mathml"
html_show_sphinx = False
copybutton_prompt_text = "$ "
