"""How a fit is to be made."""

from dataclasses import asdict, dataclass, replace
from typing import Any, Literal

from learn.coordinates import Bounds
from learn.mstep import MistakePrior
from learn.prior import Prior

Freedom = bool | Literal["shared"]


@dataclass(frozen=True)
class Settings:
    """What `fit` was asked for; its options are described there.

    Raises ValueError naming the setting.
    """

    delays: Freedom = False
    decays: Freedom = False
    holds: Freedom = False
    starts: int = 6
    max_iter: int = 500
    rtol: float = 1e-8
    prior: Prior | None = None
    mistake_prior: MistakePrior | None = MistakePrior()  # noqa: RUF009 (frozen)
    bounds: Bounds = Bounds()  # noqa: RUF009 (frozen)
    task_prior: tuple[float, ...] | None = None
    observe: tuple[str, ...] = ()
    labels: bool = False
    dropped_mass: float = 0.0
    search: bool = True
    seed: int = 0

    def __post_init__(self) -> None:
        if isinstance(self.observe, str):
            raise ValueError(f"observe: must be a list of names, not {self.observe!r}")
        object.__setattr__(self, "observe", tuple(dict.fromkeys(self.observe)))
        if self.task_prior is not None:
            object.__setattr__(self, "task_prior", tuple(map(float, self.task_prior)))
        for name in ("starts", "max_iter"):
            if getattr(self, name) < 1:
                raise ValueError(f"{name}: must be at least 1, not {getattr(self, name)}")
        if not 0 <= self.dropped_mass < 0.1:
            raise ValueError(f"dropped_mass: must be at least 0 and below 0.1, not {self.dropped_mass}")
        for name in ("delays", "decays", "holds"):
            if getattr(self, name) not in (False, True, "shared"):
                raise ValueError(f"{name}: must be False, True or 'shared', not {getattr(self, name)!r}")

    @property
    def shared(self) -> tuple[str, ...]:
        """The parameters that are one for all approval states."""
        return tuple(name for name in ("delay", "decay", "hold") if getattr(self, f"{name}s") == "shared")

    def to_dict(self) -> dict[str, Any]:
        """Plain values, for provenance."""
        return asdict(replace(self, prior=None)) | {"prior": self.prior and self.prior.to_dict()}
