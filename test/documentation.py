"""What Markdown pages tell a reader to type, and the files that this needs.

A ``bash`` block is run as it is. A comment on the line before a block says otherwise:
``<!-- not run: REASON -->``, or ``<!-- file: PATH -->`` for a block of any language that is
written to that file first. Of a ``console`` block each line after ``$`` is a command.
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
PROGRAM = re.compile(
    r'(?:ros2|rqt|plotjuggler|colcon|rosdep|sudo|apt|apt-get|pip|python3?|mcap|tc|ip|kill'
    r'|timeout|source|bash|export|chmod|git|dvs_closed_loop) '
    r'|(?:\./)?scripts/[\w.]+(?: |$)'
)
REMARK = re.compile(r'\s+# .*$')
HEADING = re.compile(r'^##+ (.*)$', re.MULTILINE)


@dataclass(frozen=True)
class Block:
    line: int
    section: str
    language: str
    body: str
    file: str = ''
    not_run: str = ''

    @property
    def lines(self) -> list[str]:
        """Lines, those that end in a backslash joined with the next."""
        return re.sub(r'\\\n\s*', '', self.body).splitlines()

    @property
    def commands(self) -> str:
        """What to run of a bash block, without the commands that would recurse."""
        lines = [line for line in self.lines if not RECURSIVE.match(line)]
        return '\n'.join(lines).strip()

    @property
    def typed(self) -> list[str]:
        """Commands that a reader types and that are not run with the block as a whole."""
        lines = self.lines
        if self.language == 'console':
            lines = [line[2:] for line in lines if line.startswith('$ ')]
        elif self.language != 'bash':
            lines = []
        elif not self.not_run:
            lines = [line for line in lines if RECURSIVE.match(line)]
        return [REMARK.sub('', line).strip() for line in lines]

    @property
    def stray(self) -> list[str]:
        """Lines that look like commands although the block is not one of commands."""
        if self.language in ('bash', 'console'):
            return []
        return [line for line in self.body.splitlines() if PROGRAM.match(line)]


def blocks_of(page: Path) -> list[Block]:
    text = page.read_text(encoding='utf-8')
    prose = BLOCK.sub(lambda found: ' ' * len(found[0]), text)
    headings = [(found.start(), found[1]) for found in HEADING.finditer(prose)]
    return [
        Block(
            line=text.count('\n', 0, found.start()) + 1,
            section=next((h for start, h in reversed(headings) if start < found.start()), ''),
            language=found['language'],
            body=found['body'],
            file=found['text'] if found['note'] == 'file' else '',
            not_run=found['text'] if found['note'] == 'not run' else '',
        )
        for found in BLOCK.finditer(text)
    ]


def named_in_text(page: Path) -> list[str]:
    """Commands within sentences, in the order of the page."""
    text = BLOCK.sub('', page.read_text(encoding='utf-8'))
    spans = [' '.join(span.split()) for span in re.findall(r'`([^`]+)`', text)]
    return [span for span in spans if PROGRAM.match(span)]
