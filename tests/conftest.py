"""What every test shares: one thread per process and the same examples, so that neither results nor timings depend on the machine."""

import os
import signal

import pytest
from hypothesis import settings

for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(name, "1")

# Programs under test inherit what is ignored: in the background Ctrl-C is, under nohup SIGHUP.
for name, handler in (("SIGINT", signal.default_int_handler), ("SIGHUP", signal.SIG_DFL)):
    number = getattr(signal, name, None)
    if number is not None and signal.getsignal(number) is signal.SIG_IGN:
        signal.signal(number, handler)

settings.register_profile("steady", deadline=None, derandomize=True)
settings.load_profile("steady")


@pytest.fixture(autouse=True)
def no_figure_fails_unseen(caplog):
    """A figure that cannot be drawn is replaced by one that says so; in a test that is a fault."""
    yield
    logged = caplog.get_records("setup") + caplog.get_records("call")
    assert not any("cannot be drawn" in record.getMessage() for record in logged)
