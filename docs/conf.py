"""How Sphinx builds these pages: ``make docs``."""

import sys
from pathlib import Path

from sphinx.ext.napoleon.docstring import GoogleDocstring

HERE = Path(__file__).parent
sys.path.insert(0, str(HERE / "_ext"))

import minorloop  # noqa: E402

project = "minorloop"
author = "The minorloop developers"
project_copyright = author
release = version = minorloop.__version__

extensions = [
    "myst_parser",
    "sphinx.ext.autodoc",
    "sphinx.ext.napoleon",
    "sphinx_gallery.gen_gallery",
    "mathml",
    "modules",
    "verbs",
]
exclude_patterns = ["_ext", "gallery/*.ipynb", "gallery/*.py", "gallery/*.zip"]
templates_path: list[str] = []

myst_enable_extensions = ["dollarmath", "amsmath", "colon_fence", "deflist", "fieldlist"]
myst_heading_anchors = 4

html_theme = "furo"
html_title = "minorloop"
html_math_renderer = "mathml"
html_static_path = ["_static"]
html_css_files = ["minorloop.css"]
html_copy_source = False
html_show_sphinx = False
pygments_style = "tango"
pygments_dark_style = "monokai"

# The notebooks are executed here and nowhere else; a warning or an error in one ends the build.
sphinx_gallery_conf = {
    "examples_dirs": "../examples/gallery",
    "gallery_dirs": "gallery",
    "filename_pattern": "",
    "within_subsection_order": "FileNameSortKey",
    "image_scrapers": ("notebooks.figures",),
    "reset_modules": ("notebooks.strictly",),
    "reset_modules_order": "both",
    "abort_on_example_error": True,
    "write_computation_times": False,
    "show_signature": False,
    "min_reported_time": 1e9,
    "ignore_repr_types": "ShownFigure",
    "remove_config_comments": True,
}

# The reference is made of the docstrings; types are in them, with shapes and units.
autodoc_default_options = {
    "members": True,
    "member-order": "bysource",
    # made by scikit-learn, with references into its own pages
    "exclude-members": "set_fit_request,set_predict_request,set_score_request",
}
autodoc_typehints = "none"
toc_object_entries = False
napoleon_google_docstring = False
napoleon_use_param = False
napoleon_use_rtype = False
napoleon_use_ivar = True
smartquotes = False  # "--save" is an option
default_role = "code"
# "In seconds: ..." below a constant is a sentence, not a type and its description.
GoogleDocstring._parse_attribute_docstring = GoogleDocstring._consume_to_end

# Every reference has to lead somewhere. Only bases and aliases that live in other projects
# may lead out of these pages, which are built without a network.
nitpicky = True
nitpick_ignore_regex = [
    (r"py:.*", r"(numpy|scipy|matplotlib|pandas|sklearn|control|dask|distributed)\..*"),
    (r"py:.*", r"(collections|contextlib|typing|enum|pathlib|msgspec|starlette|asyncio)\..*"),
    (r"py:class", r"minorloop\.lab\.drivers\..*\._\w+"),  # sections of a bench file
    (r"py:(class|obj)", r"minorloop_head\.procedures\.values\.Result"),  # a type variable
    (
        r"py:(class|exc)",
        r"(object|Exception|ValueError|OSError|TypeError|ImportError|.*Error|tuple)",
    ),
]
