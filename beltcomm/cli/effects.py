"""``beltcomm effects``: the catalogue of physical effects."""

from __future__ import annotations

import click

from beltcomm.cli import completion
from beltcomm.cli import options as shared
from beltcomm.cli.frame import Invocation


@click.command("effects")
@click.argument("name", required=False, shell_complete=completion.effects)
@shared.output_options
@click.pass_obj
def command(frame: Invocation, /, name: str | None) -> int:
    """List the physical effects a model can have, or all about the one called NAME.

    Example: beltcomm effects cogging
    """
    from beltcomm.effects import EFFECTS, effect_named
    from beltcomm.language import told
    from beltcomm.quantities import span_words

    chosen = EFFECTS if name is None else (effect_named(name),)
    data = {
        "effects": [
            {
                "name": effect.name,
                "title": effect.title,
                "slot": effect.slot,
                "seen": effect.seen,
                "causes": effect.causes,
                "check": effect.check,
                "remedy": effect.remedy,
                "twins": list(effect.twins),
                "separate": effect.separate,
                "apart": {
                    twin: {"shows": apart.shows, "records": [dict(r) for r in apart.records], "by_hand": [h.words() for h in apart.hands]}
                    for twin, apart in effect.apart.items()
                },
                "alike": dict(effect.alike),
                "source": effect.source,
                "parameters": [
                    {"name": p.name, "unit": p.unit, "side": p.side, "low": p.low, "high": p.high, "meaning": p.meaning}
                    for p in effect.parameters
                ],
            }
            for effect in chosen
        ]
    }
    if name is None:
        from beltcomm.result import table

        frame.print(data, table(["effect", "what it is"], [(effect.name, told(effect.title)) for effect in chosen]))
        return 0
    effect = chosen[0]
    frame.print(
        data,
        [
            f"{effect.name}: {told(effect.title)}",
            f"What you see: {effect.seen}",
            f"Usual causes: {effect.causes}",
            f"What to check: {effect.check}",
            f"Remedy: {effect.remedy}",
            *([f"A diagnosis looks for it {effect.sought}."] if effect.sought else []),
            *([f"Looks alike in the records: {', '.join(effect.twins)}; to tell apart: {effect.separate}"] if effect.twins else []),
            *(f"By hand, {twin}: {hand.words()}" for twin, apart in effect.apart.items() for hand in apart.hands),
            *(f"Looks like {other}: {how}" for other, how in effect.alike.items()),
            *(f"  {p.name} ({p.side} side), {span_words(p.low, p.high, p.unit)}: {p.meaning}" for p in effect.parameters),
            f"Source: {effect.source}",
        ],
    )
    return 0
