"""Driver and compiler of the CUDA C++ peers: cuda.bindings, NVRTC or nvcc, the device's architecture.

Everything uses the driver interface of cuda.bindings, in the device's primary context, like numba and Warp.
"""

from __future__ import annotations

import shutil
import subprocess
import tempfile
from pathlib import Path
from types import ModuleType
from typing import Any

from softlab.bench.peers.base import PeerError

OPTIONS = ("--use_fast_math", "--std=c++17")
REMEDY = "pip install -e '.[cuda13]' (or cuda12)"


def driver() -> ModuleType:
    """Return cuda.bindings.driver. Raises the error of a missing package or library."""
    from cuda.bindings import driver

    return driver


def checked(result: tuple, what: str) -> Any:
    """Return the result of a call of cuda.bindings without its status. Raises PeerError."""
    status, *values = result
    if int(status) != 0:
        raise PeerError(f"{what}: {getattr(status, 'name', status)}")
    return values[0] if values else None


def attributes(*names: str) -> list[int]:
    """Return attributes of the first device, by their names without CU_DEVICE_ATTRIBUTE_."""
    cuda = driver()
    device = checked(cuda.cuDeviceGet(0), "cuDeviceGet")
    return [
        int(checked(
            cuda.cuDeviceGetAttribute(getattr(cuda.CUdevice_attribute, f"CU_DEVICE_ATTRIBUTE_{name}"), device),
            "cuDeviceGetAttribute",
        ))
        for name in names
    ]  # fmt: skip


def architecture() -> str:
    """Return the architecture of the first device, e.g. `sm_90`."""
    major, minor = attributes("COMPUTE_CAPABILITY_MAJOR", "COMPUTE_CAPABILITY_MINOR")
    return f"sm_{major}{minor}"


def compile_source(source: Path, definitions: tuple[str, ...], architecture: str) -> bytes:
    """Return machine code (cubin) of a source for a real architecture such as `sm_90`: by NVRTC, else by nvcc.

    Raises PeerError if neither is installed or the source does not compile. Needs no GPU.
    """
    options = [*OPTIONS, *definitions, f"--gpu-architecture={architecture}"]
    try:
        from cuda.bindings import nvrtc

        program = checked(
            nvrtc.nvrtcCreateProgram(source.read_bytes(), source.name.encode(), 0, [], []), "nvrtcCreateProgram"
        )
    except PeerError:
        raise
    except Exception as error:  # a missing library raises one of several kinds of exception
        return _compile_with_nvcc(source, options, f"NVRTC is not here ({error})")
    try:
        status = nvrtc.nvrtcCompileProgram(program, len(options), [option.encode() for option in options])
        if int(status[0]) != 0:
            size = checked(nvrtc.nvrtcGetProgramLogSize(program), "nvrtcGetProgramLogSize")
            log = b" " * size
            nvrtc.nvrtcGetProgramLog(program, log)
            raise PeerError(f"NVRTC refuses {source.name}: {log.decode(errors='replace').strip()}")
        size = checked(nvrtc.nvrtcGetCUBINSize(program), "nvrtcGetCUBINSize")
        code = b" " * size
        checked(nvrtc.nvrtcGetCUBIN(program, code), "nvrtcGetCUBIN")
        return code
    finally:
        nvrtc.nvrtcDestroyProgram(program)


def _compile_with_nvcc(source: Path, options: list[str], reason: str) -> bytes:
    nvcc = shutil.which("nvcc")
    if nvcc is None:
        raise PeerError(f"{reason}, nor is nvcc; {REMEDY}")
    with tempfile.TemporaryDirectory(prefix="softlab-peers-") as work:
        target = Path(work) / "code.cubin"
        try:
            done = subprocess.run(
                [nvcc, "--cubin", *options, str(source), "-o", str(target)], capture_output=True, text=True, timeout=300
            )
        except (OSError, subprocess.SubprocessError) as error:
            raise PeerError(f"{reason}, and nvcc does not run: {error}") from None
        if done.returncode:
            raise PeerError(f"{reason}, and nvcc refuses {source.name}: {(done.stderr or done.stdout).strip()}")
        return target.read_bytes()
