"""What every test shares: one thread per process and the same examples, so that neither results nor timings depend on the machine."""

import os

from hypothesis import settings

for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(name, "1")

settings.register_profile("steady", deadline=None, derandomize=True)
settings.load_profile("steady")
