"""What the controller of a loop reported of its certificate."""

from __future__ import annotations

from collections.abc import Iterable

from dvs_common.scenario.nodes import CONTROLLER
from dvs_common.wire.cdr import MessageError
from dvs_common.wire.diagnostics import Status, parse_diagnostics
from dvs_hinf_controller.analysis.budget import Budget


def reported_budgets(messages: Iterable[bytes], namespace: str = '') -> list[Budget]:
    """Budgets in messages of /diagnostics, which all loops of a domain share.

    Parameters
    ----------
    messages
        CDR bytes; those that can't be read are passed over.
    namespace
        Namespace of the loop.
    """
    name = f'{namespace}/{CONTROLLER}'.strip('/')
    found = (Budget.reported(s.values) for m in messages for s in _statuses(m) if s.name == name)
    return [budget for budget in found if budget is not None]


def _statuses(message: bytes) -> list[Status]:
    try:
        return parse_diagnostics(message)
    except MessageError:
        return []
