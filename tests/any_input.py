"""Inputs of every kind, made from a seed: scenes as TOML, values of --set, options, state files, stores, exports, meshes and
odd names, most of them wrong. `Maker(seed, folder).case()` is one; `answer(case)` is what the command line makes of it.

Nothing is simulated and nothing is measured: `quiet_lab` puts a solver in its place that keeps every mass where it is, and
ends a measurement where its work would begin.
"""

from __future__ import annotations

import contextlib
import io
import json
import os
import random
import re
import signal
import sqlite3
import string
import sys
import tomllib
import traceback
import warnings
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
from fake_cloth import FakeCloth

import softlab
from bench.store import Store
from model.plans import scene_plan
from model.scene import KINDS
from model.scene_reader import catalogue
from model.simulation import Simulation

SECONDS = 20  # of computing that any answer may take; three times as many by the clock, for one that waits
LONGEST = 600  # characters of a message
SCENES = (  # of the catalogue: small ones that together have every kind of part
    "lab-grid", "lab-curtain", "rope", "rope-stiff", "manufactured", "two-worlds", "hard/b1", "hard/b2", "hard/b13", "hard/b24",
    "cloth-hanging", "cloth-wind", "cloth-sphere", "cloth-self", "cloth-mesh", "cloth-on-jelly", "cloth-draped-twice",
    "jelly-grid", "jelly-drop", "plastic", "rigid-stack", "sticky", "soft-on-field", "soft-on-mesh",
)  # fmt: skip
MEASURING = {  # each with options that it has
    "sweep": ("--backend", "--size", "--max-seconds", "--total-seconds", "--repeats", "--min-ms", "--precision", "--kernel"),
    "accuracy": ("--integrator", "--backend", "--precision", "--scene"),
    "stability": ("--integrator", "--backend"),
    "hard": ("--case", "--integrator", "--backend", "--precision"),
    "projections": ("--backend", "--size", "--precision"),
    "crowds": ("--backend", "--kind", "--precision"),
    "bar": ("--backend",),
    "ablate": ("--time", "--backend", "--set"),
    "advise": ("--error", "--time", "--backend", "--precision", "--total-seconds", "--set"),
}  # fmt: skip
RUN_OPTIONS = (
    "--backend", "--threads", "--precision", "--math", "--kernel", "--steps", "--time", "--export", "--export-every",
    "--record", "--out", "--render", "--initial", "--sets", "--frames",
)  # fmt: skip
OBJ = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n"


class Worked(BaseException):
    """Everything was accepted, and the work would begin now."""


class Hung(BaseException):
    """The answer takes too long."""


class Still(FakeCloth):
    """A solver that moves nothing."""

    kernel = "still"
    contacts_lost, contacts = 0, SimpleNamespace(lost=0)

    def __init__(self, scene: Any, options: Any):
        self.plan = scene_plan(scene, options.live)
        Simulation.__init__(self, scene, options)
        self._velocity = np.array(self.body.velocity, dtype=float)
        self._position = self.body.position.copy()
        self.asked: list[str] = []
        self._put_aside()
        self.reset()

    def _run(self, steps: int) -> None:
        pass

    def _upload_rotation(self, rotation: Any) -> None:
        pass

    def _upload_plastic(self, plastic: Any) -> None:
        pass

    def _download_rotation(self) -> None:
        return None

    def _download_plastic(self) -> None:
        return None


@contextlib.contextmanager
def quiet_lab() -> Iterator[None]:
    """No solver, no measurement, no window, while it lasts."""
    import app.driver
    import app.viewer
    import bench.machine
    import bench.store

    def work(*_: Any, **__: Any) -> None:
        raise Worked

    replaced: list[tuple[Any, str, Any]] = [
        (app.driver, "_open", lambda scene, backend, options, threads: Still(scene, options)),
        (app.viewer, "run_demo", work),
        (bench.machine, "measured_limits", work),
        (bench.store.Store, "start_run", work),
        (bench.store.Store, "add_machine", _machine_or_work(bench.store.Store.add_machine)),
    ]
    kept = [(owner, name, getattr(owner, name)) for owner, name, _ in replaced]
    for owner, name, new in replaced:
        setattr(owner, name, new)
    try:
        yield
    finally:
        for owner, name, old in kept:
            setattr(owner, name, old)


