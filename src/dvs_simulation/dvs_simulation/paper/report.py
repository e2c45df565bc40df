"""A report in one HTML file: no network, no scripts, figures inside."""

from __future__ import annotations

import base64
from dataclasses import dataclass
from pathlib import Path

from dvs_common.writing import write_text
from dvs_simulation.html_page import page
from dvs_simulation.paper.table import TableRow


@dataclass(frozen=True, slots=True, kw_only=True)
class Picture:
    """A figure of the report.

    Parameters
    ----------
    file
        PNG or GIF file.
    caption
        Text below it.
    """

    file: Path
    caption: str

    @property
    def kind(self) -> str:
        """``png`` or ``gif``."""
        return 'gif' if self.file.suffix == '.gif' else 'png'

    @property
    def data(self) -> str:
        """The file in base 64."""
        return base64.b64encode(self.file.read_bytes()).decode('ascii')


@dataclass(frozen=True, slots=True, kw_only=True)
class Section:
    """A section of the report.

    Parameters
    ----------
    anchor
        Its name within the page.
    title
        Heading.
    paragraphs
        Plain text.
    pictures
        Figures.
    """

    anchor: str
    title: str
    paragraphs: tuple[str, ...]
    pictures: tuple[Picture, ...] = ()


def write_report(sections: list[Section], rows: list[TableRow], path: Path) -> None:
    """Write the report.

    Parameters
    ----------
    sections
        Sections in order; the table follows the section `numbers`.
    rows
        Table.
    path
        File to write.
    """
    text = page('dvs_simulation.paper', 'report.html.j2', sections=sections, rows=rows)
    write_text(path, text)
