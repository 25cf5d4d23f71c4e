"""What any_input.py chooses from."""

from __future__ import annotations

import json
from typing import Any

import numpy as np

SCENES = (  # of the catalogue: small ones that together have nearly every kind of part
    "lab-grid", "lab-curtain", "rope", "rope-stiff", "two-worlds", "hard/b1", "hard/b2", "hard/b13",
    "hard/b24", "cloth-hanging", "cloth-wind", "cloth-sphere", "cloth-self", "cloth-mesh", "cloth-on-jelly",
    "cloth-draped-twice", "jelly-grid", "jelly-drop", "plastic", "rigid-stack", "sticky", "soft-on-field", "soft-on-mesh",
)  # fmt: skip
OWN: tuple[dict[str, Any], ...] = (  # with the others
    {"brick": {"kind": "soft_lattice", "shape": {"name": "box"}, "particle_spacing": 0.25, "region": 1}, "contact": {}},
    {
        "cloth": {"rows": 6, "columns": 7, "spacing": 0.1, "pinned": "top"}, "structural": {"compliance": 0.0}, "shear": {},
        "attachments": {"anchors": 2}, "curtain": {"kind": "motion", "pins": "top", "velocity": [0.1, 0.0, 0.0]},
        "block": {"kind": "box", "center": [0.0, -1.0, 0.0]}, "heavy": {"kind": "load", "at": [5, 3], "mass": 0.2},
        "method": {"solver": "xpbd", "substeps": 2, "iterations": 3},
    },
)  # fmt: skip
NUMBERS = (
    1e300, 1e-300, 5e-324, 1.7e308, -0.0, float("inf"), float("-inf"), float("nan"), 1e38, 1e-38, 1e154, 1e-154, 1e20, 1e-20,
)  # fmt: skip
WHOLE = (
    0, 1, -1, 2, 3, 7, 50, 1000, 10**6, 10**9, 2**31, 2**31 - 1, 2**63 - 1, 2**63, 2**64, 10**30, 10**400,
)  # fmt: skip
LITTLE = (0.0, 1.0, 0.5, 1, 2, -1.0)
TEXTS = (
    "", "top", "xpbd", "rk4", "none", "every:3", "every:99999999999", "cpu", "x" * 20000, "\u00e9\u6f22\u202e\n\t", "'\"\\",
    "[bold]", "\x7f", "inf",
)  # fmt: skip
SETTINGS = (
    "[" * 2000,
    "[" * 900 + "]" * 900,
    "9" * 5000,
    "0x" + "f" * 5000,
    "",
    "1e999999",
    "2020-01-01",
    "\n[a]",
    "=",
    "{",
)
MARKS = (b"[", b"]", b"=", b'"', b"\n", b"\x00", b"\xff", b"#", b"9" * 5000, b"[" * 3000, b"a.b.c", b"(9999999, 9)")
CELLS = (
    b"9" * 50, b"9" * 5000, b"[" * 2000, b"a." * 3000, b'"', b"\n", b",,,", b"nan", b"1e999", b"1e300", b"1e-300",
    b"\nf 1 2 99\n", b"\nf 1 1 1\n", b"/" * 50, b"-", b"\nv 1e308 0 0\n",
)  # fmt: skip
STORED = (
    3, 2.5, b"\x00\xff", "text", "[]", "3", '{"a": {"b.c": [1, {"d": null}]}}', "[" * 3000, '{"a":' * 1200 + "1" + "}" * 1200,
    "", None, -1, 2**62, float("inf"), "x\x00y", '{"": {"": 1}}', "\u202e",
)  # fmt: skip
OBJ = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n"
OF_MESHES: tuple[dict[str, Any], ...] = (
    {"mesh": {"file": "FILE"}, "method": {"solver": "xpbd"}, "structural": {}},
    {"mesh": {"file": "FILE", "density": 1e-320}, "method": {"solver": "xpbd"}, "structural": {}},
    *({"body": {"kind": "soft_body", "file": "FILE", "particle_spacing": spacing}} for spacing in (0.3, 0.2, 1e-9, 1e9)),
    *(
        {"body": {"kind": "soft_sheet", "file": "FILE", "particle_spacing": 0.5, "density": density}}
        for density in (0.2, 1e-320, 1e300)
    ),
    *(
        {"body": {"kind": "rigid_body", "file": "FILE", "particle_spacing": 0.3, "scale": scale}}
        for scale in (1.0, 1e-200, 1e200, 1e-9)
    ),
    {
        "cloth": {"rows": 3, "columns": 3}, "structural": {}, "hill": {"kind": "mesh_collider", "file": "FILE"},
        "method": {"solver": "xpbd"},
    },
)  # fmt: skip
DEVICES = ("pipe.toml", "pipe.npz", "pipe.sqlite", "pipe.csv")  # that nobody writes to
NAMES = (
    "pipe.toml", "pipe.npz", "pipe.sqlite", "pipe.csv", "/dev/zero", "/dev/full", "/dev/null", "loop.toml", "folder.toml",
    "x" * 5000, "x" * 300, "x" * 300 + ".toml", "x" * 300 + ".npz", "", ".", "..", "/", "a/" * 2000, "\udcff.toml",
    "lab-gird", "hard/", "hard/x", "nothing.toml", "/nowhere/x", "/nowhere/x.npz", "mesh.obj", "~", "\n", "-", "*",
    "good.sqlite",
    "array.npy", "odd name.sqlite", "a?b#c%d", "new.sqlite", "\u202e.npz", "{frame}.ply", "{}.glb", "new.npz",
)  # fmt: skip
WORDS_OF_NAMES = (
    ("run", "ODD"), ("plan", "ODD"), ("demo", "ODD"), ("merge", "ODD", "--store", "new.sqlite"),
    ("export", "ODD", "--store", "good.sqlite"), ("export", "new.csv", "--store", "ODD"), ("ODD",),
    ("run", "rope", "--no-judge", "--steps", "1", "--initial", "ODD"), ("run", "rope", "--no-judge", "--steps", "1",
    "--out", "ODD"),
    ("run", "rope", "--no-judge", "--export", "ODD"), ("figures", "--energies", "ODD", "--out", "."), ("run", "rope",
    "--ODD"),
    ("plan", "cloth-mesh", "--set", "cloth.file=ODD"), ("plan", "jelly-drop", "--set", "jelly.file=ODD"),
)  # fmt: skip
DOCUMENTED = (
    "folder",
    "directory",
    "file",
    "command",
    "argument",
    "name of",
)  # what is named where a name is shown by parts
MEASURING = {  # each with options that it has
    "sweep": (
        "--backend", "--size", "--max-seconds", "--total-seconds", "--repeats", "--min-ms", "--precision", "--kernel",
    ),
    "accuracy": ("--integrator", "--backend", "--precision", "--scene"),
    "stability": ("--integrator", "--backend"),
    "hard": ("--case", "--integrator", "--backend", "--precision"),
    "projections": ("--backend", "--size", "--precision"),
    "throughput": ("--backend", "--kind", "--precision"),
    "bar": ("--backend",),
    "tetrahedra": ("--backend", "--precision"),
    "ablate": ("--time", "--backend", "--set"),
    "advise": ("--error", "--time", "--backend", "--precision", "--total-seconds", "--set"),
}  # fmt: skip
RUN_OPTIONS = (
    "--backend", "--threads", "--precision", "--math", "--kernel", "--steps", "--time", "--export", "--export-every",
    "--record",
    "--out", "--render", "--initial", "--sets", "--frames",
)  # fmt: skip
OPTION_VALUES = (
    "-1", "0", "3", "1e9", "9" * 30, "nan", "inf", "1e999", "x", "", "gpu0", "1x", "99x", "tpu", "float16", "x" * 5000, "S9",
    "grid.rows=-1", ".", "..", "/", "a/b.npz", "case.npz", "x" * 300 + ".npz", "case.ply", "b{frame}.ply", "{}.ply",
    "case.glb",
    "{frame:9999999999d}.ply", "every=0", "every=" + "9" * 5000, "every=2", "folder.toml", "/dev/full", "/nowhere/x.npz",
    "\u202e.npz", "1e-300", "a\nb", "0.02",
)  # fmt: skip


