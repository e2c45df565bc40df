"""Errors that name what is wrong: the parameter, its value and the rule that it breaks."""

from __future__ import annotations

from typing import ClassVar

_LONGEST_RULE = 2000


class SuiteError(Exception):
    """Anything that the user can mend: reported in one message, without a traceback.

    A command that ends with it has the exit code `exit_code`.
    """

    exit_code: ClassVar[int] = 1


class ParameterError(SuiteError, ValueError):
    """A parameter, argument or field that breaks a rule.

    Parameters
    ----------
    name
        The parameter's name, as the user writes it.
    value
        The offending value.
    rule
        The rule that the value breaks, as the end of the sentence "name = value: rule".
    """

    exit_code = 2

    def __init__(self, name: str, value: object, rule: str) -> None:
        self.name = name
        self.value = value
        self.rule = rule
        super().__init__(f'{name} = {shortened(value)}: {shortened(rule, _LONGEST_RULE)}')


def shortened(value: object, limit: int = 120) -> str:
    """A value as one line of text that is not too long for a log.

    Parameters
    ----------
    value
        Anything.
    limit
        Longest text, characters.
    """
    text = ' '.join(str(value).split())
    return text if len(text) <= limit else text[: limit - 1] + '…'
