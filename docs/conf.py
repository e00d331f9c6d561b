"""How Sphinx makes the site: `make docs`.

The sources are the pages of the repository as they stand (the source folder is the root), so that a link that works
on GitHub works on the site.  Nothing is fetched from the network; tutorials are executed, experiments are not.
"""

import os
import sys
from importlib.metadata import version as version_of
from pathlib import Path

ROOT = Path(__file__).parents[1]
sys.path[:0] = [str(ROOT), str(Path(__file__).parent / "_extensions")]
from pdssjax.core.jax_setup import xla_flags  # noqa: E402  # of this checkout

project = "pdssjax"
author = "pdssjax authors"
release = version_of("pdssjax")

extensions = ["myst_nb", "sphinx_copybutton", "sphinx_design", "sphinx_gallery.gen_gallery", "directives"]

root_doc = "docs/index"
include_patterns = [
    "docs/**",
    "CONTRIBUTING.md",
    "CHANGELOG.md",
    "experiments/liu2015/PROVENANCE.md",
    "benchmarks/results/*.md",
]
# docs/README.md is the list of pages for those who look at the folder on GitHub.
exclude_patterns = [".*", "out", "dist", "build", "docs/README.md", "docs/_*", "**/.ipynb_checkpoints"]
# Of the gallery's pages only those in reStructuredText are read: a copy of each is a notebook.
exclude_patterns += ["docs/examples", "docs/gallery/*.ipynb"]

html_theme = "furo"
html_title = f"pdssjax {release}"
html_static_path = ["_static"]
html_css_files = ["tables.css"]
html_extra_path = ["_static/index.html"]  # leads from the root of the site to docs/index.html
html_copy_source = False
html_show_sphinx = False

myst_enable_extensions = ["colon_fence", "deflist"]
myst_heading_anchors = 4
myst_fence_as_directive = ["mermaid"]
python_maximum_signature_line_length = 88
toc_object_entries_show_parents = "hide"
# Types of other packages are named, not linked: their inventories would have to be fetched.
nitpick_ignore_regex = [("py:.*", ".*")]

# Each script becomes a page with its figures, which begins when it has run; one that fails ends the build.
sphinx_gallery_conf = {
    "examples_dirs": "docs/examples",
    "gallery_dirs": "docs/gallery",
    "abort_on_example_error": True,
    "download_all_examples": False,
    "min_reported_time": 1e9,
    "show_signature": False,
    "within_subsection_order": "FileNameSortKey",
    "write_computation_times": False,
}

# Tutorials: executed, and an error ends the build.  With a warm cache nothing is executed again.
nb_execution_mode = "cache"
nb_execution_cache_path = str(ROOT / "out" / "docs-cache")
nb_execution_raise_on_error = True
nb_execution_timeout = 600
nb_execution_in_temp = True
nb_execution_show_tb = True
nb_merge_streams = True

# Compiled code is kept between notebooks; compiling quickly rather than well, as in tests/conftest.py.
CACHE = ROOT / "out" / "docs-jax-cache"
QUICKLY = (
    "--xla_backend_optimization_level=1 --xla_llvm_disable_expensive_passes=true"
    " --xla_cpu_parallel_codegen_split_count=1"
)
os.environ.setdefault("JAX_COMPILATION_CACHE_DIR", str(CACHE))
os.environ.setdefault("JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS", "0")
os.environ.setdefault("PDSSJAX_CACHE", str(CACHE))
os.environ["XLA_FLAGS"] = " ".join([os.environ.get("XLA_FLAGS", ""), QUICKLY, *xla_flags()]).strip()
os.environ["PATH"] = f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"  # for `!pdssjax`
os.environ["PYTHONPATH"] = os.pathsep.join(filter(None, [str(ROOT), os.environ.get("PYTHONPATH")]))
