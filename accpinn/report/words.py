"""The report's sentences: what was found, in plain words with its numbers."""

from math import isfinite, isinf

from accpinn.cthp import Parameters
from accpinn.snapshot import Snapshot
from accpinn.uncertainty import Uncertainty

FLAGS = {0: "human drivers", 1: "ACC", 2: "ACC and human drivers in turn"}
METHOD_TITLES = {"pinn": "a physics-inspired neural network (PiNN)"}


def title(snapshot: Snapshot) -> str:
    """The user's name for the result, else what it is about."""
    return snapshot.name or f"How {_followers(snapshot)} follow the vehicle ahead"


def summary(snapshot: Snapshot) -> tuple[str, ...]:
    """The answer first: headway and gains, what they do to disturbances, how sure that is."""
    fit, outline = snapshot.fit, snapshot.outline
    method = METHOD_TITLES.get(fit.method, fit.method)
    opening = (
        f"From {outline.duration:g} s of {outline.source}, {method} learned the constant"
        " time-headway law of"
    )
    if fit.case == "I" and outline.followers > 1:
        first = f"{opening} {_followers(snapshot)} as one set: {law_words(fit.parameters[0])}."
        return (first, *_consequences(snapshot))
    laws = "; ".join(
        f"{label}: {law_words(law)}"
        for label, law in zip(outline.labels[1:], fit.parameters, strict=True)
    )
    return (f"{opening} {_followers(snapshot)}. {laws}.", *_consequences(snapshot))


def law_words(law: Parameters) -> str:
    """Headway first, as drivers know it."""
    tau = f"{law.tau:.2f} s" if isfinite(law.tau) else "not determined"
    return f"time headway τ {tau}, gains α {law.alpha:.4f} 1/s² and β {law.beta:.4f} 1/s"


def _followers(snapshot: Snapshot) -> str:
    labels = snapshot.outline.labels[1:]
    return labels[0] if len(labels) == 1 else f"{len(labels)} vehicles"


def _consequences(snapshot: Snapshot) -> tuple[str, ...]:
    sentences = []
    if snapshot.stability:
        sentences.append(_amplifies(snapshot))
    if snapshot.uncertainty:
        sentences.append(_how_sure(snapshot, snapshot.uncertainty))
    sentences.append(_worth(snapshot))
    return tuple(sentence for sentence in sentences if sentence)


def _amplifies(snapshot: Snapshot) -> str:
    assert snapshot.stability is not None
    vehicles = snapshot.stability.vehicles
    labels = snapshot.outline.labels[1:]
    who = [k for k, vehicle in enumerate(vehicles) if not vehicle.l2.stable]
    if not who:
        growing = any(not vehicle.linf_exact.stable for vehicle in vehicles)
        also = ", though peaks can come out larger (L∞)" if growing else ""
        return f"By these parameters no frequency of a disturbance is amplified{also}."
    worst = max(who, key=lambda k: vehicles[k].peak.gain)
    peak = vehicles[worst].peak
    extent = "without limit" if isinf(peak.gain) else f"up to {peak.gain:.3g} times"
    count = f"{len(who)} of {len(vehicles)} vehicles amplify"
    if len(who) == len(vehicles):
        count = "It amplifies" if len(who) == 1 else f"All {len(who)} vehicles amplify"
    most = "" if len(who) == 1 else f"{labels[worst]} the most: "
    return (
        f"{count} the disturbances of the vehicle ahead, {most}{extent} at"
        f" {peak.omega:.3g} rad/s (a period of {6.283185307 / peak.omega:.0f} s)."
    )


def _how_sure(snapshot: Snapshot, doubt: Uncertainty) -> str:
    labels = snapshot.outline.labels[1:]
    parts = [
        f"{label} {100 * float(l2):.0f} % (L2) and {100 * float(linf):.0f} % (L∞)"
        for label, l2, linf in zip(
            labels, doubt.probability_l2, doubt.probability_linf, strict=True
        )
        if isfinite(float(l2))
    ]
    if not parts:
        return "The data do not determine the parameters well enough to say how sure that is."
    return f"How probable is string stability, by what the data leave open? {'; '.join(parts)}."


def _worth(snapshot: Snapshot) -> str:
    worth = snapshot.assessment
    if worth is None or worth.closed_loop is None:
        return ""
    gaps = ", ".join(f"{value:.1f}" for value in worth.closed_loop.gap_mae)
    sentence = (
        "Driving by itself behind the measured leader, the learned law misses the space-gap by"
        f" {gaps} m in the mean"
    )
    if worth.surrogate is None:
        return f"{sentence}."
    drawn = ", ".join(f"{value:.2f}" for value in worth.surrogate.gap_mae)
    return f"{sentence}; the method's own curve misses it by {drawn} m (surrogate fit)."


def about_data(snapshot: Snapshot) -> tuple[tuple[str, str], ...]:
    """What is known of the recording and the window, as terms and descriptions."""
    outline, facts = snapshot.outline, snapshot.facts
    rows = [
        ("Recording", outline.source),
        ("Campaign", facts.get("campaign")),
        ("Date", facts.get("date")),
        ("Driven by", FLAGS.get(facts.get("acc_flag", -1))),
        ("Distance setting", facts.get("distance_setting")),
        (
            "Window",
            f"{outline.start:g} to {outline.start + outline.duration:g} s of the recording,"
            f" {outline.samples:,} samples every {outline.sample_time:g} s",
        ),
        ("Leader", outline.labels[0]),
        ("Followers", ", ".join(outline.labels[1:])),
        ("Left out", _left_out(snapshot)),
    ]
    return tuple((term, str(value)) for term, value in rows if value)


def _left_out(snapshot: Snapshot) -> str:
    outline = snapshot.outline
    if not outline.left_out:
        return "nothing: every instant of the window counts"
    shares = ", ".join(
        f"{100 * share:.0f} % of {label}"
        for label, share in zip(outline.labels[1:], outline.left_out_share, strict=True)
    )
    return f"{', '.join(outline.left_out)} from the law's equations: {shares}"


def beware(snapshot: Snapshot) -> dict[str, tuple[str, ...]]:
    """What to beware of, by the part of the story that it belongs to."""
    worth, doubt = snapshot.assessment, snapshot.uncertainty
    return {
        "data": (*snapshot.outline.notes, *snapshot.quality.warnings),
        "parameters": tuple(
            dict.fromkeys(
                (
                    *snapshot.fit.notes,
                    *(doubt.notes if doubt else ()),
                    *(worth.whiteness.sentences if worth else ()),
                )
            )
        ),
        "driving": worth.incidents if worth else (),
    }
