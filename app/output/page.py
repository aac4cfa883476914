"""Web pages of one file: templates in one style, pictures inside. Not collective."""

from __future__ import annotations

import base64
import io

import jinja2

from app.output.style import write_figure


def template(name, package="app.output", **filters):
    """Template of a package's folder ``templates``; it may extend ``page.html`` and use ``| base64`` for pictures."""
    environment = jinja2.Environment(
        loader=jinja2.ChoiceLoader([jinja2.PackageLoader(package), jinja2.PackageLoader("app.output")]),
        autoescape=True,
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
    )
    environment.filters |= {"base64": lambda data: base64.b64encode(data).decode(), **filters}
    return environment.get_template(name)


def png(figure):
    """Bytes of a figure as a picture in a page."""
    target = io.BytesIO()
    write_figure(figure, target, "png", 100)
    return target.getvalue()
