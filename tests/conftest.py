"""How Hypothesis searches: the same examples every time in the quick run, new ones in `make verify`."""

from hypothesis import HealthCheck, settings

# Scripts of a benchmark, each run in an environment of its own.
collect_ignore_glob = ["benchmarks/estep/with_*.py"]
SLOW_DATA = [HealthCheck.too_slow]
settings.register_profile(
    "quick", deadline=None, derandomize=True, max_examples=60, suppress_health_check=SLOW_DATA
)
settings.register_profile(
    "verify", deadline=None, max_examples=500, suppress_health_check=SLOW_DATA, print_blob=True
)
settings.load_profile("quick")
