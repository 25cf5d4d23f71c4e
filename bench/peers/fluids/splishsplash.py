"""SPlisHSPlasH (J. Bender et al., MIT licence) as a peer of the lab's fluids: its DFSPH and its PBF, unchanged.

It runs in a process of its own. Its particles start where the lab's do and have their volume. It gets everything at its
usual size, particles of 2.5 cm radius, by Froude's law (lengths by L, times by sqrt(L)), because at millimetres its
constants let a dam burst. Its walls are sampled where a lattice at rest in front of them has its density, 0.6 rest
distances outside the lab's; its step follows its own rule (CFL). Its wheel contains its own dispatch of OpenGL under
names that the loader does not find, without which it crashes when loaded; the process gets a folder of links to them.
"""

from __future__ import annotations

import importlib.metadata
import importlib.util
import json
import os
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np

from softlab.bench.peers.base import Opened, Peer, PeerError
from softlab.model.base.disk_cache import save_arrays
from softlab.model.base.table import Table
from softlab.model.core.build import build
from softlab.model.scene.scene import Scene
from softlab.model.tables.cloth import Plane

REMEDY = "pip install 'soft-body-lab[peers]'"
PACKAGE, PROCESS = "pysplishsplash", Path(__file__).with_name("splishsplash_process.py")
METHODS = {"DFSPH": 4, "PBF": 2}  # its numbers; its IISPH starts with pressures that cannot be reset from outside
RADIUS = 0.025  # m: of its particles, the default
LIBRARIES = ("libGLdispatch", "libGLX", "libOpenGL")
KNOWN = {"fluid", "plane", "gravity", "method"}
# with the lab's definitions
UNKNOWN = ("cohesion", "surface_tension", "vorticity_confinement", "drag", "free_surface_drag")
OUTSIDE = 0.6  # rest distances: how far walls of one layer of its particles (Akinci's volumes) lie outside the lab's
MARGIN = 4.0  # of the fluid's size: distance of a side of the box for which the lab has no wall
BOX = [(x, y, z) for z in (-0.5, 0.5) for y in (-0.5, 0.5) for x in (-0.5, 0.5)]
FACES = ((1, 3, 4), (1, 4, 2), (5, 6, 8), (5, 8, 7), (1, 2, 6), (1, 6, 5), (3, 7, 8), (3, 8, 4), (1, 5, 7), (1, 7, 3),
         (2, 4, 8), (2, 8, 6))  # fmt: skip


class SplishSplash(Peer):
    """One of its METHODS by name."""

    backend, precisions, scenes = "cpu", ("float32",), ("fluid",)

    def __init__(self, method: str):
        self.method = method
        self.name, self.label = f"splishsplash_{method.lower()}", f"SPlisHSPlasH {method}"

    def available(self) -> tuple[bool, str]:
        if importlib.util.find_spec(PACKAGE) is None:
            return False, f"SPlisHSPlasH is not here; {REMEDY}"
        return True, f"SPlisHSPlasH {importlib.metadata.version(PACKAGE)}"

    def refusal(self, scene: Scene) -> str | None:
        unknown = sorted(set(scene.kinds.values()) - KNOWN)
        if unknown:
            return f"it has no {', '.join(unknown)} as the lab means it"
        if not scene.fluids or len(scene.fluids) > 1:
            return "it is given one fluid"
        (part,) = scene.fluids.values()
        used = [name for name in UNKNOWN if getattr(part, name)]
        if used:
            return f"it has no {', '.join(used)} as the lab means it"
        if any(sorted(np.abs(plane.normal)) != [0, 0, 1] for plane in _planes(scene)):
            return "its walls are those of a box"
        return None

    def open(self, scene: Scene, precision: str, threads: int) -> Opened:
        try:
            return _Process(scene, METHODS[self.method], threads)
        except (OSError, ValueError) as error:
            raise PeerError(f"{self.label}: {error}") from error


