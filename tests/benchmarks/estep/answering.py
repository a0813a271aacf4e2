"""How a way of the benchmark is asked for one more timing: by lines, so that all ways take turns.

The ways share a core and its caches, so what is answered is the least of the runs of a tenth of a second, at
least three, the same rule for all: an E-step comes after an E-step.
"""

import json
import sys
from collections.abc import Callable, Mapping

LEAST, SECONDS = 3, 0.1


def serve(
    version: str, forms: Mapping[str, tuple[int, Callable[[], object]]], clock: Callable[[], float]
) -> None:
    """Run every form once, say so, then time the form that each line names, until there are no more.

    A form is a number of trials and what computes their answers. Lines out: one of version and forms,
    then the seconds a trial of the quickest run.
    """
    for _, run in forms.values():
        run()
    print(json.dumps({"version": version, "forms": list(forms)}), flush=True)
    for line in sys.stdin:
        trials, run = forms[line.rstrip("\n")]
        spent: list[float] = []
        while len(spent) < LEAST or sum(spent) < SECONDS:
            started = clock()
            run()
            spent.append(clock() - started)
        print(min(spent) / trials, flush=True)
