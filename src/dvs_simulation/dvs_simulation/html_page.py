"""HTML pages from templates that stand beside the modules that fill them."""

from __future__ import annotations

from importlib.resources import files

from jinja2 import Environment, StrictUndefined


def page(package: str, template: str, **content: object) -> str:
    """HTML text of a page; what is filled in is escaped.

    Parameters
    ----------
    package
        Package that holds the template.
    template
        Name of its file.
    content
        What the template names.
    """
    environment = Environment(
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
    )
    text = files(package).joinpath(template).read_text(encoding='utf-8')
    return environment.from_string(text).render(**content)
