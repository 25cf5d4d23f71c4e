"""The soft-body lab: the same scenes on CPU threads and on CUDA, how fast and how wrong each run was.

The names in `__all__` are the public interface and are imported on first use; all else may change. `python -m softlab`
is the command line (softlab/cli.py).
"""

from __future__ import annotations

from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any

_CHECKOUT = Path(__file__).resolve().parents[1]
if (_CHECKOUT / "pyproject.toml").is_file():  # the layers lie beside this folder, and need not be installed
    __path__.append(str(_CHECKOUT))

if TYPE_CHECKING:
    from softlab.app.driver import open_simulation
    from softlab.bench.experiments.accuracy.judge import distance
    from softlab.bench.experiments.accuracy.judge import judge_run as judge
    from softlab.bench.reference.mass_spring import converged
    from softlab.model.base.errors import (
        BackendUnavailable,
        Diverged,
        Incomplete,
        InputError,
        SceneError,
        SoftlabError,
        UnstableTimeStep,
    )
    from softlab.model.core.families import scene_plan, stability_limit
    from softlab.model.core.simulation import Simulation
    from softlab.model.core.state import State
    from softlab.model.scene.scene import Scene, load_scene

    __version__: str

_MODULES = {
    "open_simulation": "app.driver",
    "Simulation": "model.core.simulation",
    "State": "model.core.state",
    "load_scene": "model.scene.scene",
    "Scene": "model.scene.scene",
    "judge": "bench.experiments.accuracy.judge:judge_run",
    "distance": "bench.experiments.accuracy.judge",
    "converged": "bench.reference.mass_spring",
    "scene_plan": "model.core.families",
    "stability_limit": "model.core.families",
    "SoftlabError": "model.base.errors",
    "SceneError": "model.base.errors",
    "InputError": "model.base.errors",
    "UnstableTimeStep": "model.base.errors",
    "BackendUnavailable": "model.base.errors",
    "Diverged": "model.base.errors",
    "Incomplete": "model.base.errors",
}
__all__ = [  # noqa: RUF022 - in the order of docs/api.md
    "open_simulation", "Simulation", "State", "load_scene", "Scene", "judge", "distance", "converged", "scene_plan",
    "stability_limit", "SoftlabError", "SceneError", "InputError", "UnstableTimeStep", "BackendUnavailable", "Diverged",
    "Incomplete", "__version__",
]  # fmt: skip


def __getattr__(name: str) -> Any:
    """Import a public name when it is first used."""
    if name == "__version__":
        from importlib.metadata import version

        return version("soft-body-lab")
    if name not in _MODULES:
        raise AttributeError(f"module 'softlab' has no attribute {name!r}; public names: {', '.join(__all__)}")
    module, _, attribute = _MODULES[name].partition(":")
    value = globals()[name] = getattr(import_module(f"softlab.{module}"), attribute or name)
    return value


def __dir__() -> list[str]:
    return sorted(__all__)
