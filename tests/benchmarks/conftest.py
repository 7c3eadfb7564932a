"""Where nothing is timed each benchmark runs once, to see that it runs; the costly ones do not."""

import pytest


@pytest.fixture(autouse=True)
def costly_only_where_timed(request):
    """Skip a costly case in the ordinary tests: a cheaper one of the same code runs there."""
    if request.node.get_closest_marker("costly") and request.getfixturevalue("benchmark").disabled:
        pytest.skip("costly: runs where benchmarks are timed, that is without -n")
