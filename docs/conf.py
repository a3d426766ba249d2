"""Settings of the documentation: ``python -m sphinx -W --keep-going -b html docs docs/_build``."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

DOCS = Path(__file__).parent
sys.path[:0] = [str(DOCS / "extensions"), str(DOCS.parent)]

import cvkern  # noqa: E402

project = "cvkern"
author = "the authors of cvkern"
copyright = f"{author}; Apache-2.0"
version = release = cvkern.__version__

extensions = [
    "sphinx.ext.autodoc",
    "sphinx.ext.autosummary",
    "sphinx.ext.viewcode",
    "numpydoc",
    "myst_parser",
    "sphinx_gallery.gen_gallery",
    "equations",
    "measured",
    "names",
    "pictured",
    "reference",
]
exclude_patterns = ["_build", "examples"]
source_suffix = {".md": "markdown", ".rst": "restructuredtext"}
nitpicky = False
suppress_warnings = ["config.cache"]  # the settings of the gallery hold functions

myst_enable_extensions = ["colon_fence", "dollarmath", "deflist"]
myst_heading_anchors = 3

autodoc_typehints = "none"
autodoc_member_order = "bysource"
autosummary_generate = False
numpydoc_show_class_members = False
viewcode_line_numbers = True
python_use_unqualified_type_names = True
add_module_names = False
toc_object_entries = False
default_role = "literal"


def _plain_figures(_gallery: dict[str, Any], _file: str) -> None:
    """Give every example figures without margins, in the colours of the pages."""
    import matplotlib as mpl
    import matplotlib.pyplot as plt
    from cycler import cycler

    plt.rcdefaults()
    mpl.rcParams.update(
        {
            "figure.dpi": 110,
            "savefig.bbox": "tight",
            "savefig.pad_inches": 0.03,
            "figure.constrained_layout.use": True,
            "figure.constrained_layout.w_pad": 0.02,
            "figure.constrained_layout.h_pad": 0.02,
            "axes.titlesize": 10,
            "axes.spines.top": False,
            "axes.spines.right": False,
            "axes.prop_cycle": cycler(color=["#2f6db3", "#d9541e", "#3c9a5f", "#7b3fa0"]),
            "animation.html": "jshtml",
        }
    )


sphinx_gallery_conf = {
    "examples_dirs": "examples",
    "gallery_dirs": "_generated/gallery",
    "backreferences_dir": "_generated/backreferences",
    "doc_module": ("cvkern",),
    "filename_pattern": r"/plot_",
    "within_subsection_order": "FileNameSortKey",
    "reset_modules": (_plain_figures,),
    "abort_on_example_error": False,  # a failed example is a warning, and so an error, at the end
    "remove_config_comments": True,
    "download_all_examples": False,
    "show_memory": False,
    "show_signature": False,
    "min_reported_time": 5,
    "thumbnail_size": (480, 320),
    "write_computation_times": False,
}

html_theme = "pydata_sphinx_theme"
html_title = f"cvkern {release}"
html_static_path = ["static"]
html_css_files = ["cvkern.css"]
html_copy_source = False
html_show_sourcelink = False
html_show_sphinx = False
html_theme_options: dict[str, Any] = {
    "logo": {"text": "cvkern"},
    "navbar_align": "left",
    "show_prev_next": False,
    "secondary_sidebar_items": ["page-toc"],
    "footer_start": ["copyright"],
    "footer_end": [],
    "pygments_light_style": "a11y-high-contrast-light",
    "pygments_dark_style": "a11y-high-contrast-dark",
    "navigation_with_keys": False,
    "show_toc_level": 2,
    "header_links_before_dropdown": 7,
}
html_sidebars = {"index": [], "measured": [], "built": [], "gallery": []}