def _machine_or_work(add: Any) -> Any:
    def entered(self: Store, key: str, label: str, record: Any) -> None:
        if isinstance(record, dict) and "cores" in record and "os" in record and "test" not in record:
            raise Worked
        add(self, key, label, record)

    return entered


@dataclass
class Case:
    """A command line in a folder, and what of it was made up: one of `names` must be in a message about it."""

    argv: list[str]
    names: list[str] = field(default_factory=list)


@dataclass
class Answer:
    """What came back: the exit status (None: the work would have begun), what was printed, what is wrong with that."""

    status: int | None
    out: str
    err: str
    wrong: list[str]


def answer(case: Case, folder: Path) -> Answer:
    """What the command line makes of a case, run in `folder`."""
    out, err, wrong, status = io.StringIO(), io.StringIO(), [], None

    def hung(*_: Any) -> None:
        raise Hung

    argv, here = sys.argv, Path.cwd()
    before = set(_files(folder))
    timed = hasattr(signal, "SIGALRM")
    clocks = (
        ((signal.SIGALRM, signal.ITIMER_REAL, 3 * SECONDS), (signal.SIGPROF, signal.ITIMER_PROF, SECONDS))
        if timed
        else ()
    )
    old = [signal.signal(number, hung) for number, _, _ in clocks]
    try:
        os.chdir(folder)
        sys.argv = ["softlab", *case.argv]
        with warnings.catch_warnings(record=True) as warned:
            warnings.simplefilter("always")
            for _, clock, seconds in clocks:
                signal.setitimer(clock, seconds)
            try:
                with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
                    softlab.main()
            except SystemExit as ended:
                status = int(ended.code or 0)
            except Worked:
                pass
            except Hung:
                wrong.append(f"took over {SECONDS} s")
                status = -1
            except BaseException as error:
                where = " < ".join(
                    f"{Path(frame.filename).name}:{frame.lineno}"
                    for frame in traceback.extract_tb(error.__traceback__)[:-9:-1]
                )
                wrong.append(f"traceback: {type(error).__name__}: {str(error)[:200]} at {where}")
                status = -1
            finally:
                for _, clock, _ in clocks:
                    signal.setitimer(clock, 0)
        wrong += [f"warning: {one.message} at {Path(one.filename).name}:{one.lineno}" for one in warned if _ours(one)]
    finally:
        sys.argv = argv
        os.chdir(here)
        for (number, _, _), handler in zip(clocks, old, strict=True):
            signal.signal(number, handler)
    wrong += _looked_at(case, status, err.getvalue())
    new = set(_files(folder)) - before
    hidden = [name for name in new if Path(name).name.startswith(".")]
    if hidden or (status not in (0, 1, None) and new):
        wrong.append(f"left behind: {sorted(new)}")
    return Answer(status, out.getvalue(), err.getvalue(), wrong)


def _ours(one: warnings.WarningMessage) -> bool:
    return not issubclass(one.category, ResourceWarning | DeprecationWarning)


def _files(folder: Path) -> list[str]:
    return [str(Path(root) / name) for root, _, names in os.walk(folder) for name in names]


def _looked_at(case: Case, status: int | None, err: str) -> list[str]:
    """What is wrong with a message."""
    if status in (None, 0, -1):
        return []
    wrong = []
    lines = err.strip().splitlines()
    told = [line for line in lines if line.startswith("softlab: ")]
    if status not in (1, 2, 3):
        wrong.append(f"status {status}")
    if len(told) != 1 or lines[-1] != told[0]:
        return [*wrong, f"not one line at the end: {err[-300:]!r}"]
    if len(told[0]) >= LONGEST:
        wrong.append(f"{len(told[0])} characters: {told[0][:100]}")
    if re.search(r"\b(inf|nan) s\b|Traceback|object at 0x", told[0]):
        wrong.append(f"tells nothing: {told[0]}")
    if status == 2 and not any(name in told[0] for name in case.names):
        wrong.append(f"names nothing of {case.names}: {told[0]}")
    return wrong


