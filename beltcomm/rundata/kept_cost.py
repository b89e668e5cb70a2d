"""What not knowing an effect costs, kept with the revision that brought it."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from beltcomm.laboratory.diagnosis import Diagnosis
from beltcomm.model import Model
from beltcomm.result import plain
from beltcomm.rundata.cost import cost_lines, cost_or_reason
from beltcomm.rundata.revisions import Revision, keep_cost, model_named
from beltcomm.runfolder import RunFolder


def cost_of(folder: RunFolder, before: Model, after: Model, name: str) -> tuple[dict[str, Any] | None, list[str]]:
    """What an effect costs, for programs and for people."""
    price, reason = cost_or_reason(folder, before, after)
    return (None if price is None else dict(plain(price))), cost_lines(price, reason, name)


def priced(folder: RunFolder, found: Diagnosis, made: list[Revision], whole: dict[str, Any] | None) -> list[Revision]:
    """The revisions of a climb with what their effects together cost, kept with the last.   whole : of all that was named."""
    last = made[-1]
    new = [name for name in last.effects if name not in found.base.model.effects]
    if not new:
        return made
    if set(found.named) - set(last.effects):
        whole, _ = cost_of(folder, found.base.model, model_named(folder, last.name), "")
    kept = None if whole is None else {"of": " and ".join(new), **whole}
    keep_cost(folder, last.name, kept)
    return [*made[:-1], replace(last, cost=kept)]
