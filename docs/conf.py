"""How Sphinx makes the documentation: these pages, and the reference from the docstrings.

`make docs` fails at a link that leads nowhere and at a public name that the reference lacks.
"""

import re
from typing import Any

from sphinx.application import Sphinx
from sphinx.errors import ExtensionError

import accpinn

project = "accpinn"
author = copyright = "The accpinn developers"
version = release = accpinn.__version__
extensions = ["myst_parser", "sphinx.ext.autodoc", "sphinx.ext.napoleon", "sphinx.ext.viewcode"]
exclude_patterns = ["_build"]
default_role = "py:obj"
myst_heading_anchors = 4
autodoc_member_order = "bysource"
autodoc_typehints_format = "short"
autodoc_default_options = {"members": True, "undoc-members": False}
python_maximum_signature_line_length = 88
html_theme = "furo"
html_title = f"accpinn {release}"
html_show_copyright = False


def _require_public_names(app: Sphinx, _: Exception | None) -> None:
    """Refuse a reference without one of the public names."""
    described = {name for name, *_ in app.env.get_domain("py").get_objects()}
    if missing := [name for name in accpinn.__all__ if f"accpinn.{name}" not in described]:
        raise ExtensionError(f"docs/reference.md: {', '.join(missing)} missing; add each there.")


def _keep_bars(
    _app: Sphinx, _kind: str, _name: str, _of: Any, _options: Any, lines: list[str]
) -> None:
    """Let |H| be a magnitude, not a substitution."""
    lines[:] = [line.replace("|", r"\|") for line in lines]


def _without_units(
    _app: Sphinx,
    _kind: str,
    _name: str,
    _of: Any,
    _options: Any,
    signature: str | None,
    result: str,
) -> tuple[str | None, str]:
    """Leave the unit of an annotated number to the docstring."""
    return signature and re.sub(r"Annotated\[(\w+), '[^']*'\]", r"\1", signature), result


def setup(app: Sphinx) -> dict[str, Any]:
    """Connect these."""
    app.connect("autodoc-process-docstring", _keep_bars)
    app.connect("autodoc-process-signature", _without_units)
    app.connect("build-finished", _require_public_names)
    return {"parallel_read_safe": True}