class Maker:
    """Makes cases, each from the seed and its number alone. What they need lies in `folder`."""

    def __init__(self, seed: int, folder: Path):
        self.seed, self.folder = seed, folder
        self.random = random.Random(seed)
        self.scenes = {
            name: tomllib.loads(path.read_text(encoding="utf-8"))
            for name, path in catalogue().items()
            if name in SCENES
        }
        self.fields = [(kind, name) for kind, part in KINDS.items() for name in part.model_fields]
        self.number = 0
        self._furnish()

    def case(self) -> Case:
        """The next one."""
        self.number += 1
        self.random = random.Random(f"{self.seed} {self.number}")
        kinds = [
            (self._scene_file, 30), (self._setting, 25), (self._text, 8), (self._options, 12), (self._state, 8),
            (self._store, 6), (self._measuring, 6), (self._name, 6), (self._mesh, 4), (self._energies, 1),
        ]  # fmt: skip
        make = self.random.choices([kind for kind, _ in kinds], [weight for _, weight in kinds])[0]
        return make()

    # ------------------------------------------------------------------ what lies in the folder

    def _furnish(self) -> None:
        folder = self.folder
        if hasattr(os, "mkfifo"):
            os.mkfifo(folder / "pipe.toml")
            os.mkfifo(folder / "pipe.npz")
            os.mkfifo(folder / "pipe.sqlite")
            os.mkfifo(folder / "pipe.csv")
        (folder / "loop.toml").symlink_to("loop.toml")
        (folder / "folder.toml").mkdir()
        np.save(folder / "array.npy", np.zeros(3))
        (folder / "mesh.obj").write_text(OBJ)
        with Store(folder / "good.sqlite") as store:
            store.add_machine("m1", "a machine", {"cores": 2, "cpu": "x", "test": 1})
            store.connection.execute("INSERT INTO run VALUES ('r1', 'm1', NULL, '2026-01-01', 'softlab')")
            scene = {"grid": {"rows": 2, "columns": 2}}
            for k in range(3):
                store.add_sample("r1", {"backend": "cpu", "k": k, "scene": scene}, "s", 0.5 + k, 100, joules=1.5)
                store.add_measure("r1", {"backend": "cpu", "k": k, "scene": scene}, "s", "error", 0.1 * k)
            from bench.transfer import export

            export(store, folder / "good.csv")
        # one file, to be copied and bent
        with contextlib.closing(sqlite3.connect(folder / "good.sqlite")) as opened:
            opened.execute("PRAGMA journal_mode = DELETE")

    def _file(self, suffix: str, data: bytes) -> str:
        """A file of the case; the one before is replaced."""
        name = f"case{suffix}"
        (self.folder / name).write_bytes(data)
        return name

    # ------------------------------------------------------------------ values

    def _value(self) -> Any:
        pick = self.random.random()
        if pick < 0.35:
            return 10.0 ** self.random.uniform(-12, 12) * self.random.choice((1, 1, 1, -1))
        if pick < 0.5:
            return self.random.choice(
                (1e300, 1e-300, 5e-324, 1.7e308, -0.0, float("inf"), float("-inf"), float("nan"), 1e38, 1e-38, 1e154)
            )
        if pick < 0.65:
            return self.random.choice(
                (0, 1, -1, 2, 3, 7, 50, 1000, 10**6, 10**9, 2**31, 2**31 - 1, 2**63 - 1, 2**63, 2**64, 10**30, 10**400)
            )
        if pick < 0.75:
            return self.random.choice(
                (
                    "",
                    "top",
                    "xpbd",
                    "rk4",
                    "none",
                    "every:3",
                    "every:99999999999",
                    "cpu",
                    "x" * 20000,
                    "\u00e9\u6f22\u202e\n\t",
                    "'\"\\",
                    "[bold]",
                    "\x7f",
                    "inf",
                )
            )
        if pick < 0.82:
            return self.random.choice((True, False))
        if pick < 0.94:
            return [
                self._value() if self.random.random() < 0.3 else self.random.choice((0.0, 1.0, 0.5, 1, 2, -1.0))
                for _ in range(self.random.choice((0, 1, 2, 3, 3, 3, 4, 50)))
            ]
        if pick < 0.97:
            return {"name": self._value(), "x": 1}
        deep: Any = 0
        for _ in range(self.random.choice((5, 90, 300))):
            deep = [deep]
        return deep

    def _written(self, value: Any) -> str:
        """As TOML writes it."""
        if isinstance(value, bool):
            return "true" if value else "false"
        if isinstance(value, float):
            text = repr(value)
            return text if "." in text or "n" in text else text.replace("e", ".0e")
        if isinstance(value, str):
            return json.dumps(value).replace("\x7f", "\\u007f")
        if isinstance(value, list | tuple):
            return f"[{', '.join(map(self._written, value))}]"
        if isinstance(value, dict):
            return f"{{ {', '.join(f'{json.dumps(k)} = {self._written(v)}' for k, v in value.items())} }}"
        return str(value)

    def _toml(self, tables: dict[str, Any]) -> str:
        lines = [f"{json.dumps(k)} = {self._written(v)}" for k, v in tables.items() if not isinstance(v, dict)]
        for name, table in tables.items():
            if isinstance(table, dict):
                lines.append(f"[{json.dumps(name)}]")
                lines += [f"{json.dumps(k)} = {self._written(v)}" for k, v in table.items()]
        return "\n".join(lines) + "\n"

    def _near(self, value: Any) -> Any:
        """A number much like `value`, which most scenes take."""
        if isinstance(value, list):
            return [self._near(one) for one in value]
        if isinstance(value, bool) or not isinstance(value, int | float):
            return value
        factor = 10.0 ** self.random.choice((0.3, 1, 3, 10, 40)) ** self.random.choice((1, -1))
        if isinstance(value, int):
            if value > 2**53:
                return value + 1
            return max(1, min(int(value * factor), 3 * value + 2))
        return value * factor * self.random.choice((1, 1, 1, -1))

    def _word(self) -> str:
        return "".join(
            self.random.choice(string.ascii_letters + "_-. \u00e9")
            for _ in range(self.random.choice((1, 3, 8, 30, 9000)))
        )

    def _command(self, scene: str) -> list[str]:
        if self.random.random() < 0.5:
            return ["plan", scene, *(["--json"] if self.random.random() < 0.5 else [])]
        judged = [] if self.random.random() < 0.05 else ["--no-judge"]
        return [
            "run",
            scene,
            "--steps",
            "3",
            *judged,
            *(["--json"] if self.random.random() < 0.5 else ["--allow-unstable"]),
        ]

    # ------------------------------------------------------------------ kinds of cases

    def _scene_file(self) -> Case:
        tables = json.loads(json.dumps(self.random.choice(list(self.scenes.values()))))
        names: list[str] = ["case.toml"]
        for _ in range(self.random.choice((1, 1, 1, 2, 3))):
            own = [name for name, table in tables.items() if isinstance(table, dict)]
            what = self.random.random()
            if what < 0.6 and own:
                part = self.random.choice(own)
                kind = tables[part].get("kind", part)
                known = list(KINDS[kind].model_fields) if kind in KINDS else ["x"]
                key = self.random.choice(known)
                if key in tables[part] and self.random.random() < 0.6:
                    tables[part][key] = self._near(tables[part][key])
                else:
                    tables[part][key] = self._value()
                names += [part]
            elif what < 0.75:
                kind, key = self.random.choice(self.fields)
                tables.setdefault(kind, {})[key] = self._value() if isinstance(tables.get(kind, {}), dict) else 0
                names += [kind]
            elif what < 0.85 and own:
                part = self.random.choice(own)
                if tables[part]:
                    del tables[part][self.random.choice(list(tables[part]))]
                names += [part]
            elif what < 0.92 and own:
                part = self.random.choice(own)
                tables[part][self._word()] = self._value()
                names += [part]
            else:
                part = self._word()
                tables[part] = self._value() if self.random.random() < 0.5 else {"kind": self._value()}
                names += [part[:40]]
        names += [name for name in KINDS]  # the fault may show in what goes with it
        return Case(self._command(self._file(".toml", self._toml(tables).encode())), names)

    def _setting(self) -> Case:
        name = self.random.choice(list(self.scenes))
        argv = self._command(name)
        names: list[str] = []
        for _ in range(self.random.choice((1, 1, 2))):
            own = [
                (part, table.get("kind", part)) for part, table in self.scenes[name].items() if isinstance(table, dict)
            ]
            kind, key = self.random.choice(self.fields)
            part = kind
            if own and self.random.random() < 0.8:
                part, kind = self.random.choice(own)
                key = self.random.choice(list(KINDS[kind].model_fields))
            path = f"{part}.{key}" if self.random.random() < 0.95 else self._word()
            text = self._written(self._value())
            given = self.scenes[name].get(part, {}).get(key)
            if given is not None and self.random.random() < 0.7:
                text = self._written(self._near(given))
            if self.random.random() < 0.05:
                text = self.random.choice(
                    ("[" * 2000, "9" * 5000, "0x" + "f" * 5000, "", "1e999999", "2020-01-01", "\n[a]", "=", "{")
                )
            argv += ["--set", f"{path}={text}"]
            names += [part, path[:30]]
        return Case(argv, [*names, "--set", *KINDS])

    def _text(self) -> Case:
        """A scene file that is bent as text."""
        text = bytearray(self._toml(self.random.choice(list(self.scenes.values()))).encode())
        for _ in range(self.random.choice((1, 2, 5, 40))):
            place = self.random.randrange(len(text) + 1)
            what = self.random.random()
            if what < 0.3:
                text[place:place] = bytes(
                    self.random.choice(
                        (b"[", b"]", b"=", b'"', b"\n", b"\x00", b"\xff", b"#", b"9" * 5000, b"[" * 3000, b"a.b.c")
                    )
                )
            elif what < 0.6:
                del text[place : place + self.random.choice((1, 3, 50))]
            elif what < 0.8 and place < len(text):
                text[place] = self.random.randrange(256)
            else:
                text[place:place] = text[: self.random.choice((10, 100))]
        return Case(self._command(self._file(".toml", bytes(text))), ["case.toml", "grid", *KINDS, "title", " = "])

    def _options(self) -> Case:
        argv, names = ["run", self.random.choice(("lab-grid", "rope", "cloth-flag")), "--no-judge"], ["--"]
        for _ in range(self.random.choice((1, 1, 2, 3))):
            option = self.random.choice(RUN_OPTIONS)
            value = self.random.choice((
                "-1", "0", "3", "1e9", "9" * 30, "nan", "inf", "x", "", "gpu0", "1x", "99x", "float16", ".", "..", "/", "a/b.npz",
                "case.npz", "x" * 300 + ".npz", "case.ply", "b{frame}.ply", "{frame:9999999999d}.ply", "{}.ply", "case.glb", "every=0",
                "every=" + "9" * 5000, "every=2", "folder.toml", "/dev/full", "/nowhere/x.npz", "\u202e.npz", "1e-300", "a\nb", "0.02",
            ))  # fmt: skip
            argv += [option, value]
            if option == "--record":
                argv.append(self.random.choice(("case.npz", ".", "/nowhere/x.npz", "x" * 300 + ".npz", "case.txt")))
            names += [value[:40], option]
        if self.random.random() < 0.1:
            argv.append(self._word())
            names.append(argv[-1][:20])
        return Case(argv, names)

    def _state(self) -> Case:
        scene = self.random.choice(("lab-grid", "rope"))
        count = 1024 if scene == "lab-grid" else 100
        good: dict[str, Any] = {
            "position": np.zeros((count, 2)), "velocity": np.zeros((count, 2)), "time": np.float64(1), "step": np.int64(3),
        }  # fmt: skip
        for _ in range(self.random.choice((0, 1, 2))):
            key = self.random.choice([*good, "inverse_mass", "rotation", "plastic"])
            good[key] = self.random.choice((
                np.zeros(3), np.full((count, 2), np.nan), np.array("text"), np.array([1, 2], dtype="U5"), np.zeros((count, 3)),
                np.int64(-5), np.float64(np.inf), np.zeros(0), np.zeros((count, 2), complex), np.full((count, 2), 1e300),
                np.zeros((count, 2), bool), np.array(2**64 - 1, np.uint64), np.zeros((count, 2), "M8[s]"), np.full((count, 4), 0.5),
            ))  # fmt: skip
            if self.random.random() < 0.2:
                del good[key]
        stream = io.BytesIO()
        np.savez(stream, **good)
        data = bytearray(stream.getvalue())
        if self.random.random() < 0.4:
            for _ in range(self.random.choice((1, 3, 30))):
                data[self.random.randrange(len(data))] = self.random.randrange(256)
        if self.random.random() < 0.1:
            del data[self.random.randrange(len(data)) :]
        if self.random.random() < 0.1:
            data = bytearray(
                data.replace(
                    f"({count}, 2)".encode(), b"(99999999, 9)"[: len(f"({count}, 2)")].ljust(len(f"({count}, 2)"))
                )
            )
        name = self._file(".npz", bytes(data))
        if self.random.random() < 0.1:
            name = self.random.choice(
                ("array.npy", "folder.toml", "pipe.npz", "/dev/zero", "nothing.npz", "x" * 300 + ".npz")
            )
        return Case(
            ["run", scene, "--steps", "3", "--initial", name, *(["--json"] if self.random.random() < 0.5 else [])],
            [name[:40], "position", "velocity", "inverse_mass", "rotation", "plastic", "time", "step"],
        )

    def _store(self) -> Case:
        if self.random.random() < 0.5:
            data = bytearray((self.folder / "good.csv").read_bytes())
            for _ in range(self.random.choice((1, 2, 10))):
                place = self.random.randrange(len(data))
                what = self.random.random()
                if what < 0.4:
                    data[place] = self.random.choice(b'0123456789,"\n.-eax\x00\xff[{')
                elif what < 0.7:
                    del data[place : place + self.random.choice((1, 5, 60))]
                else:
                    data[place:place] = self.random.choice(
                        (b"9" * 50, b"9" * 5000, b"[" * 2000, b"a." * 3000, b'"', b"\n", b",,,", b"nan", b"1e999")
                    )
            file = self._file(".csv", bytes(data))
            target = self.random.choice(("new.sqlite", "odd name?.sqlite", "target.sqlite"))
            return Case(["merge", file, "--store", target], [file, target])
        (self.folder / "case.sqlite").write_bytes((self.folder / "good.sqlite").read_bytes())
        with contextlib.closing(sqlite3.connect(self.folder / "case.sqlite")) as opened:
            for _ in range(self.random.choice((1, 2))):
                table = self.random.choice(("machine", "run", "configuration", "sample", "measure"))
                columns = [row[1] for row in opened.execute(f"PRAGMA table_info({table})")]
                value = self.random.choice((
                    3, 2.5, b"\x00\xff", "text", "[]", "3", '{"a": {"b.c": [1, {"d": null}]}}', "[" * 3000, '{"a":' * 1200 + "1" + "}" * 1200,
                    "", None, -1, 2**62, float("inf"), "x\x00y", '{"": {"": 1}}', "\u202e",
                ))  # fmt: skip
                with contextlib.suppress(sqlite3.Error):
                    opened.execute(f"UPDATE {table} SET {self.random.choice(columns)} = ? WHERE rowid = 1", (value,))
            opened.commit()
        if self.random.random() < 0.2:
            data = bytearray((self.folder / "case.sqlite").read_bytes())
            for _ in range(20):
                data[self.random.randrange(len(data))] = self.random.randrange(256)
            (self.folder / "case.sqlite").write_bytes(bytes(data))
        for old in ("out.csv", "out.sqlite"):
            (self.folder / old).unlink(missing_ok=True)
        words = self.random.choice(
            (
                ["export", "out.csv", "--store", "case.sqlite"],
                ["export", "out.sqlite", "--store", "case.sqlite"],
                ["merge", "case.sqlite", "--store", "new.sqlite"],
            )
        )
        return Case(words, ["case.sqlite", "out.", "machine", "sample", "measure", "run", "configuration"])

    def _measuring(self) -> Case:
        command = self.random.choice(list(MEASURING))
        argv = [
            command,
            "--store",
            self.random.choice(("odd name.sqlite", "a?b#c%d", "new.sqlite", "folder.toml", "/nowhere/x", "x" * 300)),
        ]
        names = [argv[-1][:40], "--", "SCENE", "scene", "/nowhere"]
        if command in ("ablate", "advise"):
            argv.insert(1, self.random.choice(("lab-grid", "nothing", "x" * 5000)))
        for option in self.random.sample(
            MEASURING[command], min(len(MEASURING[command]), self.random.choice((1, 1, 2)))
        ):
            value = self.random.choice(
                (
                    "-1",
                    "0",
                    "nan",
                    "inf",
                    "x",
                    "",
                    "tpu",
                    "1e999",
                    "9" * 30,
                    "x" * 5000,
                    "float16",
                    "grid.rows=-1",
                    "S9",
                )
            )
            argv += [option, value]
        return Case(argv, names)

    def _name(self) -> Case:
        odd = self.random.choice((
            "pipe.toml", "/dev/zero", "/dev/full", "/dev/null", "loop.toml", "folder.toml", "x" * 5000, "x" * 300, "x" * 300 + ".toml",
            "", ".", "..", "/", "a/" * 2000, "\udcff.toml", "lab-gird", "hard/", "hard/x", "nothing.toml", "mesh.obj", "~", "\n", "-", "*",
            "good.sqlite", "pipe.sqlite", "pipe.csv", "pipe.npz", "array.npy",
        ))  # fmt: skip
        words = self.random.choice((
            ["run", odd], ["plan", odd], ["demo", odd], ["merge", odd, "--store", "new.sqlite"], ["export", odd, "--store", "good.sqlite"],
            ["export", "new.csv", "--store", odd], ["run", "lab-grid", "--no-judge", "--steps", "1", "--initial", odd],
            ["run", "lab-grid", "--no-judge", "--steps", "1", "--out", odd], ["run", "lab-grid", "--no-judge", "--export", odd],
            ["figures", "--energies", odd, "--out", "."], [odd], ["run", "lab-grid", f"--{odd}"],
            ["plan", "cloth-mesh", "--set", f"cloth.file={odd}"], ["plan", "jelly-drop", "--set", f"jelly.file={odd}"],
        ))  # fmt: skip
        for old in ("new.csv", "new.sqlite"):
            (self.folder / old).unlink(missing_ok=True)
        shown = odd[:30].encode("unicode_escape").decode()
        return Case(
            words,
            [shown, odd[:30], "--", "SCENE", "cloth", "jelly", "folder", "directory", "new.", "COMMAND", "command"],
        )

    def _mesh(self) -> Case:
        data = bytearray(OBJ.encode())
        for _ in range(self.random.choice((1, 2, 5))):
            place = self.random.randrange(len(data))
            what = self.random.random()
            if what < 0.4:
                data[place] = self.random.choice(b"0123456789-.e vf/\n\x00\xffxn")
            elif what < 0.6:
                del data[place : place + self.random.choice((1, 5, 20))]
            else:
                data[place:place] = self.random.choice(
                    (
                        b"1e300",
                        b"1e-300",
                        b"nan",
                        b"99999999999",
                        b"9" * 5000,
                        b"\nf 1 2 99\n",
                        b"\nf 1 1 1\n",
                        b"/" * 50,
                    )
                )
        name = self._file(self.random.choice((".obj", ".obj", ".ply", ".stl")), bytes(data))
        part = self.random.choice((
            {"mesh": {"file": name}, "method": {"solver": "xpbd"}, "structural": {}},
            {"body": {"kind": "soft_body", "file": name, "particle_spacing": self.random.choice((0.3, 0.2, 1e-9, 1e9))}},
            {"body": {"kind": "soft_sheet", "file": name, "particle_spacing": 0.5, "density": self.random.choice((0.2, 1e-320, 1e300))}},
            {"body": {"kind": "rigid_body", "file": name, "particle_spacing": 0.3, "scale": self.random.choice((1.0, 1e-200, 1e200, 1e-9))}},
            {"cloth": {"rows": 3, "columns": 3}, "structural": {}, "hill": {"kind": "mesh_collider", "file": name}, "method": {"solver": "xpbd"}},
        ))  # fmt: skip
        return Case(self._command(self._file(".toml", self._toml(part).encode())), [name, "body", "mesh", "hill"])

    def _energies(self) -> Case:
        frames = 3
        held: dict[str, Any] = {
            "time": np.arange(frames) * 0.1, "step": np.arange(frames), "position": np.zeros((frames, 4, 2)),
            "velocity": np.zeros((frames, 4, 2)), "scene": np.array(json.dumps({"grid": {"rows": 2, "columns": 2}, "springs": {}})),
        }  # fmt: skip
        key = self.random.choice(list(held))
        held[key] = self.random.choice((
            np.zeros(3), np.array("[" * 5000), np.array("{}"), np.zeros((frames, 4, 2), "U3"), np.full((frames, 4, 2), np.nan),
            np.full((frames, 4, 2), 1e200), np.zeros((0, 4, 2)), np.array(3), np.zeros(3, bool), held[key],
        ))  # fmt: skip
        stream = io.BytesIO()
        np.savez(stream, **held)
        for old in self.folder.glob("*-energies.*"):
            old.unlink()
        return Case(["figures", "--energies", self._file(".npz", stream.getvalue()), "--out", "."], ["case.npz"])
