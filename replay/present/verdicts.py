"""What `learn` says of each output of a process in the end, and how far a loop with it is from instability."""

from collections.abc import Sequence
from typing import Any

from wrenchgap.learn.identify.observer import OBSERVER
from wrenchgap.learn.process.gp import Caution, CautionKind, GaussianProcess
from wrenchgap.learn.process.held_out_time import Decision, Reason, Verdict
from wrenchgap.plant.stability import Margin
from wrenchgap.replay.present.numbers import entries, share
from wrenchgap.replay.present.tables import Line, Part

_WHY = {
    Reason.HELPS: "held-out time supports it",
    Reason.NOTHING: "nothing is missing above the noise of the sensors",
    Reason.LAG: "what is missing is a lag; name it (`wrenchgap explain`) and lead it with --lead",
    Reason.WORSE: "on unseen flights the GP increases the error",
    Reason.INPUTS: "something is missing that the command does not determine: name effects, or see --inputs",
    Reason.EXCITATION: "the flight does not show what the residual depends on: a flight with excitation on this axis",
    Reason.LONGER: "too few samples to hold time out: a longer flight",
}
_HEAD = {Decision.COMPENSATE: "compensate", Decision.DO_NOT: "do not compensate", Decision.NEEDS: "needs more"}


def verdict(one: Verdict, warnings: Sequence[Caution] = ()) -> str:
    """One output, in one sentence, which says what the warnings of the same process say of it."""
    words = f"{one.output}: {_HEAD[one.decision]}: {_WHY[one.reason]}"
    if one.decision is Decision.COMPENSATE:
        _, low, high = one.reduction
        words += f" (gain {one.gain:.2f}, rms {share(one.reduction[0])} smaller, {share(low)} to {share(high)})"
        if any(w.kind is CautionKind.NOT_WORTH_IT and one.output in w.axes for w in warnings):
            words += "; but on unseen flights something simpler does as well, see the warning: prefer that"
    return words + "."


def verdicts(gp: GaussianProcess) -> list[Part]:
    """The last lines of `learn`: a verdict for each output."""
    found = gp.provenance.verdicts
    styles = {Decision.COMPENSATE: "bold green", Decision.DO_NOT: "bold red", Decision.NEEDS: "bold yellow"}
    said = gp.provenance.warnings
    return [Line(f"verdict on {verdict(one, said)}", styles[one.decision]) for one in found]


def verdicts_json(gp: GaussianProcess) -> list[dict[str, Any]]:
    """The key `verdicts` of the `learn` schema."""
    said = gp.provenance
    names = ("output", "decision", "reason", "gain", "reduction")
    return [{**entries(one, *names), "summary": verdict(one, said.warnings)} for one in said.verdicts]


def margin_in_words(found: Margin, most: float = 1e3) -> str:
    """The stability check before flight, in one sentence; margins above `most` are of no interest."""
    size = f"above {most:g}" if found.least > most else f"{found.least:.2f}"
    words = (
        f"stability margin: {size} (99 % of the commands; actuators with a lag of {1e3 * found.lag:.0f} ms and a delay "
        f"of {1e3 * found.delay:.0f} ms): "
    )
    if found.least >= 1.0:
        return words + "the attitude loop is stable whether the slope that was learnt is there or not."
    return words + "below 1 the attitude loop is not guaranteed to be stable if the slope that was learnt is not there."


_GAINS = {
    "log": "the controller's gains as found in the log",
    "model": "the gains of the model file",
    "typical": "gains that are usual for a vehicle of this size: neither log nor model file says them",
}


def observer_in_words(gp: GaussianProcess) -> str:
    """The observer that log and loop support and its margin, in one sentence; empty where nobody looked."""
    said = gp.provenance
    if not said.loop_delay:
        return ""
    peak = "infinite: it is unstable" if said.observer_peak is None else f"{said.observer_peak:.2f}"
    loop = (
        f"(M_s, the peak of the sensitivity of the attitude loop, behind a lag of {1e3 * said.loop_lag:.0f} ms and a "
        f"delay of {1e3 * said.loop_delay:.0f} ms; {_GAINS.get(said.gains, _GAINS['model'])})"
    )
    most = f"{OBSERVER.most_sensitive:g}"
    if said.observer_hz is None and said.observer_left is not None:
        return (
            f"observer: none, the best would leave {100 * said.observer_left:.0f} % of what is left without one; "
            f"M_s is {peak} {loop}."
        )
    if said.observer_hz is None:
        return f"observer: none, no bandwidth keeps M_s at or below {most}; without one it is {peak} {loop}."
    told = f"told a lag of {1e3 * said.observer_lag:.0f} ms" if said.observer_lag else "told no lag"
    hz = f"{said.observer_hz:.2g} Hz"
    return f"observer of what the GP leaves: {hz}, {told}; M_s is {peak}, at most {most} is wanted {loop}."


def observer_json(gp: GaussianProcess) -> dict[str, Any] | None:
    """The key `observer` of `learn` and `counterfactual`; None where nobody looked."""
    said = gp.provenance
    if not said.loop_delay:
        return None
    return {
        **entries(said, "hz=observer_hz", "lag_s=observer_lag", "sensitivity_peak=observer_peak", "left=observer_left"),
        "loop": entries(said, "lag_s=loop_lag", "delay_s=loop_delay", "gains"),
        "summary": observer_in_words(gp),
    }


def lags_in_words(gp: GaussianProcess) -> list[str]:
    """What the process does not take for a function: a lag, and components that the flights do not show."""
    late = [f"{axis} {1e3 * lag:.0f} ms" for axis, lag in zip(gp.outputs, gp.provenance.lags, strict=False) if lag]
    blind = ", ".join(gp.settings.blind)
    return [
        f"lag behind the commands, not learnt as a function: {', '.join(late)}." if late else "",
        f"the flights do not show how the wrench depends on the commanded {blind}: there the GP leaves it to physics."
        if blind
        else "",
    ]
