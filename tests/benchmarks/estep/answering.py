"""How a way of the benchmark is asked for one more timing: by lines, so that all ways take turns."""

import json
import sys
from collections.abc import Callable, Mapping


def serve(
    version: str, forms: Mapping[str, tuple[int, Callable[[], object]]], clock: Callable[[], float]
) -> None:
    """Run every form once, say so, then time the form that each line names, until there are no more.

    A form is a number of trials and what computes their answers. Lines out: one of version and forms,
    then the seconds a trial of each run.
    """
    for _, run in forms.values():
        run()
    print(json.dumps({"version": version, "forms": list(forms)}), flush=True)
    for line in sys.stdin:
        trials, run = forms[line.rstrip("\n")]
        started = clock()
        run()
        print((clock() - started) / trials, flush=True)
