"""The documentation site: ``make docs`` builds it into out/site. Pages are Markdown (MyST); those with cells run."""

import hashlib
import importlib
import inspect
import os
import re
import shutil
import sysconfig
import textwrap
from importlib.metadata import version as version_of
from pathlib import Path

import jinja2
from docutils import nodes

ROOT = Path(__file__).resolve().parents[1]
FILLED = ("physics/effects", "reference/commands", "reference/environments")
"""Pages that are templates: a section for each effect, for each command, the text of each environment."""


def code_digest():
    """A digest of the code that pages run, so that they run again where it has changed."""
    files = (path for room in ("docs", "drillenv", "controllers", "training") for path in (ROOT / room).rglob("*.py"))
    return hashlib.sha256(b"".join(path.read_bytes() for path in sorted(files))).hexdigest()[:16]


def command_help():
    """The help of each command that has none below it, by its name."""
    from drillenv.cli import _parser
    from drillenv.cli_options import commands_below

    found = {}
    for command in commands_below(_parser()):
        command.add_rest()
        if not any(commands_below(command)):
            found[command.prog] = command.format_help()
    return found


project = "drillenv"
author = "the drillenv authors"
version = release = version_of("drillenv")
extensions = [
    "myst_nb",
    "sphinx.ext.autodoc",
    "sphinx.ext.napoleon",
    "sphinx.ext.mathjax",
    "sphinx-mathjax-offline",  # MathJax within the site: nothing is loaded from elsewhere
    "sphinx_copybutton",
    "sphinx_design",
]
source_suffix = {".md": "myst-nb"}
exclude_patterns = ["_build", "play"]
highlight_language = "text"

html_theme = "furo"
html_title = "drillenv"
html_static_path = ["_static"]
html_css_files = ["site.css"]
html_show_copyright = False

myst_enable_extensions = ["attrs_inline", "colon_fence", "deflist", "dollarmath"]
myst_heading_anchors = 3

nb_execution_mode = "cache"
nb_execution_cache_path = str(ROOT / "out" / "docs-cache" / code_digest())
nb_execution_timeout = 300
nb_execution_raise_on_error = True
nb_execution_show_tb = True
nb_merge_streams = True
nb_render_markdown_format = "gfm"

autodoc_typehints = "none"  # shapes and units stand in the docstrings
autodoc_mock_imports = ["minari"]
autodoc_member_order = "bysource"
napoleon_google_docstring = True
napoleon_numpy_docstring = False
napoleon_use_ivar = True

nitpicky = True
nitpick_ignore_regex = [
    ("py:class", r"(?!drillenv\.).*"),  # what napoleon takes for a type
    ("py:(func|meth|mod|data|exc)", r".*"),  # docstrings name inner functions too, which have no page
]

# cells call the commands of this very installation
os.environ["PATH"] = os.pathsep.join([sysconfig.get_path("scripts"), os.environ.get("PATH", "")])
os.environ["PYTHONPATH"] = os.pathsep.join([str(ROOT), str(ROOT / "docs"), os.environ.get("PYTHONPATH", "")])


def markdown_docstring(name):
    """The docstring of a class that is written in Markdown, as Gymnasium's are, its arguments as a block of text."""
    module, kind = name.rsplit(".", 1)
    text = inspect.getdoc(getattr(importlib.import_module(module), kind))
    text = re.sub(r"^#", "##", re.sub(r":\w+:`", "`", text), flags=re.MULTILINE)
    blocks = re.compile(r"^(Args|Raises):\n((?:    .*\n?|\n)+)", flags=re.MULTILINE)
    return blocks.sub(lambda each: f"{each[1]}:\n\n```text\n{textwrap.dedent(each[2]).strip()}\n```\n\n", text)


def tidy(app, what, name, obj, options, lines):
    """Keep napoleon from reading the first words of a remark on an attribute, up to a colon, as its type."""
    if lines and lines[0].startswith("Alias for field number"):  # what Python says of a field without a remark
        lines.clear()
    elif what in ("attribute", "data", "property"):
        lines[:0] = ["..", ""]  # an empty comment


def fill(app, name, source):
    """Fill in the pages that have a section for each effect or command."""
    if name in FILLED:
        from drillenv.dynamics.effects import LIBRARY

        os.environ["COLUMNS"] = "84"  # what argparse wraps at
        page = jinja2.Environment(trim_blocks=True, lstrip_blocks=True).from_string(source[0])
        source[0] = page.render(effects=LIBRARY.values(), commands=command_help(), told=markdown_docstring)


def drop_magic(app, tree):
    """Show shell commands, and files that a cell writes, without the line that makes a notebook do so."""
    for node in list(tree.findall(nodes.literal_block)):
        magic, _, text = node.astext().partition("\n")
        if magic.startswith("%%"):
            shown = nodes.literal_block(text, text, **node.attributes)
            if magic == "%%bash":
                shown["language"] = "bash"
            node.replace_self(shown)


def add_playground(app, error):
    """Put the page to play with into the site; it needs nothing of it."""
    if error is None and app.builder.format == "html":
        shutil.copytree(ROOT / "docs" / "play", Path(app.outdir) / "play", dirs_exist_ok=True)


def setup(app):
    """Connect all of them."""
    app.connect("autodoc-process-docstring", tidy, priority=400)  # before napoleon
    app.connect("source-read", fill)
    app.connect("doctree-read", drop_magic)
    app.connect("build-finished", add_playground)