def arrays_of(count: int) -> dict[str, Any]:
    """A state of `count` masses, and under `odd` what its arrays are not."""
    flat = (count, 2)
    return {
        "position": np.zeros(flat), "velocity": np.zeros(flat), "time": np.float64(1), "step": np.int64(3),
        "odd": (
            np.zeros(3), np.full(flat, np.nan), np.array("text"), np.array([1, 2], dtype="U5"), np.zeros((count, 3)),
            np.int64(-5), np.float64(np.inf), np.zeros(0), np.zeros(flat, complex), np.full(flat, 1e300), np.zeros(flat,
            bool),
            np.array(2**64 - 1, np.uint64), np.zeros(flat, "M8[s]"), np.full((count, 4), 0.5),
        ),
    }  # fmt: skip


def frames_of(frames: int) -> dict[str, Any]:
    """A trajectory of four masses, and under `odd` what its arrays are not."""
    scene = json.dumps({"grid": {"rows": 2, "columns": 2}, "springs": {}})
    shape = (frames, 4, 2)
    return {
        "time": np.arange(frames) * 0.1, "step": np.arange(frames), "position": np.zeros(shape), "velocity": np.zeros(shape),
        "scene": np.array(scene),
        "odd": (
            np.zeros(3), np.array("[" * 5000), np.array("{}"), np.zeros(shape, "U3"), np.full(shape, np.nan),
            np.full(shape, 1e200), np.zeros((0, 4, 2)), np.array(3), np.zeros(3, bool),
        ),
    }  # fmt: skip
