"""`make bench-estep`: the E-step against pomegranate's DenseHMM and dynamax: the same answers, one thread."""

import argparse
import json
import os
import subprocess
import sys
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from benchmarks.estep.problem import Floats, simulated, write
from benchmarks.planner.peers.__main__ import installed

HERE, BUILD = Path(__file__).parent, Path("build") / "bench-estep"
EQUAL, NEEDED = 1e-9, 20.0
ONE_THREAD = {
    "OMP_NUM_THREADS": "1",
    "OPENBLAS_NUM_THREADS": "1",
    "MKL_NUM_THREADS": "1",
    "NUMBA_NUM_THREADS": "1",
    "XLA_FLAGS": "--xla_cpu_multi_thread_eigen=false intra_op_parallelism_threads=1",
    "JAX_PLATFORMS": "cpu",
}
OURS = "E-step"
TEXT = """\
One cue, always on; rise = fall = 2 s, steps of 0.5 s: the teacher as a chain of 12 states (level reached,
mental state) with a constant transition matrix. {trials} simulated trials of {steps} steps, float64, every
way on the same one core, all ways in turn, {rounds} rounds; processor time, compilation apart.
  time   of a trial, as a multiple of our E-step's (Evidence.expect on the lattice of the model): in a round
         the least of the runs of a tenth of a second; median over the rounds of the ratio, and quartiles
Our E-step gives log-likelihood, P(memory, reason) at every press, P(memory), and the rates in every
parameter; ours forward and backward, and the peers, log-likelihood and posterior probabilities alone, and
transition counts where it says so.
"""


@dataclass
class Way:
    """A process that computes the answers, and times itself when asked."""

    name: str
    process: "subprocess.Popen[str]"
    answer: Path
    version: str = ""
    forms: list[str] = field(default_factory=list)
    seconds: dict[str, list[float]] = field(default_factory=dict)

    def hello(self) -> None:
        """Wait until it has its answers."""
        said = json.loads(self._line())
        self.version, self.forms = said["version"], said["forms"]
        self.seconds = {form: [] for form in self.forms}

    def once(self) -> None:
        """One more run of every form."""
        for form in self.forms:
            assert self.process.stdin is not None
            self.process.stdin.write(form + "\n")
            self.process.stdin.flush()
            self.seconds[form].append(float(self._line()))

    def _line(self) -> str:
        assert self.process.stdout is not None
        line = self.process.stdout.readline()
        if not line:
            raise RuntimeError(f"{self.name} ended with {self.process.wait()}")
        return line


def begin(name: str, python: Path | str, script: str, problem: Path) -> Way:
    """Start a way on one core, with one thread."""
    answer = BUILD / f"{name}.npz"
    answer.unlink(missing_ok=True)
    process = subprocess.Popen(
        [str(python), str(HERE / script), str(problem), str(answer)],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
        env=os.environ | ONE_THREAD,
    )
    return Way(name, process, answer)


def furthest(ours: Path, theirs: Path) -> float:
    """The greatest difference of any log-likelihood, or of any P(mental state) at a press."""
    one, two = np.load(ours), np.load(theirs)
    return max(float(np.abs(one[key] - two[key]).max()) for key in ("log_likelihood", "at_presses"))


def ratios(way: Way, form: str, ours: Way) -> Floats:
    """Quartiles of the ratio of times within a round."""
    each = np.array(way.seconds[form]) / np.array(ours.seconds[OURS])
    return np.asarray(np.quantile(each, [0.25, 0.5, 0.75]), dtype=np.float64)


def main() -> int:
    parser = argparse.ArgumentParser(prog="make bench-estep", description=__doc__)
    parser.add_argument("--trials", type=int, default=1000)
    parser.add_argument("--steps", type=int, default=100)
    parser.add_argument("--rounds", type=int, default=15)
    chosen = parser.parse_args()
    if hasattr(os, "sched_setaffinity"):
        os.sched_setaffinity(0, {max(os.sched_getaffinity(0))})  # children inherit it
    print(TEXT.format(**vars(chosen)), flush=True)
    BUILD.mkdir(parents=True, exist_ok=True)
    problem = BUILD / "problem.npz"
    write(problem, simulated(chosen.trials, chosen.steps))
    ways = [begin("taskcomm", sys.executable, "ours.py", problem)]
    ways.append(begin("pomegranate", sys.executable, "with_pomegranate.py", problem))
    dynamax = installed("dynamax")
    if isinstance(dynamax, Path):
        ways.append(begin("dynamax", dynamax, "with_dynamax.py", problem))
    else:
        print(f"dynamax could not be installed here: {dynamax}")
    for way in ways:
        way.hello()
    apart = {way.name: furthest(ways[0].answer, way.answer) for way in ways[1:]}
    for _ in range(chosen.rounds):
        for way in ways:
            way.once()
    for way in ways:
        way.process.communicate()
    return told(ways, apart)


def told(ways: list[Way], apart: dict[str, float]) -> int:
    """Print and keep the figures; 1 where answers differ or ours is not fast enough."""
    ours, rows = ways[0], []
    for way in ways:
        print(way.version + (f": answers equal to {apart[way.name]:.1e}" if way is not ours else ""))
        for form in way.forms:
            low, middle, high = ratios(way, form, ours)
            rows.append({"way": way.version, "form": form, "time": middle, "quartiles": [low, high]})
            print(f"  {form:52s} {middle:8.2f} ({low:.2f} to {high:.2f})")
    fastest = min(row["time"] for row in rows if row["way"] != ours.version)
    print(f"\nthe fastest form of the peers takes {fastest:.1f} times as long; asked for: {NEEDED:g}")
    kept = {"rows": rows, "apart": apart, "fastest_peer": fastest}
    (BUILD / "rows.json").write_text(json.dumps(kept, indent=1) + "\n", encoding="utf-8")
    print(f"in {BUILD}: rows.json")
    return int(fastest < NEEDED or max(apart.values()) > EQUAL)


if __name__ == "__main__":
    sys.exit(main())
