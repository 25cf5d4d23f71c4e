"""Kernel keys of configurations under the code of any commit: python probe.py CHECKOUT < descriptions > keys

Reads a JSON line [name, description] for each configuration and writes [name, key of its kernels, key of its arrays, error].
Run this file by its path: the lab is imported from CHECKOUT, the digests from beside this file, so that the code of two
commits is read with one tool.
"""

from __future__ import annotations

import importlib
import importlib.util
import json
import sys
from contextlib import nullcontext
from pathlib import Path
from types import ModuleType
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from softlab.bench.keys.kernel_digest import KernelDigests
    from softlab.bench.keys.record import Launch

HERE = Path(__file__).resolve().parents[2]
TOOLS = tuple(f"softlab.bench.keys{name}" for name in ("", ".syntax", ".kernel_digest", ".record", ".machine_code"))


def load_tools() -> None:
    """Import the digests from this checkout under their names, whichever checkout the lab is imported from."""
    for name in TOOLS:
        path = HERE / name.removeprefix("softlab.").replace(".", "/")
        path = path / "__init__.py" if path.is_dir() else path.with_suffix(".py")
        spec = importlib.util.spec_from_file_location(name, path)
        assert spec and spec.loader
        sys.modules[name] = importlib.util.module_from_spec(spec)
        spec.loader.exec_module(sys.modules[name])


def lab(module: str) -> ModuleType:
    """Import a module of a checkout; in older ones the layers are top-level packages."""
    packed = (Path(sys.path[0]) / "softlab" / "__init__.py").is_file()
    return importlib.import_module(f"softlab.{module}" if packed else module)


def recorded_calls(description: dict[str, Any]) -> list[Launch]:
    """Record the launches of a configuration's opening and first step without running them. Raises the lab's errors."""
    from softlab.bench.keys.record import recorded

    open_simulation, scene_of = lab("app.driver").open_simulation, lab("model.scene.scene").Scene
    kernel = None if description["kernel"] == "auto" else description["kernel"]
    how = {name: description[name] for name in ("precision", "math")}
    with (
        recorded() as calls,
        open_simulation(
            scene_of(description["scene"]), description["backend"], threads=1, kernel=kernel, allow_unstable=True, **how
        ) as simulation,
    ):
        simulation.advance(1)
    return calls


def key(description: dict[str, Any], digests: KernelDigests) -> tuple[str, str]:
    """Return (key of the kernels, key of the arrays) of a configuration."""
    from softlab.bench.keys.record import array_hash, arrays_of, combined

    calls = recorded_calls(description)
    if not calls:
        raise LookupError("no kernel was launched")
    return combined(digests.of(call.kernel) for call in calls), combined(map(array_hash, arrays_of(calls)))


def limit_memory(fraction: float = 0.25) -> None:
    """Make a configuration fail that needs more than this fraction of the main memory, before the machine does."""
    import os

    try:
        import resource
    except ImportError:  # Windows has no such limit
        return
    most = int(fraction * os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES"))
    resource.setrlimit(resource.RLIMIT_DATA, (most, most))


def main(checkout: str, compared: str = "kernels") -> None:
    """Write a line for every line of the input. `compared`: "code" for keys of the machine code in place of the kernels'."""
    sys.path[0] = checkout
    limit_memory()
    load_tools()
    from softlab.bench.keys.kernel_digest import KernelDigests
    from softlab.bench.keys.machine_code import machine_code_key
    from softlab.bench.keys.record import fake_gpu

    digests = KernelDigests()
    for line in sys.stdin:
        name, description = json.loads(line)
        try:
            with fake_gpu() if description["backend"] == "gpu" else nullcontext():
                if compared == "code":
                    reply = [name, machine_code_key(recorded_calls(description)), None, None]
                else:
                    reply = [name, *key(description, digests), None]
        except Exception as error:  # whatever old code raises for a scene that it does not support
            reply = [name, None, None, f"{type(error).__name__}: {error}"[:300]]
        print(json.dumps(reply), flush=True)


if __name__ == "__main__":
    main(*sys.argv[1:])
