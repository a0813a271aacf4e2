"""What the data could tell of each parameter, and a verdict on it."""

from typing import Any, Literal, NamedTuple

from learn.intervals import ParameterInterval

Verdict = Literal["informed", "weak", "none", "given"]
AS_NONE = "as good as none"
FEW = 5.0
WIDE = 6.0
IN_SECONDS = (".delay", ".hold")
RULE = (
    f"weak: fewer than {FEW:.0f} expected presses bear on it, or its interval is open above or spans more"
    f" than a factor of {WIDE:.0f}, or only a ratio of it is known, or it is a decay and none is as likely;"
    " none: no data, it stays where it was"
)


class Audited(NamedTuple):
    """One parameter: the expected steps and presses whose probability it changes, the verdict and why."""

    parameter: str
    steps: float
    presses: float
    verdict: Verdict
    why: str

    def to_dict(self) -> dict[str, Any]:
        """Plain values."""
        return self._asdict()


def audited(
    parameter: str, steps: float, presses: float, mark: str, interval: ParameterInterval | None = None
) -> Audited:
    """The verdict on one parameter, from what bears on it, its `mark` and, where there is one, its interval.

    "given": not learned. "none": no step bears on it, and it keeps its starting value. "weak": fewer than
    FEW expected presses bear on it (five would leave the logarithm of a probability a standard error of
    1 / sqrt(5), about 0.45); or only its ratio to others is known; or a decay is as good as none; or the
    interval is open above, or spans more than a factor of WIDE, as that of five presses would.
    "informed": else.

    >>> audited("that_mov.rise", 40.0, 3.2, "").verdict
    'weak'
    >>> audited("that_mov.rise", 40.0, 30.0, "at a kink").verdict
    'informed'
    """
    why = _why_weak(parameter, presses, mark, interval)
    verdict: Verdict = "weak" if why else "informed"
    if mark == "fixed":
        verdict, why = "given", "not learned"
    elif mark == "no data":
        stays = "no step has every level at 0" if parameter == "mistake" else "it stays where it was"
        verdict, why = "none", stays
    elif mark == "flat":
        verdict, why = "none", "nothing near it changes the likelihood"
    return Audited(parameter, steps, presses, verdict, why)


def _why_weak(parameter: str, presses: float, mark: str, interval: ParameterInterval | None) -> str:
    if mark == "ridge":
        return "only a ratio is known"
    if mark == AS_NONE:
        return "as likely without"
    if presses < FEW:
        return f"{presses:.1f} presses"
    if interval is None or interval.low is None or interval.high is None:
        return ""
    if interval.open_high:
        return "its interval is open above"
    if not parameter.endswith(IN_SECONDS) and interval.high > WIDE * interval.low:
        return f"its interval spans a factor above {WIDE:.0f}"
    return ""
