"""The garbage collector, out of the way while a decision is made."""

import gc
from collections.abc import Iterator
from contextlib import contextmanager


@contextmanager
def no_collections() -> Iterator[None]:
    """Pause the garbage collector: growing makes no garbage, and a full collection takes longer the more
    states there are, more than a deadline can spare.
    """
    collects = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if collects:
            gc.enable()


@contextmanager
def undisturbed() -> Iterator[None]:
    """No garbage collection while a decision is made, nor because of it right after.

    The worlds that a decision meets are no garbage, but it may take a collection a fifth of a time step
    to find that out. So what is young is collected before, and what came since counts as old afterwards,
    unlooked at, which takes no time; the next full collection looks at it.
    """
    if gc.isenabled():
        gc.collect(1)
    with no_collections():
        try:
            yield
        finally:
            if gc.get_freeze_count() == 0:
                gc.freeze()
                gc.unfreeze()