class _Process(Opened):
    def __init__(self, scene: Scene, method: int, threads: int):
        self.threads, self._dt, self._axes = threads, scene.method.dt, scene.dimensions
        self._larger = scale_of(scene)
        self._folder = tempfile.TemporaryDirectory(prefix="softlab-splishsplash-")
        self._path = Path(self._folder.name)
        (self._path / "scene.json").write_text(json.dumps(scene_of(scene, method)), encoding="utf-8")
        (self._path / "box.obj").write_text(_box(), encoding="utf-8")
        self._said = (self._path / "said.txt").open("w+", encoding="utf-8")
        self._process = subprocess.Popen(
            [sys.executable, str(PROCESS), str(self._path)], stdin=subprocess.PIPE, stdout=subprocess.PIPE,
            stderr=self._said, text=True, env=self._environment(threads),
        )  # fmt: skip
        try:
            reply, fluid_set = self._reply(), scene.fluid_set
            if reply["particles"] != fluid_set.particle_count:
                raise PeerError(
                    f"it filled the block by {reply['particles']} particles, not {fluid_set.particle_count}"
                )
            part = reply["volume"] / (2 * RADIUS) ** self._axes
            if abs(part - 1) > 1e-3:
                raise PeerError(f"its particles fill {part:.3g} of the lab's")
            body = build(scene)
            self.load(body.position, body.velocity)
        except BaseException:
            self.close()
            raise

    def _environment(self, threads: int) -> dict[str, str]:
        spec = importlib.util.find_spec(PACKAGE)
        assert spec is not None and spec.origin is not None
        links = self._path / "libraries"
        links.mkdir()
        for library in sorted((Path(spec.origin).parent / f"{PACKAGE}.libs").glob("lib*")):
            plain = library.name.partition("-")[0]
            if plain in LIBRARIES:
                (links / f"{plain}.so.0").symlink_to(library)
        paths = [str(links), *filter(None, [os.environ.get("LD_LIBRARY_PATH")])]
        return os.environ | {"LD_LIBRARY_PATH": os.pathsep.join(paths), "OMP_NUM_THREADS": str(threads)}

    def _reply(self) -> Table:
        assert self._process.stdout is not None
        line = self._process.stdout.readline()
        if not line:
            status = self._process.wait()
            self._said.seek(0)
            last = self._said.read().strip().splitlines()[-1:] or ["it said nothing"]
            raise PeerError(f"its process ended with status {status}: {last[0]}")
        reply: Table = json.loads(line)
        return reply

    def _ask(self, words: str) -> Table:
        assert self._process.stdin is not None
        self._process.stdin.write(words + "\n")
        self._process.stdin.flush()
        return self._reply()

    def advance(self, steps: int) -> None:
        self._ask(f"advance {steps * self._dt * self._larger**0.5!r}")

    def synchronize(self) -> None:
        """Return at once, since every call waits for its result."""

    def load(self, position: np.ndarray, velocity: np.ndarray) -> None:
        space = {name: np.zeros((len(position), 3), np.float32) for name in ("position", "velocity")}
        space["position"][:, : self._axes] = np.asarray(position) * self._larger
        space["velocity"][:, : self._axes] = np.asarray(velocity) * self._larger**0.5
        with open(self._path / "load.npz", "wb") as opened:
            save_arrays(opened, space)
        self._ask("load")

    def read(self) -> tuple[np.ndarray, np.ndarray]:
        self._ask("read")
        with np.load(self._path / "read.npz") as arrays:
            position, velocity = (arrays[name][:, : self._axes] for name in ("position", "velocity"))
        return position / np.float32(self._larger), velocity / np.float32(self._larger**0.5)

    def close(self) -> None:
        for stream in (self._process.stdin, self._process.stdout):
            if stream is not None:
                stream.close()
        try:
            self._process.wait(10)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()
        self._said.close()
        self._folder.cleanup()


# ---------------------------------------------------------------------- its scene


def scale_of(scene: Scene) -> float:
    """Return L, the factor of its lengths over the scene's."""
    return float(2 * RADIUS / scene.fluid_set.spacing)


def scene_of(scene: Scene, method: int) -> Table:
    """Return the scene in its format: its usual settings and size, the lab's fluid and walls."""
    (part,) = scene.fluids.values()
    flat = scene.dimensions == 2
    larger, diameter = scale_of(scene), 2 * RADIUS
    pull = scene.gravity.acceleration if scene.gravity is not None and scene.gravity.enabled else 0.0
    low, high = (larger * corner for corner in _walls(scene))
    blocks = []
    for block in part.all_blocks:
        start = larger * np.array([*block.origin, 0, 0, 0][:3], float)  # it leaves out the two outermost of a side
        end = start + (np.array([*part.counts(block), 1][:3]) + 1.1) * diameter
        if flat:
            start[2], end[2] = -0.5, 0.5
        blocks.append({"denseMode": 0, "start": start.tolist(), "end": end.tolist(), "scale": [1, 1, 1],
                       "translation": [0, 0, 0]})  # fmt: skip
    return {
        "Configuration": {
            "particleRadius": diameter / 2, "sim2D": flat, "simulationMethod": method, "gravitation": [0, -pull, 0],
            "timeStepSize": 0.001, "cflMethod": 1, "cflFactor": 0.5, "cflMaxTimeStepSize": 0.005, "maxIterations": 100,
            "maxError": 0.01, "maxIterationsV": 100, "maxErrorV": 0.1, "enableDivergenceSolver": True,
            "boundaryHandlingMethod": 0, "pause": False, "stopAt": 1e-9,
        },
        "RigidBodies": [{
            "geometryFile": "box.obj", "translation": ((low + high) / 2).tolist(), "rotationAxis": [1, 0, 0],
            "rotationAngle": 0, "scale": (high - low).tolist(), "isDynamic": False, "isWall": True, "mapInvert": True,
            "mapThickness": 0, "mapResolution": [20, 20, 20], "samplingMode": int(flat),
        }],
        "Fluid": {
            "density0": part.density, "viscosityMethod": 1,
            "Viscosity_Standard": {"viscosity": part.viscosity / part.density * larger**1.5},
        },
        "FluidBlocks": blocks,
    }  # fmt: skip


def _planes(scene: Scene) -> list[Plane]:
    return [part for _, part in scene.colliders if isinstance(part, Plane)]


def _walls(scene: Scene) -> tuple[np.ndarray, np.ndarray]:
    """Return the corners of its box, (3,) and (3,) [m]: OUTSIDE the lab's planes, and far away where there is none."""
    fluid_set, axes = scene.fluid_set, scene.dimensions
    lowest, highest = fluid_set.position.min(axis=0), fluid_set.position.max(axis=0)
    low, high = np.full(3, -0.5), np.full(3, 0.5)  # in the plane any depth is possible
    low[:axes] = lowest - fluid_set.spacing - MARGIN * (highest - lowest)
    high[:axes] = highest + fluid_set.spacing + MARGIN * (highest - lowest)
    for plane in _planes(scene):
        axis = int(np.argmax(np.abs(plane.normal)))
        inward = float(np.sign(plane.normal[axis]))
        place = plane.point[axis] + inward * (plane.thickness - OUTSIDE * fluid_set.spacing)
        (low if inward > 0 else high)[axis] = place
    return low, high


def _box() -> str:
    """Return a unit box about the origin as an OBJ file."""
    corners = "".join(f"v {x} {y} {z}\n" for x, y, z in BOX)
    return corners + "".join(f"f {a} {b} {c}\n" for a, b, c in FACES)
