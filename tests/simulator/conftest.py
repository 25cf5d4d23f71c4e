"""These tests run under numba's CUDA simulator only: tests/core/test_cuda_simulator.py starts them in a process of its own,
because the simulator must be chosen before numba is imported."""

import os

if os.environ.get("NUMBA_ENABLE_CUDASIM", "0") in ("0", ""):
    collect_ignore_glob = ["*test_simulated_*.py"]  # in folders, too
else:
    import quicker

    quicker.install()
