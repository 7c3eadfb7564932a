"""Where nothing is timed each benchmark runs once, to see that it runs; the costly ones do not."""

import pytest


def pytest_collection_modifyitems(config, items):
    """Skip costly cases in the ordinary tests: a cheaper one of the same code runs there."""
    if not hasattr(config, "workerinput"):
        return
    untimed = pytest.mark.skip(reason="costly: runs where benchmarks are timed, that is with -n 0")
    for item in items:
        if item.get_closest_marker("costly"):
            item.add_marker(untimed)
