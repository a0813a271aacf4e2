"""The simulated cue tables of `datasets/cue-table-example`, made again to the byte.

    python -m taskcomm.cuestudies datasets/cue-table-example

Nobody took part: every press here is a program's.
"""

import math
import sys
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np

from taskcomm.cueworld import CueWorld
from taskcomm.simulate import SimulatedTeacher
from taskcomm.teacher import TableTop, TeacherModel
from taskcomm.wholefile import OutputError, write_whole

SEED = 2026
LIGHTS = CueWorld(("left", "right"))
TEACHER = TeacherModel(
    mistake=0.01,
    approvals={
        "that_left": TableTop("left", peak=0.2, rise=1.5, fall=1.0),
        "that_right": TableTop("right", peak=0.12, rise=1.0, fall=2.0, delay=0.5),
    },
    provenance={"name": "cue-table-example"},
)


def reaction_times(people: int = 12, trials: int = 20) -> Iterator[str]:
    """A psychology experiment with a row a trial: when the light came on, when the key was pressed.

    The light comes on 0.5 to 1.5 s into the trial. The reaction time is log-normal, from 0.22 s up: no
    table-top. In 6 of 100 trials there is none; now and then a press comes for nothing. A trial ends with
    its press, or 2 s after the light came on.
    """
    yield "trial,participant,onset_s,press_s,end_s"
    for person in range(1, people + 1):
        rng = np.random.default_rng([SEED, person])
        speed = 0.15 * rng.standard_normal()
        for number in range(1, trials + 1):
            onset = round(float(rng.uniform(0.5, 1.5)), 2)
            reaction = 0.22 + 0.35 * math.exp(speed + 0.45 * rng.standard_normal())
            press = min(onset + reaction if rng.random() >= 0.06 else math.inf, rng.exponential(40.0))
            end = onset + 2.0
            seen = f"{press:.3f}" if press < end else ""
            yield f"p{person:02d}-{number:02d},p{person:02d},{onset:.2f},{seen},{min(press, end):.3f}"


def lights(people: int = 10, trials: int = 2, steps: int = 100) -> Iterator[str]:
    """A cue table: two lights that go on and off as they please, and simulated teachers of TEACHER."""
    yield "trial_id,participant_id,source,dt,t,press,left,right"
    for person in range(1, people + 1):
        for number in range(1, trials + 1):
            rng = np.random.default_rng([SEED, 100 + person, number])
            teacher = SimulatedTeacher(LIGHTS, TEACHER, LIGHTS.tasks[0])
            on = LIGHTS.start()
            for t in range(steps):
                on ^= {name for name in LIGHTS.cue_names if rng.random() < 0.07}
                cells = [teacher.observe(on, rng), *(name in on for name in LIGHTS.cue_names)]
                named = f"p{person:02d}-{number},p{person:02d},simulated,{TEACHER.dt:g},{t}"
                yield ",".join([named, *(str(int(cell)) for cell in cells)])


def main(arguments: Sequence[str] | None = None) -> int:
    """Write reaction-times.csv, lights.csv and teacher.json, the truth behind lights.csv."""
    chosen = list(sys.argv[1:] if arguments is None else arguments)
    if len(chosen) != 1:
        print("usage: python -m taskcomm.cuestudies FOLDER", file=sys.stderr)
        return 2
    folder = Path(chosen[0])
    try:
        for name, lines in (("reaction-times.csv", reaction_times()), ("lights.csv", lights())):
            write_whole(folder / name, "".join(f"{line}\n" for line in lines).encode())
        TEACHER.save(folder / "teacher.json")
    except OutputError as error:
        print(error, file=sys.stderr)
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
