"""Fenced blocks of Markdown pages: commands to run, and files that they need.

A ``bash`` block is run. A comment on the line before a block says otherwise:
``<!-- not run: REASON -->``, or ``<!-- file: PATH -->`` for a block of any language that is
written to that file first.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path

BLOCK = re.compile(
    r'(?:^<!-- (?P<note>not run|file): (?P<text>[^\n]*?) -->\n)?'
    r'^```(?P<language>\w*)\n(?P<body>.*?)^```$',
    re.MULTILINE | re.DOTALL,
)
# They set up, or run the test that is running: what they do is tested elsewhere.
RECURSIVE = re.compile(r'^\s*(?:\./)?scripts/(?:setup|demo|test|bench)\.sh\b')


@dataclass(frozen=True)
class Block:
    line: int
    language: str
    body: str
    file: str = ''
    not_run: str = ''

    @property
    def commands(self) -> str:
        """What to run of a bash block, without the commands that would recurse."""
        lines = [line for line in self.body.splitlines() if not RECURSIVE.match(line)]
        return '\n'.join(lines).strip()


def blocks_of(page: Path) -> list[Block]:
    text = page.read_text(encoding='utf-8')
    return [
        Block(
            line=text.count('\n', 0, found.start()) + 1,
            language=found['language'],
            body=found['body'],
            file=found['text'] if found['note'] == 'file' else '',
            not_run=found['text'] if found['note'] == 'not run' else '',
        )
        for found in BLOCK.finditer(text)
    ]
