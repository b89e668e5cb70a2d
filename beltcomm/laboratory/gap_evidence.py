"""Evidence of a gap: more than the freedom that its observer gives the carriage.

The observer of a model with a gap follows the carriage by the torque and lets it stray (``process_noise``), so it follows whatever pushes
the carriage: friction that jumped between 8 and 20 N was explained by a gap, 21.6 to 3.5 times the noise, on held-out records as well.
Such a push needs no gap.  So the model is judged against the same one with the gap closed and a carriage that may stray as far: only
what the gap adds to that speaks for it.

    lead = O_closed - O_gap + 2 Σ ln (deviation_closed / deviation_gap)

Both are likelihoods of the same torque, and the closed one has no number less: how far its carriage strays stands for the gap's width.
"""

from __future__ import annotations

from dataclasses import replace

from beltcomm.effects import Effect
from beltcomm.fit.estimate import Fitted, fit
from beltcomm.fit.records import AGITATIONS, Data, negative_log_likelihood, with_process_noise
from beltcomm.fit.residual.observer import needs_observer
from beltcomm.laboratory.acceptance import drop_by, enough, explained_share, loudness
from beltcomm.model import Model

#: Iterations of the fit with the gap closed, and factor by which its carriage may stray further where the largest process noise suits best.
ITERATIONS, WIDER = 6, 3.0
#: Lead, as a multiple of what is asked, that a carriage which strays further does not make up for.
CLEARLY = 4.0


def is_replaceable_gap(data: Data, grown: Fitted, effect: Effect) -> bool:
    """True if an effect is a gap that a carriage which strays can do without."""
    return effect.rattles and needs_observer(grown.model) and not gap_is_supported(data, grown, effect)


def gap_is_supported(data: Data, grown: Fitted, gap: Effect) -> bool:
    """True if a gap may be named beside a carriage that strays without one, by the rule for any effect.

    On friction that jumped, a gap that explained 56 000 nats led by 1000 of them, where both models left 3.4 times the noise.
    Asked of the closed model before its fit, behind it, and as far as its carriage strays then: what comes later is likelier, or nearly so.
    A model that the gap does not lead from ends the question, and so does one behind whose fit it leads by a multiple.

    Parameters
    ----------
    data : Data
        As the model with the gap sees it.
    grown : Fitted
        That model, fitted.
    """
    names = gap.full_names()
    shut = grown.model.with_values({names[0]: 0.0}, "closed")
    loose = with_likeliest_stray(with_stray(data, grown.model[names[0]]), shut)
    begun = fit(loose, shut, 0, fixed=names)
    if not exceeds_threshold(grown, begun):
        return False
    first = fit(loose, shut, ITERATIONS, fixed=names)
    if not exceeds_threshold(grown, first) or exceeds_threshold(grown, first, CLEARLY):
        return exceeds_threshold(grown, first)
    return exceeds_threshold(grown, fit(with_likeliest_stray(loose, first.model), first.model, 0, fixed=names))


def exceeds_threshold(grown: Fitted, closed: Fitted, times: float = 1.0) -> bool:
    """True if a gap explains enough beside a model of the same records without one.

    Parameters
    ----------
    times : float
        So many times over.
    """
    lead = lead_of(grown, closed) / times
    return enough(lead, explained_share(lead, closed), lead, 0.0, closed)


def lead_of(grown: Fitted, closed: Fitted) -> float:
    """By how much a gap is likelier than a carriage that strays without one, nats; below 0 it is less likely."""
    lead = drop_by(closed, grown) + loudness(closed.problem.pieces) - loudness(grown.problem.pieces)
    closed.problem.forget()
    grown.problem.forget()
    return lead


def with_stray(data: Data, width_m: float) -> Data:
    """The records with a carriage that has the freedom of a gap of this width, whatever the model's."""
    fitted, held_out = (tuple(replace(piece, freedom_m=width_m) for piece in pieces) for pieces in (data.fitted, data.held_out))
    return replace(data, fitted=fitted, held_out=held_out)


def with_likeliest_stray(data: Data, model: Model) -> Data:
    """The records with a carriage that strays as far as is likeliest."""
    best = with_process_noise(data, model)
    while best.fitted[0].process_noise == AGITATIONS[-1]:
        wider = with_process_noise(with_stray(best, WIDER * best.fitted[0].freedom_m), model)
        if negative_log_likelihood(wider.fitted, model) >= negative_log_likelihood(best.fitted, model):
            break
        best = wider
    return best
